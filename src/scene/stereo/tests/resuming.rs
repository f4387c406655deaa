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

    fn has(&self, frame: usize, stage: Stage) -> bool {
        self.depths.has(frame, stage)
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

/// Wherever a run is stopped, the one after it makes what is left and nothing twice, and comes to the same.
#[test]
fn a_run_goes_on_where_the_one_before_was_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<Frame> = (0..3).map(|index| frame(folder.path(), index, &grey(&pose(index)))).collect();
    let sparse = sparse(&[0, 1, 2]);
    let request =
        StereoRequest { frames: &frames, views: &[0, 1, 2], sparse: &sparse, mask: &|_, _| None, engine: &Engine::Cpu };
    let options = StereoOptions { max_side: 80, rounds: 2, ..StereoOptions::default() };
    let run = |noted: &Noted| estimate_depths(&request, &FrameStore::new(1 << 20), noted, &options, &noted.progress);
    let new = |stop_after| Noted {
        depths: MemoryDepths::default(),
        made: Mutex::default(),
        stop_after,
        progress: Progress::default(),
    };
    let whole = new(0);
    run(&whole).unwrap();
    let all = whole.made.lock().unwrap().clone();
    assert_eq!(all.len(), 15, "three views, three rounds, the filter and what others see");
    for stop_after in 1..all.len() {
        let first = new(stop_after);
        assert!(matches!(run(&first), Err(StereoError::Stopped(_) | StereoError::Scene(SceneError::Stopped(_)))));
        let second = first.going_on(0);
        run(&second).unwrap();
        assert_eq!(*second.made.lock().unwrap(), all[stop_after..], "after {stop_after}");
        for frame in 0..3 {
            let [once, twice] = [&whole, &second].map(|noted| noted.load(frame, Stage::Complete).unwrap().unwrap());
            assert!(once == twice, "frame {frame} after a stop at {stop_after}");
        }
    }
}
