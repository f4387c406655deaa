use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::frame::SamFrame;
use super::network::Sam;
use super::part::ImagePart;
use super::segment::hold;
use crate::{Click, MaskError, PreparedFrame, Prompt, PxBox, Region, SegmentRequest};
use ostra_core::job::Progress;
use ostra_frames::Image;

/// A frame that is segmented around each prompt at full resolution, for stems and wires.
///
/// The whole image would be shrunk to the network's input size. The first prompt in a place costs a
/// run of the encoder; prompts nearby cost only the decoder.
#[derive(Debug)]
pub struct CloseUps {
    sam: Arc<Sam>,
    image: Arc<Image>,
    /// Parts that are embedded already, the latest last.
    seen: Mutex<VecDeque<Arc<SamFrame>>>,
}

/// Maximum number of embedded parts kept per image.
const KEPT: usize = 4;
/// Maximum size of an embedded part that is used again, relative to the part wanted.
const MOST_LONGER: u32 = 2;

impl CloseUps {
    /// Creates the frame of an image; nothing is embedded before the first prompt.
    #[must_use]
    pub fn new(sam: Arc<Sam>, image: Arc<Image>) -> Self {
        Self {
            sam,
            image,
            seen: Mutex::default(),
        }
    }

    /// Returns the part around everything included and the newest click.
    ///
    /// Falls back to the whole image where a part would show no more.
    fn around(&self, prompt: &Prompt, progress: &Progress) -> Result<Arc<SamFrame>, MaskError> {
        let (width, height) = (self.image.width, self.image.height);
        let prompt = &shown_prompt(prompt);
        let wanted = ImagePart::around(prompt, width, height, self.sam.side())
            .unwrap_or(ImagePart::whole(width, height));
        // Locked while a part is embedded, so that it is not embedded twice.
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let will_do =
            |part: ImagePart| part.side() <= wanted.side() * MOST_LONGER && part.holds_all(prompt);
        if let Some(known) = seen.iter().rev().find(|known| will_do(known.part())) {
            return Ok(Arc::clone(known));
        }
        let frame = Arc::new(
            self.sam
                .frame(&self.sam.embed(&self.image, wanted, progress)?)?,
        );
        seen.push_back(Arc::clone(&frame));
        if seen.len() > KEPT {
            seen.pop_front();
        }
        Ok(frame)
    }
}

impl PreparedFrame for CloseUps {
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        progress: &Progress,
    ) -> Result<Region, MaskError> {
        let frame = self.around(request.prompt, progress)?;
        // Pixels outside the part are not segmented; exclude clicks there are still enforced.
        let (shown, beyond): (Vec<_>, Vec<_>) = request
            .prompt
            .clicks
            .iter()
            .partition(|click| click.include || frame.part().holds(click.at_px));
        let prompt = Prompt {
            clicks: shown,
            boxes: request.prompt.boxes.clone(),
            size: request.prompt.size,
            ..Prompt::default()
        };
        let mut region = frame.segment(
            &SegmentRequest {
                prompt: &prompt,
                ..*request
            },
            progress,
        )?;
        beyond.iter().for_each(|click| hold(&mut region, click));
        Ok(region)
    }

    fn bytes(&self) -> usize {
        let part = self.sam.bytes_of_frame();
        self.image.pixels.len() * size_of::<[u8; 3]>() + KEPT * part
    }
}

/// Returns what the part must contain: boxes, include clicks, and the newest click of either kind.
fn shown_prompt(prompt: &Prompt) -> Prompt {
    let newest = prompt.clicks.last().map(|click| Click {
        include: true,
        ..*click
    });
    let included = prompt.clicks.iter().filter(|click| click.include).copied();
    Prompt {
        clicks: included.chain(newest).collect(),
        boxes: prompt.boxes.clone(),
        ..Prompt::default()
    }
}

impl ImagePart {
    /// Returns the length of the longer side.
    fn side(self) -> u32 {
        self.width.max(self.height)
    }

    /// Returns whether all clicks and boxes lie within the part.
    fn holds_all(&self, prompt: &Prompt) -> bool {
        let holds_box = |part: &PxBox| self.holds(part.min_px) && self.holds(part.max_px - 0.5);
        prompt.clicks.iter().all(|click| self.holds(click.at_px))
            && prompt.boxes.iter().all(holds_box)
    }
}
