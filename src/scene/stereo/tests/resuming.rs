use std::sync::{Arc, Mutex};

use super::wall::{frame, grey, pose, sparse};
use crate::engine::job::Progress;
use crate::frames::{Frame, FrameStore};
use crate::scene::SceneError;
use crate::scene::stereo::{
    DepthEstimate, DepthStore, Engine, MemoryDepths, Stage, StereoError, StereoOptions, StereoRequest, estimate_depths,
};

/// Notes what is made, and asks for a stop after so many.
struct Noted {
    depths: MemoryDepths,
    made: Mutex<Vec<(usize, Stage)>>,
    stop_after: usize,
    progress: Progress,
}

impl Noted {
    fn going_on(self, stop_after: usize) -> Self {
        Self { made: Mutex::default(), stop_after, progress: Progress::default(), ..self }
    }
}

impl DepthStore for Noted {
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        self.depths.load(frame, stage)
    }

    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError> {
        let mut made = self.made.lock().unwrap();
        made.push((frame, stage));
        if made.len() == self.stop_after {
            self.progress.stop();
        }
        self.depths.save(frame, stage, estimate)
    }

    fn forget(&self, stage: Stage) -> Result<(), SceneError> {
        self.depths.forget(stage)
    }
}

/// Wherever a run is stopped, the one after it makes what is left and nothing twice, and comes to the same, however many
/// views each of them works on at once.
#[test]
fn a_run_goes_on_where_the_one_before_was_stopped() {
    let [one_by_one, at_once, _] = [(1, 1), (3, 3), (3, 1)].map(|threads| stopped_everywhere(threads.0, threads.1));
    assert!(one_by_one == at_once, "views at once come to the same");
}

/// The depths of three views, made in runs that are stopped and gone on with, which work on so many views at once.
fn stopped_everywhere(stopped_at_once: usize, then_at_once: usize) -> Vec<Arc<DepthEstimate>> {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<Frame> = (0..3).map(|index| frame(folder.path(), index, &grey(&pose(index)))).collect();
    let sparse = sparse(&[0, 1, 2]);
    let request =
        StereoRequest { frames: &frames, views: &[0, 1, 2], sparse: &sparse, mask: &|_, _| None, engine: &Engine::Cpu };
    let options = StereoOptions { max_side: 80, rounds: 2, ..StereoOptions::default() };
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let (stopped, then) = (pool(stopped_at_once), pool(then_at_once));
    let run = |pool: &rayon::ThreadPool, noted: &Noted| {
        pool.install(|| estimate_depths(&request, &FrameStore::new(1 << 20), noted, &options, &noted.progress))
    };
    let new = |stop_after| Noted {
        depths: MemoryDepths::default(),
        made: Mutex::default(),
        stop_after,
        progress: Progress::default(),
    };
    let whole = new(0);
    run(&stopped, &whole).unwrap();
    let all = whole.made.lock().unwrap().clone();
    assert_eq!(all.len(), 15, "three views, three rounds, the filter and what others see");
    for stop_after in 1..=all.len() {
        let first = new(stop_after);
        let outcome = run(&stopped, &first);
        assert!(matches!(outcome, Err(StereoError::Stopped(_) | StereoError::Scene(SceneError::Stopped(_)))));
        let kept = first.made.lock().unwrap().clone();
        // What was still worked on may have come to its end.
        assert!((stop_after..stop_after + stopped_at_once).contains(&kept.len()), "{kept:?} after {stop_after}");
        let second = first.going_on(0);
        run(&then, &second).unwrap();
        let mut both = [kept, second.made.lock().unwrap().clone()].concat();
        both.sort_by_key(|&(frame, stage)| (stage, frame));
        assert_eq!(both, all, "after {stop_after}");
        for frame in 0..3 {
            let [once, twice] = [&whole, &second].map(|noted| noted.load(frame, Stage::Complete).unwrap().unwrap());
            assert!(once == twice, "frame {frame} after a stop at {stop_after}");
        }
    }
    (0..3).map(|frame| whole.load(frame, Stage::Complete).unwrap().unwrap()).collect()
}
