//! What `auto` chooses for clicks on recordings, compared with its two choices.
//!
//! Every second frame is for choosing its rules, the others are for checking them. The floors hold
//! for both halves.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use ostra_core::job::Progress;
use ostra_eval::simulated_click::next_click;
use ostra_eval::synthetic::{Scene, SceneKind, SceneOptions};
use ostra_frames::{Frame, FrameFolder, FrameStore, OpenRequest};
use ostra_masks::{
    LabelId, LabelMask, Prompt, Region, SegmentRequest, Segmenter, read_palette_png,
};
use ostra_project::SegmenterId;
use ostra_session::{Command, NewProject, PreparedFrames, Session, engines};

use crate::data::data_dir;
use crate::session::perform;
use crate::shelf::new_project;

/// Number of clicks per object.
const CLICKS: usize = 2;
/// Minimum area of an object, pixels.
const LEAST_PX: usize = 400;
const COMPARED: [SegmenterId; 3] = [
    SegmenterId::Builtin,
    SegmenterId::Geometry,
    SegmenterId::Auto,
];

/// Mean IoU after two clicks by each of [`COMPARED`], in both halves.
type HalfIous = [[f64; 3]; 2];

/// Returns the IoU of an object after the clicks of the simulated user, and the seconds for
/// preparing the frame and for a click.
fn clicked(
    segmenter: &dyn Segmenter,
    prepared: &PreparedFrames,
    (frame, store): (&Frame, &FrameStore),
    truth: &Region,
) -> (f64, [f64; 2]) {
    let begun = Instant::now();
    let ready = prepared
        .get(segmenter, frame, store, &Progress::default())
        .unwrap();
    let preparing = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let mut prompt = Prompt::default();
    let mut answer = Region::empty(truth.width, truth.height);
    for _ in 0..CLICKS {
        let Some(click) = next_click(truth, &answer) else {
            break;
        };
        prompt.clicks.push(click);
        let request = SegmentRequest {
            prompt: &prompt,
            previous: (prompt.clicks.len() > 1).then_some(&answer),
            taken: None,
        };
        answer = ready.segment(&request, &Progress::default()).unwrap();
    }
    let clicking = begun.elapsed().as_secs_f64() / CLICKS as f64;
    (truth.iou(&answer), [preparing, clicking])
}

/// Clicks every object on some frames of a project, and returns the means.
fn compare(name: &str, new: Command, every: usize, truth: impl Fn(usize) -> LabelMask) -> HalfIous {
    let mut session = Session::new();
    perform(&mut session, new).unwrap();
    let frames = Arc::clone(&session.project().unwrap().frames);
    let store = Arc::new(FrameStore::new(256 << 20));
    let geometry = engines::geometry_segmenter(Arc::clone(&frames), Arc::clone(&store));
    let prepared = PreparedFrames::new(512 << 20);
    let (mut sums, mut counts) = ([[0.0; 3]; 2], [0.0; 2]);
    let mut seconds = [[0.0; 2]; 3];
    for (number, at) in (0..frames.len()).step_by(every).enumerate() {
        let (half, mask) = (number % 2, truth(at));
        let mut ids = mask.ids.clone();
        ids.sort_unstable();
        ids.dedup();
        for id in ids.into_iter().filter(|&id| id != LabelId::NONE) {
            let object = mask.region(id);
            if object.area() < LEAST_PX {
                continue;
            }
            counts[half] += 1.0;
            let mut ious = [0.0; 3];
            for (which, id) in COMPARED.into_iter().enumerate() {
                let segmenter = engines::click_segmenter(id, Arc::clone(&geometry)).unwrap();
                let (iou, [preparing, clicking]) =
                    clicked(&*segmenter, &prepared, (&frames[at], &store), &object);
                ious[which] = iou;
                seconds[which][0] += preparing;
                seconds[which][1] += clicking;
            }
            println!("{name} frame {at} object {}: {ious:.3?}", id.0);
            for (sum, iou) in sums[half].iter_mut().zip(ious) {
                *sum += iou;
            }
        }
    }
    let clicks = counts[0] + counts[1];
    println!(
        "{name}, builtin, geometry, auto: seconds for preparing all frames and for a click {:.2?}",
        seconds.map(|[preparing, clicking]| [preparing, clicking / clicks])
    );
    for (sums, count) in sums.iter_mut().zip(counts) {
        sums.iter_mut().for_each(|sum| *sum /= count);
    }
    println!(
        "{name}, builtin, geometry, auto: tuned {:.3?}, checked {:.3?}",
        sums[0], sums[1]
    );
    sums
}

/// Renders a scene with the noise of a sensor and clicks its objects on every third frame.
fn rendered(name: &str, scene: SceneKind) -> HalfIous {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("recording");
    let options = SceneOptions {
        scene,
        views: 12,
        noise: Some(ostra_eval::synthetic::SensorNoise::default()),
        ..SceneOptions::default()
    };
    std::fs::create_dir_all(&recording).unwrap();
    let scene = Scene::build(&options).unwrap();
    scene.write(&recording, &Progress::default()).unwrap();
    let names: Vec<String> = scene.views().iter().map(|view| view.name.clone()).collect();
    let open = OpenRequest {
        sources: vec![FrameFolder {
            frames: recording.join("color"),
            depth: Some(recording.join("depth")),
        }],
        depth_unit: Scene::DEPTH_UNIT_M,
        ..OpenRequest::default()
    };
    let new = Command::New(NewProject {
        root: folder.path().join("project"),
        open,
        cameras: Some(recording.join("sparse")),
        intrinsics: None,
    });
    compare(name, new, 3, |at| {
        let file = Path::new(&names[at]).with_extension("png");
        read_palette_png(&recording.join("truth/masks").join(file)).unwrap()
    })
}

/// Checks that the choice is as good as always taking the better of the two, within 0.02.
fn assert_chosen_well(ious: HalfIous) {
    for [builtin, geometry, auto] in ious {
        assert!(
            auto >= builtin.max(geometry) - 0.02,
            "builtin {builtin}, geometry {geometry}, auto {auto}"
        );
    }
}

fn auto_takes_geometry_for_things_on_a_shelf() {
    let (data, folder) = (data_dir(), tempfile::tempdir().unwrap());
    let labels = data.join("apc_shelf_rgbd_labels/labels");
    let new = new_project(&data, &folder.path().join("shelf"));
    let ious = compare("shelf", new, 2, |at| {
        read_palette_png(&labels.join(format!("{at:06}.png"))).unwrap()
    });
    assert_chosen_well(ious);
}

fn auto_is_not_worse_on_rendered_organs() {
    assert_chosen_well(rendered("tiller", SceneKind::Tiller));
}

fn auto_is_not_worse_on_rendered_bricks() {
    assert_chosen_well(rendered("bricks", SceneKind::Bricks));
}

crate::registry::tests! {
    Nothing => auto_is_not_worse_on_rendered_organs, auto_is_not_worse_on_rendered_bricks;
    Data(&["apc_shelf_rgbd_labels"]) => auto_takes_geometry_for_things_on_a_shelf;
}
