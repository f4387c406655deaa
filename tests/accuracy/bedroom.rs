//! Two children on a bed, the one often behind the other, kept apart through a film with six corrections. Clicks, outlines
//! and the points that are looked at were set by hand and stand in `bedroom.json`.

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
    /// By label what is clicked on the first frame.
    clicks: BTreeMap<String, Clicks>,
    corrections: Vec<Correction>,
    /// By frame and by what is there, `girl`, `boy` or `neither`, pixels.
    points: BTreeMap<usize, BTreeMap<String, Vec<[usize; 2]>>>,
}

#[derive(Deserialize)]
struct Clicks {
    include: Vec<[u32; 2]>,
    exclude: Vec<[u32; 2]>,
}

/// The boy drawn anew.
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

/// Takes the boy off a frame, draws him, and tracks him anew between the neighbouring anchors.
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

/// Of the points on a child or beside both: how many, those found, and those that another has taken.
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

/// Counts over the frames that nobody labelled by hand.
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
