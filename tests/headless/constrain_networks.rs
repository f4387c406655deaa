//! XMem and DeAOT with the geometric consistency check on a synthetic recording.
//!
//! The networks are small and have random weights, so their own results are wrong nearly
//! everywhere: correct results come from geometry.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex};

use ostra_compute::nn::{Network, Runtime};
use ostra_core::job::Progress;
use ostra_eval::mask_score::{FramePair, score_pairs};
use ostra_eval::synthetic::{Scene, SceneOptions};
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_masks::{Direction, LabelMask, MaskError, RunMask, TrackRequest, TrackedFrame, Tracker};
use ostra_session::{Command, NewProject, Session};
use ostra_tracking::deaot::Deaot;
use ostra_tracking::xmem::XMem;
use ostra_tracking::{
    geometric_consistency::{ConsistencyOptions, ConsistencyTracker},
    reprojection::GeometryTracker,
};

use crate::session::perform;

/// A plant seen from 8 places, with depth, cameras and ground-truth masks of its classes.
struct Recording {
    session: Session,
    truth: Vec<Arc<LabelMask>>,
    _folder: tempfile::TempDir,
}

/// Keyframe, whose ground-truth mask is given.
const KEYFRAME: usize = 0;

impl Recording {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let options = SceneOptions {
            views: 8,
            width: 180,
            height: 240,
            arc_deg: 40.0,
            ..SceneOptions::default()
        };
        let scene = Scene::build(&options).unwrap();
        scene.write(folder.path(), &Progress::default()).unwrap();
        let class = |view| {
            Arc::new(
                scene
                    .render_exact(view)
                    .mask
                    .at_level(scene.tree(), Scene::CLASS_LEVEL),
            )
        };
        let truth = scene.views().iter().map(class).collect();
        let path = |part: &str| folder.path().join(part);
        let sources = vec![FrameFolder {
            frames: path("color"),
            depth: Some(path("depth")),
        }];
        let open = OpenRequest {
            sources,
            depth_unit: Scene::DEPTH_UNIT_M,
            ..OpenRequest::default()
        };
        let new = NewProject {
            root: path("project"),
            open,
            cameras: Some(path("sparse")),
            intrinsics: None,
        };
        let mut session = Session::new();
        perform(&mut session, Command::New(new)).unwrap();
        Self {
            session,
            truth,
            _folder: folder,
        }
    }

    fn request(&self) -> TrackRequest {
        TrackRequest {
            frames: Arc::clone(&self.session.project().unwrap().frames),
            store: Arc::clone(self.session.store()),
            keyframes: BTreeMap::from([(KEYFRAME, Arc::clone(&self.truth[KEYFRAME]))]),
            from: 0,
            to: self.truth.len() - 1,
            direction: Direction::Both,
            labels: None,
        }
    }

    /// Returns the mean IoU over the frames without the keyframe, and the tracker's report.
    fn tracked(&self, tracker: &dyn Tracker) -> (f64, String) {
        let mut masks = BTreeMap::new();
        let mut take = |tracked: TrackedFrame| drop(masks.insert(tracked.frame, tracked.mask));
        let reported = tracker
            .track(&self.request(), &mut take, &Progress::default())
            .unwrap();
        assert_eq!(masks.len(), self.truth.len() - 1);
        let pair = |(frame, result): (usize, LabelMask)| {
            let truth = RunMask::encode(&self.truth[frame]);
            FramePair {
                name: frame.to_string(),
                truth,
                result: RunMask::encode(&result),
            }
        };
        let pairs: Vec<FramePair> = masks.into_iter().map(pair).collect();
        let labels: BTreeSet<_> = self.truth[KEYFRAME]
            .ids
            .iter()
            .copied()
            .filter(|id| id.0 > 0)
            .collect();
        assert_eq!(labels.len(), 3);
        (
            score_pairs(&pairs, &labels, &Progress::default())
                .unwrap()
                .j,
            reported.join("\n"),
        )
    }
}

/// A tracker that records the frames each of its runs starts from.
struct Noting<T> {
    tracker: Arc<T>,
    begun: Arc<Mutex<Vec<Vec<usize>>>>,
}

impl<T: Tracker> Tracker for Noting<T> {
    fn name(&self) -> &'static str {
        self.tracker.name()
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        self.begun
            .lock()
            .unwrap()
            .push(request.keyframes.keys().copied().collect());
        self.tracker.track(request, emit, progress)
    }
}

/// Loads the networks of a folder of fixtures.
fn networks<const N: usize>(name: &str, parts: [&str; N]) -> [Network; N] {
    let runtime = Runtime::find().unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/parity")
        .join(name);
    let load = |part: &str| {
        Network::load(&runtime, &folder.join(format!("{name}-{part}.onnx")), None).unwrap()
    };
    parts.map(load)
}

fn gains_by_geometry<T: Tracker + 'static>(tracker: T) {
    let recording = Recording::new();
    let (tracker, begun) = (Arc::new(tracker), Arc::new(Mutex::new(Vec::new())));
    let (free, _) = recording.tracked(&*tracker);
    let noting = Noting {
        tracker: Arc::clone(&tracker),
        begun: Arc::clone(&begun),
    };
    let options = ConsistencyOptions {
        rest: 2,
        ..ConsistencyOptions::default()
    };
    let constrained = ConsistencyTracker {
        tracker: Box::new(noting),
        options,
    };
    assert_eq!(constrained.name(), tracker.name());
    let (held, reported) = recording.tracked(&constrained);
    let (geometry, _) = recording.tracked(&GeometryTracker::default());
    let begun = begun.lock().unwrap().clone();
    println!(
        "{}: J {free:.3}, constrained {held:.3}, geometry {geometry:.3}; from {begun:?}\n{reported}",
        tracker.name()
    );
    assert!(free < 0.3, "random weights know nothing: J {free:.3}");
    // Where geometry has no evidence, as in regions no keyframe sees, the tracker's result stays.
    assert!(
        held > free + 0.4 && held > 0.6 * geometry,
        "J {free:.3}, constrained {held:.3}, geometry {geometry:.3}"
    );
    assert!(
        reported.contains("geometry corrected")
            && reported.contains("were restarted in the tracker on"),
        "{reported}"
    );
    // The first run starts from the keyframe; each further run starts from one more corrected mask.
    assert_eq!(begun[0], [KEYFRAME]);
    assert!(begun.len() > 1, "{begun:?}");
    for (number, keyframes) in begun.iter().enumerate() {
        assert_eq!(keyframes.len(), number + 1, "{begun:?}");
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn xmem_improves_with_geometry_and_restarts_from_corrected_masks() {
    let parts = ["key-encoder", "value-encoder", "decoder"];
    let networks = networks("xmem-tiny", parts);
    let mut xmem = XMem::new(networks).unwrap();
    xmem.options.short_side = None;
    gains_by_geometry(xmem);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn deaot_improves_with_geometry_and_restarts_from_corrected_masks() {
    let parts = ["encoder", "remember", "propagate", "identify"];
    let networks = networks("deaot-tiny", parts);
    gains_by_geometry(Deaot::new(networks).unwrap());
}
