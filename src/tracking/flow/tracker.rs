use std::collections::BTreeMap;
use std::sync::Arc;

use super::dis::Finest;
use super::evidence::Beyond;
use super::flows::Flows;
use super::memory::Describer;
use super::motion::Change;
use super::options::FlowOptions;
use super::picture::{Picture, Pictures, Route, enlarged_mask, reduced_mask, working_size};
use super::walk::Walk;
use ostra_core::job::Progress;
use ostra_masks::{
    Direction, LabelId, LabelMask, MaskError, RunMask, TrackRequest, TrackedFrame, Tracker,
    WalkedFrame, merged,
};

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
        let mut run = Run {
            options: &self.options,
            request,
            emit,
            progress,
            pictures,
            flows: Flows::default(),
            done: 0,
            total,
            answered: false,
        };
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
    flows: Flows,
    done: usize,
    total: usize,
    /// Whether any frame was handed on.
    answered: bool,
}

/// Steps of the first walk that are kept for the second, 15 MB each at 854×480: all between anchors up to eight frames apart.
const KEPT_STEPS: usize = 8;

/// How many times as near the second walk counts as being where two walks meet, since it has seen what the first found; weights
/// go by the square.
const SECOND: f32 = 3.0;

/// A frame of the walk from the anchor before, kept for the walk from the anchor after.
struct Kept {
    runs: RunMask,
    confidence: BTreeMap<LabelId, f32>,
}

impl Kept {
    fn new(walked: WalkedFrame) -> Self {
        Self {
            runs: RunMask::encode(&walked.mask),
            confidence: walked.confidence,
        }
    }

    /// Between this and what the second walk says, as far from the anchor after as `nearness` tells, 1 at the anchor before.
    fn met_by(&self, second: &WalkedFrame, nearness: f32) -> WalkedFrame {
        let first = WalkedFrame {
            mask: self.runs.decode(),
            confidence: self.confidence.clone(),
        };
        merged(
            &first,
            second,
            nearness / (nearness + SECOND * (1.0 - nearness)),
        )
    }
}

impl Run<'_> {
    /// Walks through a gap from both of its ends. What the first walk finds is handed on at once, and again when the
    /// second has met it. Between anchors, where few frames are corrected and each shall be right, pictures are larger, flow is
    /// measured finely, and where the frame ahead has a mask, the walk heeds it, too.
    fn fill(&mut self, gap: &Gap) -> Result<(), MaskError> {
        let Some(any) = gap.before.or(gap.after) else {
            return Ok(());
        };
        let request = self.request;
        let of = &request.frames[any];
        let (most_side, finest, kept_steps) = if gap.before.and(gap.after).is_some() {
            (self.options.most_side_between, Finest::Full, KEPT_STEPS)
        } else {
            (self.options.most_side, Finest::Half, 0)
        };
        self.flows = Flows::keeping(kept_steps);
        let size = working_size(of.width, of.height, most_side);
        let anchor_mask = |frame: usize| reduced_mask(&request.anchors[&frame], size);
        let mut kept: BTreeMap<usize, Kept> = BTreeMap::new();
        if let Some(anchor) = gap.before {
            let known = |frame: usize| (Some(frame) == gap.after).then(|| anchor_mask(frame));
            self.walk(
                (anchor, gap),
                (size, finest),
                &known,
                &mut |run, frame, walked| {
                    if frame >= gap.from {
                        run.hand_on(frame, &walked, gap.after.is_some());
                    }
                    if gap.after.is_some() {
                        kept.insert(frame, Kept::new(walked));
                    }
                },
            )?;
        }
        self.flows.keep_no_more();
        if let Some(anchor) = gap.after {
            let known = |frame: usize| match gap.before {
                Some(before) if before == frame => Some(anchor_mask(frame)),
                _ => kept.get(&frame).map(|first| first.runs.decode()),
            };
            self.walk(
                (anchor, gap),
                (size, finest),
                &known,
                &mut |run, frame, walked| {
                    if frame > gap.to {
                        return;
                    }
                    match kept.get(&frame).zip(gap.nearness(frame)) {
                        None => run.hand_on(frame, &walked, false),
                        Some((first, nearness)) => {
                            run.hand_on(frame, &first.met_by(&walked, nearness), false);
                        }
                    }
                },
            )?;
        }
        Ok(())
    }

    /// Walks from one anchor of a gap to its far end; the colours of the anchor there are heeded too, and the mask that is
    /// `known` of the frame ahead. An anchor that cannot be read starts no walk.
    fn walk(
        &mut self,
        (anchor, gap): (usize, &Gap),
        (size, finest): ((usize, usize), Finest),
        known: &dyn Fn(usize) -> Option<LabelMask>,
        found: &mut dyn FnMut(&mut Self, usize, WalkedFrame),
    ) -> Result<(), MaskError> {
        let forwards = gap.before == Some(anchor);
        let (other, last) = if forwards {
            (gap.after, gap.to)
        } else {
            (gap.before, gap.from)
        };
        let Some((picture, mask)) = self.anchor(anchor, size)? else {
            return Ok(());
        };
        let mut walk = Walk::new(self.options, &picture, &mask);
        let far = other
            .map(|other| self.anchor(other, size))
            .transpose()?
            .flatten();
        if let Some((picture, mask)) = &far {
            walk.learn(picture, mask);
        }
        let beyond_last = if forwards {
            last.checked_add(1)
        } else {
            last.checked_sub(1)
        };
        let end = beyond_last
            .filter(|&frame| known(frame).is_some())
            .unwrap_or(last);
        let mut route = Route::new(anchor, end, size);
        let mut at = anchor;
        let mut coming = change(
            &mut route,
            &mut self.pictures,
            &mut self.flows,
            &picture,
            finest,
        )?;
        // Who walks alone needs not see the frame after the next.
        let mut ahead = match coming.as_ref().filter(|_| other.is_some()) {
            Some((_, step)) => change(
                &mut route,
                &mut self.pictures,
                &mut self.flows,
                &step.next,
                finest,
            )?,
            None => None,
        };
        while let Some((frame, step)) =
            coming.filter(|(frame, _)| frame.abs_diff(anchor) <= last.abs_diff(anchor))
        {
            let beyond = ahead.as_ref().and_then(|(next, change)| {
                Some(Beyond {
                    change,
                    mask: known(*next)?,
                    share: gap.share_beyond(*next, at)?,
                })
            });
            let farthest = Arc::clone(ahead.as_ref().map_or(&step.next, |(_, ahead)| &ahead.next));
            let (pictures, flows, progress) = (&mut self.pictures, &mut self.flows, self.progress);
            let (walked, after) = rayon::join(
                || walk.advance(step, beyond.as_ref(), progress),
                || change(&mut route, pictures, flows, &farthest, finest),
            );
            found(self, frame, walked?);
            self.done += frame.abs_diff(std::mem::replace(&mut at, frame));
            self.progress.step(self.done, self.total)?;
            (coming, ahead) = if ahead.is_some() {
                (ahead, after?)
            } else {
                (after?, None)
            };
        }
        Ok(())
    }

    fn anchor(
        &mut self,
        frame: usize,
        size: (usize, usize),
    ) -> Result<Option<(Arc<Picture>, LabelMask)>, MaskError> {
        let picture = self.pictures.load(frame, size)?;
        Ok(picture.map(|picture| (picture, reduced_mask(&self.request.anchors[&frame], size))))
    }

    fn hand_on(&mut self, frame: usize, walked: &WalkedFrame, preliminary: bool) {
        let of = &self.request.frames[frame];
        let mask = enlarged_mask(&walked.mask, of.width, of.height);
        let shown = |id: &LabelId| walked.mask.ids.contains(id);
        let confidence = walked
            .confidence
            .iter()
            .filter(|(id, _)| shown(id))
            .map(|(&id, &sure)| (id, sure))
            .collect();
        (self.emit)(TrackedFrame {
            frame,
            mask,
            confidence,
            preliminary,
        });
        self.answered = true;
    }
}

/// The next frame of a route, and how pixels move to it.
fn change(
    route: &mut Route,
    pictures: &mut Pictures<'_>,
    flows: &mut Flows,
    last: &Arc<Picture>,
    finest: Finest,
) -> Result<Option<(usize, Change)>, MaskError> {
    Ok(route
        .next(pictures)?
        .map(|(frame, next)| (frame, flows.change(last, &next, finest))))
}

/// Frames in a row that lie between the same anchors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Gap {
    /// First and last frame asked for.
    pub from: usize,
    pub to: usize,
    /// The anchor before them that their masks come from, and the one after.
    pub before: Option<usize>,
    pub after: Option<usize>,
}

impl Gap {
    /// Steps from frame to frame that it takes.
    pub fn steps(&self) -> usize {
        self.before.map_or(0, |anchor| self.to - anchor)
            + self.after.map_or(0, |anchor| anchor - self.from)
    }

    /// How near the anchor before a frame is, from 1 at it to 0 at the anchor after; `None` where one of them is missing.
    pub fn nearness(&self, frame: usize) -> Option<f32> {
        let (before, after) = self.before.zip(self.after)?;
        Some((after as f32 - frame as f32) / (after - before) as f32)
    }

    /// How much the mask of the frame `beyond`, which comes from one anchor, counts beside that of `own`, which comes from the
    /// other, 0–1: as each is near its anchor.
    pub fn share_beyond(&self, beyond: usize, own: usize) -> Option<f32> {
        let (of_beyond, of_own) = (self.nearness(beyond)?, self.nearness(own)?);
        let (beyond, own) = if beyond < own {
            (of_beyond, 1.0 - of_own)
        } else {
            (1.0 - of_beyond, of_own)
        };
        Some(beyond / (beyond + own))
    }
}

/// The gaps of a request that masks can be carried into, in order.
fn gaps(request: &TrackRequest) -> Vec<Gap> {
    let mut gaps: Vec<Gap> = Vec::new();
    for frame in (request.from..=request.to).filter(|frame| !request.anchors.contains_key(frame)) {
        let before = request
            .anchors
            .range(..frame)
            .next_back()
            .map(|(&anchor, _)| anchor);
        let after = request
            .anchors
            .range(frame..)
            .next()
            .map(|(&anchor, _)| anchor);
        let before = before.filter(|_| request.direction != Direction::Backward);
        let after = after.filter(|_| request.direction != Direction::Forward);
        match gaps.last_mut() {
            Some(gap) if gap.to + 1 == frame => gap.to = frame,
            _ if before.is_some() || after.is_some() => gaps.push(Gap {
                from: frame,
                to: frame,
                before,
                after,
            }),
            _ => {}
        }
    }
    gaps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_frames_the_one_nearer_to_its_anchor_counts_more() {
        let gap = Gap {
            from: 11,
            to: 17,
            before: Some(10),
            after: Some(18),
        };
        assert_eq!(
            [10, 14, 18].map(|frame| gap.nearness(frame)),
            [Some(1.0), Some(0.5), Some(0.0)]
        );
        assert_eq!(gap.share_beyond(10, 12), Some(0.8));
        assert_eq!(gap.share_beyond(13, 15), Some(0.5));
        assert_eq!(gap.share_beyond(18, 16), Some(0.8));
        let one_frame = Gap {
            from: 11,
            to: 11,
            before: Some(10),
            after: Some(12),
        };
        assert_eq!(
            [
                one_frame.share_beyond(10, 12),
                one_frame.share_beyond(12, 10)
            ],
            [Some(0.5); 2]
        );
        assert_eq!(Gap { after: None, ..gap }.share_beyond(13, 15), None);
    }
}
