//! Two children on a bed, one often behind the other, tracked through a video with six corrections.
//!
//! Clicks, outlines and the checked points were set by hand and are stored in `bedroom.json`.

use std::collections::BTreeMap;
use std::path::Path;

use ostra_masks::{LabelId, read_palette_png};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::data::data_dir;
use crate::program::done;

const LABELS: [&str; 2] = ["girl", "boy"];
const BOY: u16 = 2;

#[derive(Deserialize)]
struct Script {
    /// Clicks on the first frame, by label.
    clicks: BTreeMap<String, Clicks>,
    corrections: Vec<Correction>,
    /// Pixels by frame and by what they show: `girl`, `boy` or `neither`.
    points: BTreeMap<usize, BTreeMap<String, Vec<[usize; 2]>>>,
}

#[derive(Deserialize)]
struct Clicks {
    include: Vec<[u32; 2]>,
    exclude: Vec<[u32; 2]>,
}

/// New outlines of the boy on a frame.
#[derive(Deserialize)]
struct Correction {
    frame: usize,
    polygons: Vec<Vec<[u32; 2]>>,
}

fn click(project: &str, label: &str, clicks: &Clicks) {
    let mut args: Vec<String> = [
        "prompt",
        project,
        "--frame",
        "0",
        "--label",
        label,
        "--segmenter",
        "builtin",
    ]
    .map(String::from)
    .to_vec();
    for (option, places) in [("--click", &clicks.include), ("--not", &clicks.exclude)] {
        args.extend(
            places
                .iter()
                .flat_map(|[x, y]| [option.to_owned(), format!("{x},{y}")]),
        );
    }
    done(&args.iter().map(String::as_str).collect::<Vec<_>>());
}

/// Removes the boy from a frame, paints him, and tracks him again up to the next keyframes.
fn correct(project: &str, recipe: &Path, Correction { frame, polygons }: &Correction) {
    let paint = |points: &Value, erase: bool| json!({"paint": {"frame": frame, "label": BOY, "points_px": points, "radius_px": 0, "erase": erase, "replace": !erase}});
    let mut commands = vec![
        json!({"open": project}),
        paint(&json!([[0, 0], [960, 0], [960, 540], [0, 540]]), true),
    ];
    commands.extend(polygons.iter().map(|polygon| paint(&json!(polygon), false)));
    std::fs::write(
        recipe,
        json!({"format": 1, "commands": commands}).to_string(),
    )
    .unwrap();
    done(&["run", recipe.to_str().unwrap()]);
    done(&[
        "track",
        project,
        "--tracker",
        "flow",
        "--label",
        "boy",
        "--around",
        &frame.to_string(),
        "--replace",
    ]);
}

/// Counts of checked points: all, those with the right label, and those with another child's label.
#[derive(Debug, Default, Clone, Copy)]
struct Count {
    all: usize,
    found: usize,
    taken: usize,
}

impl Count {
    fn found(&self) -> f64 {
        self.found as f64 / self.all as f64
    }

    fn taken(&self) -> f64 {
        self.taken as f64 / self.all as f64
    }
}

/// Returns the counts over the frames that were not labelled by hand.
fn counts(project: &Path, script: &Script) -> BTreeMap<String, Count> {
    let mut counts: BTreeMap<String, Count> = BTreeMap::new();
    let by_hand = |frame: usize| {
        frame == 0
            || script
                .corrections
                .iter()
                .any(|correction| correction.frame == frame)
    };
    for (frame, points) in script.points.iter().filter(|(frame, _)| !by_hand(**frame)) {
        let mask =
            read_palette_png(&project.join(format!("masks/bedroom/{frame:05}.png"))).unwrap();
        for (what, points) in points {
            let id = LABELS
                .iter()
                .position(|label| label == what)
                .map_or(LabelId::NONE, |at| LabelId(at as u16 + 1));
            let count = counts.entry(what.clone()).or_default();
            for &[x, y] in points {
                let is = mask.ids[y * mask.width as usize + x];
                count.all += 1;
                count.found += usize::from(is == id);
                count.taken += usize::from(is != id && is != LabelId::NONE);
            }
        }
    }
    counts
}

fn two_children_are_kept_apart_with_six_corrections() {
    let data = data_dir();
    let script: Script = serde_json::from_str(include_str!("bedroom.json")).unwrap();
    assert_eq!(script.corrections.len(), 6);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("children");
    let project = path.to_str().unwrap();
    let frames = data.join("sam2_bedroom/JPEGImages");
    done(&["new", project, "--frames", frames.to_str().unwrap()]);
    for label in LABELS {
        done(&["label", project, label]);
    }
    for label in LABELS {
        click(project, label, &script.clicks[label]);
    }
    done(&["track", project, "--tracker", "flow"]);
    let before = counts(&path, &script);
    for correction in &script.corrections {
        correct(project, &folder.path().join("recipe.json"), correction);
    }
    done(&["track", project, "--tracker", "flow", "--label", "girl"]);
    let after = counts(&path, &script);
    println!("before {before:?}\nafter {after:?}");
    assert!(after["girl"].found() >= 0.97 && after["girl"].taken() <= 0.01);
    assert!(after["boy"].found() >= 0.82 && after["boy"].taken() <= 0.1);
    assert!(after["neither"].found() >= 0.93);
    assert!(
        after["boy"].found() >= before["boy"].found() + 0.3,
        "corrections are carried on"
    );
}

crate::registry::tests! {
    Data(&["sam2_bedroom"]) => two_children_are_kept_apart_with_six_corrections;
}
