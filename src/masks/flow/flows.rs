use std::collections::VecDeque;
use std::sync::Arc;

use super::dis::Finest;
use super::picture::Picture;
use super::walk::Change;

/// How pixels move between frames, of the latest steps: who comes back from the other side needs them again, the last one
/// first.
#[derive(Default)]
pub(super) struct Flows {
    /// How many steps are kept.
    most: usize,
    steps: VecDeque<Change>,
}

impl Flows {
    /// Keeps this many steps at most.
    pub fn keeping(most: usize) -> Self {
        Self { most, steps: VecDeque::new() }
    }

    /// From one frame to the next; measured, unless the step the other way is kept.
    pub fn change(&mut self, last: &Arc<Picture>, next: &Arc<Picture>, finest: Finest) -> Change {
        let is_way_back = |step: &Change| Arc::ptr_eq(&step.last, next) && Arc::ptr_eq(&step.next, last);
        if let Some(back) = self.steps.iter().rposition(is_way_back).and_then(|at| self.steps.remove(at)) {
            return back.reversed();
        }
        let change = Change::new(Arc::clone(last), Arc::clone(next), finest);
        if self.steps.len() == self.most {
            self.steps.pop_front();
        }
        if self.most > 0 {
            self.steps.push_back(change.clone());
        }
        change
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Image;

    const SIDE: u32 = 48;

    fn picture(shift: u32) -> Arc<Picture> {
        let grain = |x: u32, y: u32| (((x / 3 * 7349) ^ (y / 3 * 9151)).wrapping_mul(0x9E37_79B1) >> 24) as u8;
        let pixels = (0..SIDE * SIDE).map(|at| [grain(at % SIDE + shift, at / SIDE); 3]).collect();
        let image = Image { width: SIDE, height: SIDE, pixels };
        Arc::new(Picture::new(&image, (SIDE as usize, SIDE as usize)))
    }

    #[test]
    fn the_way_back_is_what_would_be_measured_and_is_measured_once() {
        let frames = [0, 2, 4].map(picture);
        let mut flows = Flows::keeping(1);
        let there: Vec<Change> = frames.windows(2).map(|two| flows.change(&two[0], &two[1], Finest::Full)).collect();
        for (at, is_kept) in [(1, true), (0, false)] {
            let back = flows.change(&frames[at + 1], &frames[at], Finest::Full);
            assert_eq!(Arc::ptr_eq(&back.forward, &there[at].backward), is_kept, "only the latest step is kept");
            assert_eq!(Arc::ptr_eq(&back.backward, &there[at].forward), is_kept);
            let measured = Change::new(Arc::clone(&frames[at + 1]), Arc::clone(&frames[at]), Finest::Full);
            assert_eq!((&back.forward, &back.backward), (&measured.forward, &measured.backward));
            assert_eq!(back.reliable, measured.reliable);
        }
    }
}
