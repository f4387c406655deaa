use std::sync::Arc;

use super::dis::Finest;
use super::gap::{Gap, gaps};
use super::memory::Describer;
use super::options::FlowOptions;
use super::picture::{Picture, enlarged_mask, reduced_mask, working_size};
use super::pictures::{Pictures, Route};
use super::walk::{Change, Walk};
use crate::engine::job::Progress;
use crate::masks::{LabelId, LabelMask, MaskError, RunMask, TrackRequest, TrackedFrame, Tracker, WalkedFrame, merged};

/// Carries masks through films and photos without depth or weights.
#[derive(Debug, Clone, Default)]
pub struct FlowTracker {
    /// How masks are carried.
    pub options: FlowOptions,
    /// What describes pictures, so that parts of objects are known again from the anchors.
    pub describer: Option<Arc<dyn Describer>>,
}

impl Tracker for FlowTracker {
    fn name(&self) -> &'static str {
        "flow"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        progress.stage("track")?;
        request.check()?;
        let gaps = gaps(request);
        if gaps.is_empty() {
            return Err(MaskError::Request(format!(
                "no frame from {} to {} lies on the side of an anchor that masks are carried to; \
                 choose another range or direction",
                request.from, request.to
            )));
        }
        let total = gaps.iter().map(Gap::steps).sum();
        let pictures = Pictures::new(request, self.describer.as_deref(), progress);
        let mut run =
            Run { options: &self.options, request, emit, progress, pictures, done: 0, total, answered: false };
        gaps.iter().try_for_each(|gap| run.fill(gap))?;
        match (!run.answered).then(|| run.pictures.failure()).flatten() {
            Some(failure) => Err(failure),
            None => Ok(run.pictures.warnings()),
        }
    }
}

struct Run<'a> {
    options: &'a FlowOptions,
    request: &'a TrackRequest,
    emit: &'a mut dyn FnMut(TrackedFrame),
    progress: &'a Progress,
    pictures: Pictures<'a>,
    done: usize,
    total: usize,
    /// Whether any frame was handed on.
    answered: bool,
}

/// A frame of the walk from the anchor before, kept until the walk from the anchor after reaches it.
struct Kept {
    runs: RunMask,
    confidence: std::collections::BTreeMap<LabelId, f32>,
}

impl Run<'_> {
    /// Walks through a gap from both of its ends. What the first walk finds is handed on at once, and again when the
    /// second has met it. Between anchors, where few frames are corrected and each shall be right, pictures are larger and flow is
    /// measured finely.
    fn fill(&mut self, gap: &Gap) -> Result<(), MaskError> {
        let Some(any) = gap.before.or(gap.after) else { return Ok(()) };
        let of = &self.request.frames[any];
        let (most_side, finest) = if gap.before.and(gap.after).is_some() {
            (self.options.most_side_between, Finest::Full)
        } else {
            (self.options.most_side, Finest::Half)
        };
        let scale = (working_size(of.width, of.height, most_side), finest);
        let mut kept: Vec<Option<Kept>> = Vec::new();
        if let Some(anchor) = gap.before {
            kept.resize_with(gap.to - gap.from + 1, || None);
            self.walk(anchor, gap.after, gap.to, scale, &mut |run, frame, walked| {
                if frame >= gap.from {
                    run.hand_on(frame, &walked, gap.after.is_some());
                    if gap.after.is_none() {
                        return;
                    }
                    let runs = RunMask::encode(&walked.mask);
                    kept[frame - gap.from] = Some(Kept { runs, confidence: walked.confidence });
                }
            })?;
        }
        if let Some(anchor) = gap.after {
            self.walk(anchor, gap.before, gap.from, scale, &mut |run, frame, walked| {
                if frame > gap.to {
                    return;
                }
                let first = kept.get_mut(frame - gap.from).and_then(Option::take);
                match first.zip(gap.before) {
                    None => run.hand_on(frame, &walked, false),
                    Some((first, before)) => {
                        let first = WalkedFrame { mask: first.runs.decode(), confidence: first.confidence };
                        let nearness = (anchor - frame) as f32 / (anchor - before) as f32;
                        run.hand_on(frame, &merged(&first, &walked, nearness), false);
                    }
                }
            })?;
        }
        Ok(())
    }

    /// Walks from an anchor to the frame `last`, which lies before or after it; the colours of the anchor at the other
    /// end are heeded too. An anchor that cannot be read starts no walk.
    fn walk(
        &mut self,
        anchor: usize,
        other: Option<usize>,
        last: usize,
        (size, finest): ((usize, usize), Finest),
        found: &mut dyn FnMut(&mut Self, usize, WalkedFrame),
    ) -> Result<(), MaskError> {
        let Some((mut picture, mask)) = self.anchor(anchor, size)? else { return Ok(()) };
        let mut walk = Walk::new(self.options, &picture, &mask);
        if let Some(other) = other
            && let Some((picture, mask)) = self.anchor(other, size)?
        {
            walk.learn(&picture, &mask);
        }
        let mut route = Route::new(anchor, last, size);
        let mut at = anchor;
        let mut coming = change(&mut route, &mut self.pictures, &picture, finest)?;
        while let Some((frame, step)) = coming {
            picture = Arc::clone(&step.next);
            let (pictures, progress) = (&mut self.pictures, self.progress);
            let ahead = || change(&mut route, pictures, &picture, finest);
            let (walked, following) = rayon::join(|| walk.advance(step, progress), ahead);
            found(self, frame, walked?);
            self.done += frame.abs_diff(std::mem::replace(&mut at, frame));
            self.progress.step(self.done, self.total)?;
            coming = following?;
        }
        Ok(())
    }

    fn anchor(&mut self, frame: usize, size: (usize, usize)) -> Result<Option<(Arc<Picture>, LabelMask)>, MaskError> {
        let picture = self.pictures.load(frame, size)?;
        Ok(picture.map(|picture| (picture, reduced_mask(&self.request.anchors[&frame], size))))
    }

    fn hand_on(&mut self, frame: usize, walked: &WalkedFrame, preliminary: bool) {
        let of = &self.request.frames[frame];
        let mask = enlarged_mask(&walked.mask, of.width, of.height);
        let shown = |id: &LabelId| walked.mask.ids.contains(id);
        let confidence = walked.confidence.iter().filter(|(id, _)| shown(id)).map(|(&id, &sure)| (id, sure)).collect();
        (self.emit)(TrackedFrame { frame, mask, confidence, preliminary });
        self.answered = true;
    }
}

/// The next frame of a route, and how pixels move to it.
fn change(
    route: &mut Route,
    pictures: &mut Pictures<'_>,
    last: &Picture,
    finest: Finest,
) -> Result<Option<(usize, Change)>, MaskError> {
    Ok(route.next(pictures)?.map(|(frame, next)| (frame, Change::new(last, next, finest))))
}
