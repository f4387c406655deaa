//! Two children on a bed, the one often behind the other, kept apart through a film with six corrections. Clicks, outlines
//! and the points that are looked at were set by hand and stand in `bedroom.json`.

use std::collections::BTreeMap;
use std::path::Path;

use ostra::masks::{LabelId, read_palette_png};
use serde::Deserialize;
use serde_json::{Value, json};

use super::command_line::done;
use crate::support::data_dir;

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
    let mut args: Vec<String> =
        ["prompt", project, "--frame", "0", "--label", label, "--segmenter", "builtin"].map(String::from).to_vec();
    for (option, places) in [("--click", &clicks.include), ("--not", &clicks.exclude)] {
        args.extend(places.iter().flat_map(|[x, y]| [option.to_owned(), format!("{x},{y}")]));
    }
    done(&args.iter().map(String::as_str).collect::<Vec<_>>());
}

/// Takes the boy off a frame, draws him, and tracks him anew between the neighbouring anchors.
fn correct(project: &str, recipe: &Path, Correction { frame, polygons }: &Correction) {
    let paint = |points: &Value, erase: bool| json!({"paint": {"frame": frame, "label": BOY, "points_px": points, "radius_px": 0, "erase": erase, "replace": !erase}});
    let mut commands = vec![json!({"open": project}), paint(&json!([[0, 0], [960, 0], [960, 540], [0, 540]]), true)];
    commands.extend(polygons.iter().map(|polygon| paint(&json!(polygon), false)));
    std::fs::write(recipe, json!({"format": 1, "commands": commands}).to_string()).unwrap();
    done(&["run", recipe.to_str().unwrap()]);
    done(&["track", project, "--tracker", "flow", "--label", "boy", "--around", &frame.to_string(), "--replace"]);
}

#[test]
fn two_children_are_kept_apart_with_six_corrections() {
    let Some(data) = data_dir() else { return };
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
    for correction in &script.corrections {
        correct(project, &folder.path().join("recipe.json"), correction);
    }
    done(&["track", project, "--tracker", "flow", "--label", "girl"]);
    // Of each, points on it, those found, and those that the other took.
    let mut counts = BTreeMap::from([("girl", [0; 3]), ("boy", [0; 3]), ("neither", [0; 3])]);
    for (frame, points) in &script.points {
        let mask = read_palette_png(&path.join(format!("masks/{frame}.png"))).unwrap();
        for (what, counts) in &mut counts {
            let id = LABELS.iter().position(|label| label == what).map_or(LabelId::NONE, |at| LabelId(at as u16 + 1));
            for &[x, y] in &points[*what] {
                let is = mask.ids[y * mask.width as usize + x];
                counts[0] += 1;
                counts[1] += usize::from(is == id);
                counts[2] += usize::from(is != id && is != LabelId::NONE);
            }
        }
    }
    println!("points, found, taken by another: {counts:?}");
    let share = |what: &str, at: usize| f64::from(counts[what][at] as u32) / f64::from(counts[what][0] as u32);
    assert!(share("girl", 1) >= 0.97 && share("girl", 2) <= 0.01, "{counts:?}");
    assert!(share("boy", 1) >= 0.83 && share("boy", 2) <= 0.1, "{counts:?}");
    assert!(share("neither", 1) >= 0.93, "{counts:?}");
}
