use super::sighted::{Sighted, mask_has_near};
use crate::fuse::Votes;
use ostra_masks::{LabelId, LabelMask, Region};

/// Pixels by which borders may differ: no mask is drawn to the pixel, and no point is seen to it.
const BORDER_PX: u32 = 2;

/// How far a frame's mask and the vote of all frames are apart, in pixels that see a point and have a label by one of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameDoubt {
    /// All of them.
    pub compared: usize,
    /// Those where both name different labels, and not only because a border lies a little aside.
    pub against: usize,
}

impl FrameDoubt {
    /// The share that disagrees, 0–1.
    #[must_use]
    pub fn share(&self) -> f32 {
        if self.compared == 0 {
            0.0
        } else {
            self.against as f32 / self.compared as f32
        }
    }
}

/// Compares a frame's mask with the labels of the points that the frame sees; `labels` holds one for each point that was
/// voted on. A pixel disagrees where the mask has the vote's label nowhere within two pixels, or the vote the mask's.
#[must_use]
pub fn frame_doubt(
    votes: &Votes,
    labels: &[LabelId],
    frame: usize,
    mask: &LabelMask,
) -> FrameDoubt {
    let sighted = Sighted::new(votes, labels, frame, (mask.width, mask.height));
    let mut doubt = FrameDoubt::default();
    for (at, (&voted, &own)) in sighted.labels.iter().zip(&mask.ids).enumerate() {
        let Some(voted) = voted.filter(|&voted| voted != LabelId::NONE || own != LabelId::NONE)
        else {
            continue;
        };
        doubt.compared += 1;
        let differs = voted != own
            && (!mask_has_near(mask, at, BORDER_PX, voted)
                || !sighted.has_near(at, BORDER_PX, own));
        doubt.against += usize::from(differs);
    }
    doubt
}

/// The pixels where a frame's mask and the mask that the vote of all gives it name different labels, and not only because a
/// border lies a little aside.
#[must_use]
pub fn contradiction(mask: &LabelMask, voted: &LabelMask) -> Region {
    let differs = |(at, (&own, &voted_id)): (usize, (&LabelId, &LabelId))| {
        own != voted_id
            && (!mask_has_near(mask, at, BORDER_PX, voted_id)
                || !mask_has_near(voted, at, BORDER_PX, own))
    };
    let inside = mask
        .ids
        .iter()
        .zip(&voted.ids)
        .enumerate()
        .map(differs)
        .collect();
    Region {
        width: mask.width,
        height: mask.height,
        inside,
    }
}
