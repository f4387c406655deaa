use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::frame::SamFrame;
use super::network::Sam;
use super::part::Part;
use super::segment::hold;
use crate::{Click, MaskError, PreparedFrame, Prompt, PxBox, Region, SegmentRequest};
use ostra_core::job::Progress;
use ostra_frames::Image;

/// A picture that is looked at around each prompt in its own pixels, not whole and shrunk: for stems and wires. The first
/// prompt at a place costs a run of the encoder, those close by the decoder alone.
#[derive(Debug)]
pub struct CloseUps {
    sam: Arc<Sam>,
    image: Arc<Image>,
    /// Parts that were embedded, the latest last.
    seen: Mutex<VecDeque<Arc<SamFrame>>>,
}

/// Parts kept of a picture.
const KEPT: usize = 4;
/// How much longer than what is wanted the side of a part may be that is looked at again.
const MOST_LONGER: u32 = 2;

impl CloseUps {
    /// Of a picture; nothing is embedded before the first prompt.
    #[must_use]
    pub fn new(sam: Arc<Sam>, image: Arc<Image>) -> Self {
        Self {
            sam,
            image,
            seen: Mutex::default(),
        }
    }

    /// The part around what is included and the newest click; all of the picture where a part would show no more.
    fn around(&self, prompt: &Prompt, progress: &Progress) -> Result<Arc<SamFrame>, MaskError> {
        let (width, height) = (self.image.width, self.image.height);
        let prompt = &shown_prompt(prompt);
        let wanted = Part::around(prompt, width, height, self.sam.side())
            .unwrap_or(Part::whole(width, height));
        // Held while a part is embedded, so that it is not embedded twice.
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let will_do =
            |part: Part| part.side() <= wanted.side() * MOST_LONGER && part.holds_all(prompt);
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
        // What is not looked at is not answered, but for what is clicked to be outside.
        let (shown, beyond): (Vec<_>, Vec<_>) = request
            .prompt
            .clicks
            .iter()
            .partition(|click| click.include || frame.part().holds(click.at_px));
        let prompt = Prompt {
            clicks: shown,
            boxes: request.prompt.boxes.clone(),
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

/// What must be seen: the boxes, the include clicks, and the newest click of whatever kind.
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

impl Part {
    /// The longer side.
    fn side(self) -> u32 {
        self.width.max(self.height)
    }

    /// Whether all clicks and boxes lie within.
    fn holds_all(&self, prompt: &Prompt) -> bool {
        let holds_box = |part: &PxBox| self.holds(part.min_px) && self.holds(part.max_px - 0.5);
        prompt.clicks.iter().all(|click| self.holds(click.at_px))
            && prompt.boxes.iter().all(holds_box)
    }
}
