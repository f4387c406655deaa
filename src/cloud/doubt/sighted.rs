use crate::fuse::Votes;
use ostra_masks::{LabelId, LabelMask};

/// The labels of the points that a frame sees, in the pixels that see them; `None` where no point is seen.
pub struct Sighted {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Row by row.
    pub labels: Vec<Option<LabelId>>,
}

impl Sighted {
    /// By the sightings that the votes know. Of several points in one pixel the first counts.
    pub(super) fn new(
        votes: &Votes,
        labels: &[LabelId],
        frame: usize,
        (width, height): (u32, u32),
    ) -> Self {
        let mut sighted = Self {
            width,
            height,
            labels: vec![None; width as usize * height as usize],
        };
        for (point, x, y) in votes.sightings(frame) {
            if x < width && y < height {
                sighted.labels[(y * width + x) as usize].get_or_insert(labels[point]);
            }
        }
        sighted
    }

    /// Whether a pixel at most `radius` columns and rows away sees this label.
    pub fn has_near(&self, at: usize, radius: u32, label: LabelId) -> bool {
        near(at, radius, (self.width, self.height)).any(|at| self.labels[at] == Some(label))
    }

    /// The label that the nearest pixel sees, at most `radius` columns and rows away; of equally near ones the first.
    pub(super) fn nearest(&self, at: usize, radius: u32) -> Option<LabelId> {
        if self.labels[at].is_some() {
            return self.labels[at];
        }
        let width = self.width as usize;
        let squared = |other: usize| {
            let (dx, dy) = (
                (other % width).abs_diff(at % width),
                (other / width).abs_diff(at / width),
            );
            dx * dx + dy * dy
        };
        let seen = near(at, radius, (self.width, self.height))
            .filter(|&other| self.labels[other].is_some());
        seen.min_by_key(|&other| squared(other))
            .and_then(|other| self.labels[other])
    }
}

/// Whether a pixel of a mask at most `radius` columns and rows away has this label.
pub fn mask_has_near(mask: &LabelMask, at: usize, radius: u32, label: LabelId) -> bool {
    near(at, radius, (mask.width, mask.height)).any(|at| mask.ids[at] == label)
}

/// The pixels at most `radius` columns and rows away, row by row.
fn near(at: usize, radius: u32, (width, height): (u32, u32)) -> impl Iterator<Item = usize> {
    let (x, y) = (at as u32 % width, at as u32 / width);
    let columns = x.saturating_sub(radius)..=(x + radius).min(width - 1);
    let rows = y.saturating_sub(radius)..=(y + radius).min(height - 1);
    rows.flat_map(move |y| columns.clone().map(move |x| (y * width + x) as usize))
}
