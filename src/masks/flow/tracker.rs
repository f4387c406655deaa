use std::sync::Arc;

use super::gap::{Gap, gaps};
use super::merge::merged;
use super::options::FlowOptions;
use super::picture::{Picture, enlarged_mask, reduced_mask, working_size};
use super::walk::{Change, Walk, WalkedFrame};
use crate::engine::job::Progress;
use crate::masks::{LabelId, LabelMask, MaskError, RunMask, TrackRequest, TrackedFrame, Tracker};

/// Carries masks through films and photos without depth or weights.
#[derive(Debug, Clone, Copy, Default)]
pub struct FlowTracker {
    /// How masks are carried.
    pub options: FlowOptions,
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
        let mut run = Run { options: &self.options, request, emit, progress, done: 0, total };
        gaps.iter().try_for_each(|gap| run.fill(gap))?;
        Ok(Vec::new())
    }
}

struct Run<'a> {
    options: &'a FlowOptions,
    request: &'a TrackRequest,
    emit: &'a mut dyn FnMut(TrackedFrame),
    progress: &'a Progress,
    done: usize,
    total: usize,
}

/// A frame of the walk from the anchor before, kept until the walk from the anchor after reaches it.
struct Kept {
    runs: RunMask,
    confidence: std::collections::BTreeMap<LabelId, f32>,
}

impl Run<'_> {
    /// Walks through a gap from both of its ends. What the first walk finds is handed on at once, and again when the
    /// second has met it.
    fn fill(&mut self, gap: &Gap) -> Result<(), MaskError> {
        let Some(any) = gap.before.or(gap.after) else { return Ok(()) };
        let of = &self.request.frames[any];
        let size = working_size(of.width, of.height, self.options.most_side);
        let mut kept: Vec<Option<Kept>> = Vec::new();
        if let Some(anchor) = gap.before {
            kept.resize_with(gap.to - gap.from + 1, || None);
            self.walk(anchor, gap.after, gap.to, size, &mut |run, frame, walked| {
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
            self.walk(anchor, gap.before, gap.from, size, &mut |run, frame, walked| {
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
    /// end are heeded too.
    fn walk(
        &mut self,
        anchor: usize,
        other: Option<usize>,
        last: usize,
        size: (usize, usize),
        found: &mut dyn FnMut(&mut Self, usize, WalkedFrame),
    ) -> Result<(), MaskError> {
        let frames: Vec<usize> =
            if last > anchor { (anchor + 1..=last).collect() } else { (last..anchor).rev().collect() };
        let (mut picture, mask) = self.anchor(anchor, size)?;
        self.progress.check()?;
        let mut walk = Walk::new(self.options, &picture, &mask);
        if let Some(other) = other {
            let (picture, mask) = self.anchor(other, size)?;
            walk.learn(&picture, &mask);
        }
        self.progress.check()?;
        let Some(&first) = frames.first() else { return Ok(()) };
        let mut change = self.change(&picture, first, size)?;
        for (step, &frame) in frames.iter().enumerate() {
            picture = Arc::clone(&change.next);
            let (request, next) = (self.request, frames.get(step + 1).copied());
            let ahead = || next.map(|next| Ok::<_, MaskError>(Change::new(&picture, load(request, next, size)?)));
            let (walked, following) = rayon::join(|| walk.advance(change), ahead);
            found(self, frame, walked);
            self.done += 1;
            self.progress.step(self.done, self.total)?;
            match following.transpose()? {
                Some(following) => change = following,
                None => break,
            }
        }
        Ok(())
    }

    fn anchor(&self, frame: usize, size: (usize, usize)) -> Result<(Arc<Picture>, LabelMask), MaskError> {
        let mask = reduced_mask(&self.request.anchors[&frame], size);
        Ok((load(self.request, frame, size)?, mask))
    }

    fn change(&self, picture: &Picture, next: usize, size: (usize, usize)) -> Result<Change, MaskError> {
        Ok(Change::new(picture, load(self.request, next, size)?))
    }

    fn hand_on(&mut self, frame: usize, walked: &WalkedFrame, preliminary: bool) {
        let of = &self.request.frames[frame];
        let mask = enlarged_mask(&walked.mask, of.width, of.height);
        let shown = |id: &LabelId| walked.mask.ids.contains(id);
        let confidence = walked.confidence.iter().filter(|(id, _)| shown(id)).map(|(&id, &sure)| (id, sure)).collect();
        (self.emit)(TrackedFrame { frame, mask, confidence, preliminary });
    }
}

fn load(request: &TrackRequest, frame: usize, size: (usize, usize)) -> Result<Arc<Picture>, MaskError> {
    Ok(Arc::new(Picture::new(&*request.store.image(&request.frames[frame])?, size)))
}
