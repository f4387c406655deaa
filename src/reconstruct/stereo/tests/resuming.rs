use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use super::wall::{frame, grey, pose, sparse};
use crate::stereo::{
    DepthEstimate, DepthStore, InMemoryDepthStore, RasterMask, Stage, StereoEngine, StereoError,
    StereoOptions, StereoRequest, estimate_depths,
};
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameError, FrameStore};
use ostra_geometry::Camera;

/// Records what is computed, and requests a stop after so many.
#[derive(Default)]
struct Noted {
    depths: InMemoryDepthStore,
    made: Mutex<Vec<(usize, Stage)>>,
    stop_after: usize,
    progress: Progress,
    /// What cannot be read until it is computed again.
    damaged: Mutex<Option<(usize, Stage)>>,
}

impl Noted {
    fn stopping_after(stop_after: usize) -> Self {
        Self {
            stop_after,
            ..Self::default()
        }
    }

    /// Starts another run with the results stored so far.
    fn going_on(self) -> Self {
        Self {
            depths: self.depths,
            damaged: self.damaged,
            ..Self::default()
        }
    }

    fn made(&self) -> Vec<(usize, Stage)> {
        self.made.lock().unwrap().clone()
    }

    fn complete(&self) -> Vec<Arc<DepthEstimate>> {
        (0..3)
            .map(|frame| self.load(frame, Stage::Complete).unwrap().unwrap())
            .collect()
    }
}

impl DepthStore for Noted {
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        match (*self.damaged.lock().unwrap() == Some((frame, stage)), stage) {
            (true, Stage::Complete) => Err(FrameError::Invalid {
                path: "depth".into(),
                what: "is damaged".into(),
            }
            .into()),
            (true, _) => Ok(None),
            (false, _) => self.depths.load(frame, stage),
        }
    }

    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError> {
        let mut made = self.made.lock().unwrap();
        made.push((frame, stage));
        if made.len() == self.stop_after {
            self.progress.stop();
        }
        self.damaged
            .lock()
            .unwrap()
            .take_if(|damaged| *damaged == (frame, stage));
        self.depths.save(frame, stage, estimate)
    }

    fn forget(&self, stage: Stage) -> Result<(), SceneError> {
        self.depths.forget(stage)
    }
}

/// Three images of the wall.
struct Wall {
    _folder: tempfile::TempDir,
    frames: Vec<Frame>,
}

impl Wall {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let frames = (0..3)
            .map(|index| frame(folder.path(), index, &grey(&pose(index))))
            .collect();
        Self {
            _folder: folder,
            frames,
        }
    }

    /// Runs stereo with this many views at once, as with this many rayon threads.
    fn run(&self, at_once: usize, noted: &Noted) -> Result<(), StereoError> {
        self.run_with(at_once, noted, &|_, _| None)
    }

    fn run_with(
        &self,
        at_once: usize,
        noted: &Noted,
        mask: RasterMask<'_>,
    ) -> Result<(), StereoError> {
        let sparse = sparse(&[0, 1, 2]);
        let request = StereoRequest {
            frames: &self.frames,
            views: &[0, 1, 2],
            sparse: &sparse,
            mask,
            engine: &StereoEngine::Cpu,
        };
        let options = StereoOptions {
            max_side: 80,
            rounds: 2,
            ..StereoOptions::default()
        };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(at_once)
            .build()
            .unwrap();
        let run = || {
            estimate_depths(
                &request,
                &FrameStore::new(1 << 20),
                noted,
                &options,
                &noted.progress,
            )
        };
        pool.install(run).map(|_| ())
    }
}

/// After a stop at any point, the next run computes the rest and nothing twice, with the same
/// result for any number of views at once.
#[test]
fn run_resumes_where_the_previous_one_stopped() {
    let wall = Wall::new();
    let whole = Noted::default();
    wall.run(1, &whole).unwrap();
    let all = whole.made();
    assert_eq!(
        all.len(),
        15,
        "three views, three rounds, the filter and what others see"
    );
    let searches = all
        .iter()
        .filter(|(_, stage)| matches!(stage, Stage::Round(_)))
        .count();
    for (first_at_once, then_at_once) in [(1, 1), (3, 3), (3, 1), (1, 3)] {
        for stop_after in 1..=all.len() {
            let first = Noted::stopping_after(stop_after);
            let outcome = wall.run(first_at_once, &first);
            assert!(matches!(
                outcome,
                Err(StereoError::Stopped(_) | StereoError::Scene(SceneError::Stopped(_)))
            ));
            let kept = first.made();
            // A running search may stop or finish; the steps after the searches finish.
            let most = stop_after.next_multiple_of(first_at_once);
            let least = if stop_after > searches {
                most
            } else {
                stop_after
            };
            assert!(
                (least..=most).contains(&kept.len()),
                "{kept:?} after {stop_after}"
            );
            let second = first.going_on();
            wall.run(then_at_once, &second).unwrap();
            let mut both = [kept, second.made()].concat();
            both.sort_by_key(|&(frame, stage)| (stage, frame));
            assert_eq!(both, all, "after {stop_after}");
            assert!(
                second.complete() == whole.complete(),
                "after a stop at {stop_after}"
            );
        }
    }
}

/// Damages the last result before a stop, one from long before, or a final result of a complete run.
#[test]
fn damaged_results_are_computed_again() {
    let wall = Wall::new();
    let whole = Noted::default();
    wall.run(1, &whole).unwrap();
    let all = [
        Stage::Round(0),
        Stage::Round(1),
        Stage::Round(2),
        Stage::Filtered,
        Stage::Complete,
    ];
    for (stop_after, frame, damaged, again) in [
        (3, 2, Stage::Round(0), &all[..]),
        (4, 0, Stage::Round(0), &all[2..]),
        (9, 2, Stage::Round(2), &all[2..]),
        (12, 2, Stage::Filtered, &all[3..]),
        (15, 2, Stage::Complete, &all[4..]),
        (0, 2, Stage::Complete, &all[..]),
    ] {
        let first = Noted::stopping_after(stop_after);
        assert_eq!(wall.run(1, &first).is_ok(), stop_after == 0);
        let kept = first.made();
        let second = first.going_on();
        *second.damaged.lock().unwrap() = Some((frame, damaged));
        wall.run(1, &second).unwrap();
        let is_left = |of: &(usize, Stage)| {
            if of.0 == frame {
                again.contains(&of.1)
            } else {
                !kept.contains(of)
            }
        };
        let left: Vec<_> = whole.made().into_iter().filter(is_left).collect();
        assert_eq!(second.made(), left, "{damaged:?} after {stop_after}");
        let is_near =
            |(once, twice): (&f32, &f32)| *twice > 0.0 && (once / twice - 1.0).abs() < 0.01;
        for (once, twice) in whole.complete().iter().zip(&second.complete()) {
            let known = once
                .depths
                .iter()
                .zip(&twice.depths)
                .filter(|(once, _)| **once > 0.0);
            let (near, known) = (
                known.clone().filter(|&pair| is_near(pair)).count(),
                known.count(),
            );
            assert!(
                known > 2000 && near * 20 > known * 19,
                "{near} of {known} after {stop_after}"
            );
        }
    }
}

/// In the mask callback of each view, it waits a moment for one more view than may run.
#[test]
fn as_many_views_run_at_once_as_there_are_threads() {
    let wall = Wall::new();
    for at_once in [1, 2, 3] {
        let (within, most) = (Mutex::new(0), Mutex::new(0));
        let came = Condvar::new();
        let mask = |_: usize, _: &Camera| {
            let mut inside = within.lock().unwrap();
            *inside += 1;
            let mut seen = most.lock().unwrap();
            *seen = (*seen).max(*inside);
            drop(seen);
            came.notify_all();
            let moment = Duration::from_millis(100);
            let (mut inside, _) = came
                .wait_timeout_while(inside, moment, |_| *most.lock().unwrap() <= at_once)
                .unwrap();
            *inside -= 1;
            None
        };
        wall.run_with(at_once, &Noted::default(), &mask).unwrap();
        assert_eq!(*most.lock().unwrap(), at_once);
    }
}
