use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::anchor::Anchor;
use super::bleed::Bleeding;
use super::choose::fillers_for;
use super::complete::Completion;
use super::options::CarryOptions;
use super::tolerance::Tolerance;
use super::viewpoint::{Stand, Viewpoint};
use super::views::Views;
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelMask, MaskError};

/// An anchor as the request gives it, before its depth is loaded.
#[derive(Debug)]
pub struct GivenAnchor<'a> {
    pub frame: usize,
    pub stand: Stand,
    /// Labels of its mask, in order.
    pub labels: Vec<LabelId>,
    pub mask: &'a Arc<LabelMask>,
}

/// Bytes of anchors kept ready, about.
const BUDGET_BYTES: usize = 192 << 20;

type Slot = Arc<Mutex<Option<Arc<Anchor>>>>;

/// Anchors that were made ready, the latest kept. Each is made by one thread while others wait for it.
#[derive(Debug)]
pub struct ReadyAnchors<'a> {
    views: &'a Views<'a>,
    options: &'a CarryOptions,
    slots: Mutex<(BTreeMap<usize, Slot>, VecDeque<usize>)>,
}

impl<'a> ReadyAnchors<'a> {
    pub fn new(views: &'a Views<'a>, options: &'a CarryOptions) -> Self {
        Self {
            views,
            options,
            slots: Mutex::default(),
        }
    }

    /// The anchor, made ready now if it is not; `None` where its depth cannot be read.
    pub fn get(
        &self,
        given: &GivenAnchor<'_>,
        progress: &Progress,
    ) -> Result<Option<Arc<Anchor>>, MaskError> {
        let slot = self.slot(given.frame, given.mask.ids.len());
        let mut slot = lock(&slot);
        if let Some(anchor) = &*slot {
            return Ok(Some(anchor.clone()));
        }
        let anchor = self.make(given, progress)?.map(Arc::new);
        slot.clone_from(&anchor);
        Ok(anchor)
    }

    /// The place of an anchor; the oldest are given up for a new one.
    fn slot(&self, frame: usize, pixels: usize) -> Slot {
        let mut slots = lock(&self.slots);
        let (of_frame, order) = &mut *slots;
        if let Some(slot) = of_frame.get(&frame) {
            return slot.clone();
        }
        let most = BUDGET_BYTES / (2 * size_of::<f32>() * pixels.max(1));
        while order.len() >= most.max(4) {
            order
                .pop_front()
                .and_then(|oldest| of_frame.remove(&oldest));
        }
        order.push_back(frame);
        of_frame.entry(frame).or_default().clone()
    }

    /// Fills the holes in the anchor's depth from other frames that can be read, and where what lies behind its labels
    /// shines through.
    fn make(
        &self,
        given: &GivenAnchor<'_>,
        progress: &Progress,
    ) -> Result<Option<Anchor>, MaskError> {
        let Some(seen) = self.views.load(given.frame)? else {
            return Ok(None);
        };
        let tolerance = Tolerance::most(&seen, self.options);
        let bleeding = Bleeding::find(&seen, given.mask, tolerance);
        let own = Viewpoint {
            depth: Arc::new(bleeding.stanched(&seen.depth)),
            ..seen
        };
        let mut completion = Completion::new(&own, tolerance);
        let others = self
            .views
            .stands()
            .filter(|&(frame, _)| frame != given.frame);
        for filler in fillers_for(&own, others, self.options.fillers) {
            if let Some(filler) = self.views.load(filler)? {
                completion.add(&filler, progress)?;
            }
        }
        let mut filled = completion.finish();
        bleeding.check(&mut filled);
        Ok(Some(Anchor::new(
            own,
            filled,
            given.mask.clone(),
            self.options,
        )))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
