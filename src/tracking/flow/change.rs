use std::collections::VecDeque;
use std::sync::Arc;

use glam::Vec2;

use super::dis::{Finest, flow_between};
use super::motion::{PlaneMotion, PointMatch};
use super::plane::{Flow, Plane, median};
use super::tracked_image::TrackedImage;
use ostra_masks::Region;

/// Maximum number of pixels sampled to estimate the background motion.
const MOST_STEPS: usize = 1500;

/// Inlier threshold of the background motion, in pixels.
const AGREES_PX: f32 = 2.0;

/// Two neighbouring frames and the optical flow between them.
pub(super) struct FrameChange {
    pub last: Arc<TrackedImage>,
    pub next: Arc<TrackedImage>,
    /// Flow from the last frame to the next, and back.
    pub forward: Arc<Flow>,
    pub backward: Arc<Flow>,
    /// Forward-backward consistency of each pixel of the next frame, 0–1.
    pub reliable: Plane,
    /// Background motion from the next frame back to the last; `None` if too little is visible.
    pub background: Option<PlaneMotion>,
    /// Median residual of the background motion, in pixels.
    pub background_noise: f32,
}

impl FrameChange {
    /// Measures the flow in both directions.
    pub fn new(last: Arc<TrackedImage>, next: Arc<TrackedImage>, finest: Finest) -> Self {
        let flow = |from: &TrackedImage, to: &TrackedImage| {
            Arc::new(flow_between(&from.pyramid, &to.pyramid, finest))
        };
        let (forward, backward) = rayon::join(|| flow(&last, &next), || flow(&next, &last));
        Self::of_flows(last, next, forward, backward)
    }

    /// Uses given flows from the last frame to the next, and back.
    pub fn of_flows(
        last: Arc<TrackedImage>,
        next: Arc<TrackedImage>,
        forward: Arc<Flow>,
        backward: Arc<Flow>,
    ) -> Self {
        let reliable = Plane::from_fn(next.width, next.height, |x, y| {
            let vector = backward.at(x, y);
            let miss = (vector + forward.sample(Vec2::new(x as f32, y as f32) + vector)).length();
            (-(miss / (1.0 + 0.1 * vector.length())).powi(2)).exp()
        });
        Self {
            last,
            next,
            forward,
            backward,
            reliable,
            background: None,
            background_noise: 0.0,
        }
    }

    /// Estimates the background motion from pixels away from the expected objects.
    pub fn find_background(&mut self, expected: &[&Plane]) {
        let (width, height) = (self.next.width, self.next.height);
        let mut hidden = Region::empty(width as u32, height as u32);
        for plane in expected {
            hidden
                .inside
                .iter_mut()
                .zip(&plane.values)
                .for_each(|(hidden, &value)| *hidden |= value > 0.2);
        }
        let hidden = hidden.dilated(4.0);
        let open = |confidence: f32| -> Vec<usize> {
            (0..width * height)
                .filter(|&at| !hidden.inside[at] && self.reliable.values[at] >= confidence)
                .collect()
        };
        let mut open_places = open(0.5);
        if open_places.len() <= 200 {
            open_places = open(0.0);
        }
        if open_places.len() <= 200 {
            return;
        }
        let every = open_places.len().div_ceil(MOST_STEPS);
        let pair = |&at: &usize| {
            let from = Vec2::new((at % width) as f32, (at / width) as f32);
            PointMatch {
                from,
                to: from + self.backward.vectors[at],
            }
        };
        let matches: Vec<PointMatch> = open_places.iter().step_by(every).map(pair).collect();
        let centre = Vec2::new(width as f32, height as f32) / 2.0;
        self.background = PlaneMotion::of(&matches, centre, AGREES_PX);
        if let Some(motion) = self.background {
            let miss =
                |pair: &PointMatch| motion.displacement(pair.from).distance(pair.to - pair.from);
            self.background_noise = median(matches.iter().map(miss));
        }
    }
}

/// Cache of the latest flows of a pass.
///
/// The pass from the other side needs them again, the last one first.
#[derive(Default)]
pub(super) struct FlowCache {
    /// Maximum number of steps kept.
    most: usize,
    steps: VecDeque<KeptFlow>,
}

struct KeptFlow {
    last: Arc<TrackedImage>,
    next: Arc<TrackedImage>,
    forward: Arc<Flow>,
    backward: Arc<Flow>,
}

impl KeptFlow {
    fn of(change: &FrameChange) -> Self {
        let FrameChange {
            last,
            next,
            forward,
            backward,
            ..
        } = change;
        let [last, next] = [last, next].map(Arc::clone);
        let [forward, backward] = [forward, backward].map(Arc::clone);
        Self {
            last,
            next,
            forward,
            backward,
        }
    }

    fn reversed(self) -> FrameChange {
        FrameChange::of_flows(self.next, self.last, self.backward, self.forward)
    }
}

impl FlowCache {
    /// Creates a cache of at most this many steps.
    pub fn keeping(most: usize) -> Self {
        Self {
            most,
            steps: VecDeque::new(),
        }
    }

    /// Prepares for the pass back: kept steps stay until they are used, and none is added.
    pub fn keep_no_more(&mut self) {
        self.most = 0;
    }

    /// Measures the flow from one frame to the next.
    ///
    /// If the opposite step is in the cache, it is removed from there and reversed instead.
    pub fn change(
        &mut self,
        last: &Arc<TrackedImage>,
        next: &Arc<TrackedImage>,
        finest: Finest,
    ) -> FrameChange {
        let is_way_back =
            |step: &KeptFlow| Arc::ptr_eq(&step.last, next) && Arc::ptr_eq(&step.next, last);
        if let Some(back) = self
            .steps
            .iter()
            .rposition(is_way_back)
            .and_then(|at| self.steps.remove(at))
        {
            return back.reversed();
        }
        let change = FrameChange::new(Arc::clone(last), Arc::clone(next), finest);
        if self.most > 0 {
            if self.steps.len() == self.most {
                self.steps.pop_front();
            }
            self.steps.push_back(KeptFlow::of(&change));
        }
        change
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::Image;

    const SIDE: u32 = 48;

    fn image(shift: u32) -> Arc<TrackedImage> {
        let grain = |x: u32, y: u32| {
            (((x / 3 * 7349) ^ (y / 3 * 9151)).wrapping_mul(0x9E37_79B1) >> 24) as u8
        };
        let pixels = (0..SIDE * SIDE)
            .map(|at| [grain(at % SIDE + shift, at / SIDE); 3])
            .collect();
        let image = Image {
            width: SIDE,
            height: SIDE,
            pixels,
        };
        Arc::new(TrackedImage::new(&image, image.size()))
    }

    #[test]
    fn cached_flows_equal_measured_ones_when_reversed() {
        let frames = [0, 2, 4, 6].map(image);
        let mut flows = FlowCache::keeping(2);
        let there: Vec<FrameChange> = frames
            .windows(2)
            .map(|two| flows.change(&two[0], &two[1], Finest::Full))
            .collect();
        flows.keep_no_more();
        // In the order of a pass whose first step is not in the cache.
        for (at, is_kept) in [(0, false), (2, true), (1, true)] {
            let back = flows.change(&frames[at + 1], &frames[at], Finest::Full);
            assert_eq!(
                Arc::ptr_eq(&back.forward, &there[at].backward),
                is_kept,
                "the two latest steps are kept"
            );
            assert_eq!(Arc::ptr_eq(&back.backward, &there[at].forward), is_kept);
            let measured = FrameChange::new(
                Arc::clone(&frames[at + 1]),
                Arc::clone(&frames[at]),
                Finest::Full,
            );
            assert_eq!(
                (&back.forward, &back.backward),
                (&measured.forward, &measured.backward)
            );
            assert_eq!(back.reliable, measured.reliable);
        }
        assert!(flows.steps.is_empty());
    }
}
