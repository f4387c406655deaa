//! Time that the processor needs to draw the window of a project with 30, 300 and 3,000 frames.
//!
//! `cargo bench --bench window [FRAMES…]` prints the milliseconds per drawing of a window at rest, of
//! one that goes to the next frame, and of one after an edit of a mask, without the work of the
//! graphics card. Each frame has a mask with nine labels, and every tenth is a keyframe.

#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "a bench prints its table and may panic"
)]

#[path = "../gui/desk.rs"]
#[expect(dead_code, reason = "the tests of the window use the rest")]
mod desk;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use egui_kittest::Harness;
use ostra_frames::{ImageSource, Orientation};
use ostra_masks::{Label, LabelId, LabelMask, LabelTree, RunMask};
use ostra_project::{FrameMask, MaskOrigin};

use desk::Desk;

/// Drawings per measurement.
const DRAWINGS: u32 = 100;
const LABELS: u16 = 9;

fn main() {
    let given: Vec<usize> = std::env::args()
        .filter_map(|word| word.parse().ok())
        .collect();
    let counts = if given.is_empty() {
        vec![30, 300, 3000]
    } else {
        given
    };
    println!("frames   at rest   next frame   after an edit   (ms per drawing)");
    for count in counts {
        bench(count);
    }
}

fn bench(count: usize) {
    let mut harness = Harness::builder()
        .with_size([1440.0, 900.0])
        .build_ui_state(|ui, desk: &mut Desk| desk.draw(ui), of_frames(count));
    harness.run_steps(10);
    let mut time = |change: &dyn Fn(&mut Desk)| {
        let begun = Instant::now();
        for _ in 0..DRAWINGS {
            change(harness.state_mut());
            harness.step();
        }
        begun.elapsed().as_secs_f64() * 1000.0 / f64::from(DRAWINGS)
    };
    let at_rest = time(&|_| {});
    let next = time(&|desk| {
        let next = (desk.shell.view.frame + 1) % count;
        desk.shell.view.go_to(next);
    });
    let edited = time(&|desk| {
        let frame = desk.shell.view.frame;
        desk.project.masks.get_mut(&frame).unwrap().stale ^= true;
        desk.revision += 1;
    });
    println!("{count:6} {at_rest:9.2} {next:12.2} {edited:15.2}");
}

/// Returns a desk with this number of frames, each of which has a mask.
fn of_frames(count: usize) -> Desk {
    let mut desk = Desk::sample();
    let frame = |number: usize| {
        let mut frame = desk.project.frames[number % desk.project.frames.len()].clone();
        frame.name = format!("{number:05}.png");
        frame.image = ImageSource::File {
            path: format!("/{number:05}.png").into(),
            orientation: Orientation(1),
        };
        frame
    };
    let frames = (0..count).map(frame).collect();
    let mut tree = LabelTree::default();
    for id in 1..=LABELS {
        let id = LabelId(id);
        tree.set(Label {
            id,
            name: format!("organ {}", id.0),
            color: LabelTree::color_for(id),
            parent: None,
        })
        .unwrap();
    }
    desk.project.frames = Arc::new(frames);
    desk.project.labels = tree;
    desk.project.masks = (0..count).map(|number| (number, mask(number))).collect();
    desk.revision = 1;
    desk
}

/// Returns a mask of columns, one per label.
fn mask(number: usize) -> FrameMask {
    let mut mask = LabelMask::empty(desk::WIDTH, desk::HEIGHT);
    for (at, id) in mask.ids.iter_mut().enumerate() {
        let column = (at as u32 % desk::WIDTH) as u16 / 6;
        *id = LabelId(if column < LABELS { column + 1 } else { 0 });
    }
    let is_keyframe = number.is_multiple_of(10);
    let confidence = (1..=LABELS).map(|id| (LabelId(id), 0.9));
    FrameMask {
        runs: Arc::new(RunMask::encode(&mask)),
        origin: if is_keyframe {
            MaskOrigin::Keyframe
        } else {
            MaskOrigin::Tracked
        },
        stale: false,
        confidence: if is_keyframe {
            BTreeMap::new()
        } else {
            confidence.collect()
        },
    }
}
