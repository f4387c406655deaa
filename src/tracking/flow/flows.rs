use std::collections::VecDeque;
use std::sync::Arc;

use super::dis::Finest;
use super::motion::Change;
use super::picture::Picture;
use super::plane::Flow;

/// How pixels move between frames, of the latest steps of a walk: who comes back from the other side needs them again, the last
/// one first.
#[derive(Default)]
pub(super) struct Flows {
    /// How many steps are kept.
    most: usize,
    steps: VecDeque<Step>,
}

struct Step {
    last: Arc<Picture>,
    next: Arc<Picture>,
    forward: Arc<Flow>,
    backward: Arc<Flow>,
}

impl Step {
    fn of(change: &Change) -> Self {
        let Change {
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

    fn reversed(self) -> Change {
        Change::of_flows((self.next, self.last), self.backward, self.forward)
    }
}

impl Flows {
    /// Keeps this many steps at most.
    pub fn keeping(most: usize) -> Self {
        Self {
            most,
            steps: VecDeque::new(),
        }
    }

    /// For the way back: what is kept stays until it is asked for, and no more is.
    pub fn keep_no_more(&mut self) {
        self.most = 0;
    }

    /// From one frame to the next; measured, unless the step the other way is kept, which is given away.
    pub fn change(&mut self, last: &Arc<Picture>, next: &Arc<Picture>, finest: Finest) -> Change {
        let is_way_back =
            |step: &Step| Arc::ptr_eq(&step.last, next) && Arc::ptr_eq(&step.next, last);
        if let Some(back) = self
            .steps
            .iter()
            .rposition(is_way_back)
            .and_then(|at| self.steps.remove(at))
        {
            return back.reversed();
        }
        let change = Change::new(Arc::clone(last), Arc::clone(next), finest);
        if self.most > 0 {
            if self.steps.len() == self.most {
                self.steps.pop_front();
            }
            self.steps.push_back(Step::of(&change));
        }
        change
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::Image;

    const SIDE: u32 = 48;

    fn picture(shift: u32) -> Arc<Picture> {
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
        Arc::new(Picture::new(&image, (SIDE as usize, SIDE as usize)))
    }

    #[test]
    fn the_way_back_is_what_would_be_measured_and_is_measured_once() {
        let frames = [0, 2, 4, 6].map(picture);
        let mut flows = Flows::keeping(2);
        let there: Vec<Change> = frames
            .windows(2)
            .map(|two| flows.change(&two[0], &two[1], Finest::Full))
            .collect();
        flows.keep_no_more();
        // In the order of a walk that first comes to a step that is not kept.
        for (at, is_kept) in [(0, false), (2, true), (1, true)] {
            let back = flows.change(&frames[at + 1], &frames[at], Finest::Full);
            assert_eq!(
                Arc::ptr_eq(&back.forward, &there[at].backward),
                is_kept,
                "the two latest steps are kept"
            );
            assert_eq!(Arc::ptr_eq(&back.backward, &there[at].forward), is_kept);
            let measured = Change::new(
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
