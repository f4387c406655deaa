use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde_json::{Value, json};

use super::drive::Driver;
use super::print::{print_json, print_text, warn};
use super::results::{result_name, results_json};
use super::values::share;
use ostra_cloud::conflicts::FrameConflict;
use ostra_frames::{Frame, missing_sources};
use ostra_project::review::{FLAG_BELOW, Review, ReviewCriteria, review};
use ostra_project::store::feature_cache_path;
use ostra_project::{MaskOrigin, Presence, Project, ResultKind, ResultRecord, StepSeconds};
use ostra_reconstruct::sfm::{feature_cache_bytes, remove_feature_cache};
use ostra_session::Unfinished;

#[derive(Debug, Args)]
pub(super) struct InfoArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Tracker confidence of a label below which its frame is to be checked.
    #[arg(long, value_name = "C", default_value_t = FLAG_BELOW, value_parser = share)]
    pub flag_below: f32,
    /// Also check frames whose mask disagrees with the vote; this loads the cloud.
    #[arg(long)]
    pub conflicts: bool,
}

pub(super) fn info(args: &InfoArgs) -> Result<()> {
    let mut driver = Driver::view(&args.project)?;
    let conflicts = if args.conflicts {
        known_conflicts(&mut driver)?
    } else {
        Arc::default()
    };
    let project = driver.project()?;
    let criteria = ReviewCriteria {
        flag_below: args.flag_below,
        conflicts: &conflicts,
    };
    let review = review(project, &Presence::of(project), criteria);
    warn_of_missing(&missing_sources(&project.frames));
    let cache_bytes = feature_cache_bytes(&feature_cache_path(&args.project));
    if args.json {
        print_json(&as_json(project, &review, args.conflicts, cache_bytes));
    } else {
        print_text(&as_text(project, &review, args.conflicts));
        if cache_bytes > 0 {
            print_text(&format!(
                "cache of features and matches: {}; to remove it, run 'ostra clean-cache PROJECT'\n",
                size_text(cache_bytes)
            ));
        }
        if let Some(unfinished) = Unfinished::read(&args.project) {
            print_text(&format!(
                "reconstruction not finished ({:.0} % done): it is running, or it was interrupted; to continue it, open \
                 the project in the window or give the same options again\n",
                unfinished.fraction * 100.0
            ));
        }
    }
    Ok(())
}

/// Returns the conflicts of masks with the vote.
fn known_conflicts(driver: &mut Driver) -> Result<Arc<BTreeMap<usize, FrameConflict>>> {
    let conflicts = driver.conflicts()?;
    ensure!(
        !conflicts.is_empty(),
        "no votes of the cloud are known; run 'ostra fuse', or leave out --conflicts"
    );
    Ok(conflicts)
}

fn warn_of_missing(missing: &[&Path]) {
    if let Some(first) = missing.first() {
        warn(&format!(
            "{} source files are missing, the first is {}; if they have moved, run 'ostra relocate PROJECT OLD_FOLDER \
             NEW_FOLDER'",
            missing.len(),
            first.display()
        ));
    }
}

/// Summarises a project as `info --json` prints it.
fn as_json(project: &Project, review: &Review, has_conflicts: bool, cache_bytes: u64) -> Value {
    let frames: Vec<Value> = project
        .frames
        .iter()
        .enumerate()
        .map(|(number, frame)| frame_json(project, review, number, frame))
        .collect();
    let labels: Vec<Value> = project
        .labels
        .iter()
        .map(|label| {
            let [r, g, b] = label.color;
            let parent = label.parent.and_then(|id| project.labels.get(id)).map(|parent| parent.name.clone());
            json!({ "id": label.id.0, "name": label.name, "parent": parent, "color": format!("#{r:02x}{g:02x}{b:02x}") })
        })
        .collect();
    let counts = json!({
        "confirmed": review.confirmed, "to_check": review.to_check.len(), "with_conflicts": has_conflicts,
    });
    json!({
        "format": 1, "origin": project.origin.to_array(), "review": counts, "frames": frames, "labels": labels,
        "results": results_json(project), "cache_bytes": cache_bytes,
    })
}

/// Returns a size as text, in MB.
fn size_text(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

/// Removes the cache of features and matches of a project.
pub(super) fn clean_cache(project: &Path) -> Result<()> {
    // Opened for changes, so that no other process is using it.
    let _driver = Driver::open(project)?;
    let folder = feature_cache_path(project);
    let bytes = remove_feature_cache(&folder)
        .with_context(|| format!("{}: cannot be removed", folder.display()))?;
    print_text(&format!("removed {}\n", size_text(bytes)));
    Ok(())
}

/// Summarises a project as readable text.
fn as_text(project: &Project, review: &Review, has_conflicts: bool) -> String {
    let mut text = String::new();
    let count = |wanted: &str| {
        (0..project.frames.len())
            .filter(|&number| mask_state(project, number) == wanted)
            .count()
    };
    let with = |has: fn(&Frame) -> bool| project.frames.iter().filter(|frame| has(frame)).count();
    let _ = writeln!(
        text,
        "{} frames, {} with depth, {} with camera",
        project.frames.len(),
        with(|frame| frame.depth.is_some()),
        with(|frame| frame.posed_camera().is_some())
    );
    if project.origin != glam::DVec3::ZERO {
        let glam::DVec3 { x, y, z } = project.origin;
        let _ = writeln!(text, "origin of the coordinates: {x} {y} {z}");
    }
    let _ = writeln!(
        text,
        "masks: {} keyframes, {} tracked, {} stale, {} without",
        count("anchor"),
        count("tracked"),
        count("stale"),
        count("none")
    );
    let left_out = if project.results.contains_key(&ResultKind::Cloud) && !has_conflicts {
        ", not counting conflicts with the cloud (--conflicts counts them)"
    } else {
        ""
    };
    let _ = writeln!(
        text,
        "{}, {}{left_out}",
        review.confirmed_text(),
        review.to_check_text()
    );
    for label in project.labels.iter() {
        let path: Vec<&str> = project
            .labels
            .path(label.id)
            .iter()
            .filter_map(|&id| project.labels.get(id))
            .map(|label| label.name.as_str())
            .collect();
        let _ = writeln!(text, "label {:>3}  {}", label.id.0, path.join(" › "));
    }
    for (kind, record) in &project.results {
        let stale = if record.stale {
            ", stale: run it again"
        } else {
            ""
        };
        let _ = writeln!(
            text,
            "{}: {}, {} frames, {:.1} s{}{stale}",
            result_name(*kind),
            record.engine.name(),
            record.frames,
            record.seconds,
            steps_text(&record.steps)
        );
        text += &models_text(record);
    }
    text
}

/// Returns a line for each model that the images fall into, or nothing if there is only one.
fn models_text(record: &ResultRecord) -> String {
    let in_use = record.model_in_use();
    let mut text = String::new();
    for (index, model) in record.models.iter().enumerate() {
        let note = if in_use == Some(index) {
            ", in use"
        } else {
            ""
        };
        let (number, images, points) = (index + 1, model.frames, model.points);
        let _ = writeln!(
            text,
            "  model {number}: {images} images, {points} points{note}"
        );
    }
    text
}

/// Returns the time of each step in brackets, or nothing without steps.
fn steps_text(steps: &[StepSeconds]) -> String {
    if steps.is_empty() {
        return String::new();
    }
    let one = |step: &StepSeconds| format!("{} {:.1} s", step.step, step.seconds);
    let steps: Vec<String> = steps.iter().map(one).collect();
    format!(" ({})", steps.join(", "))
}

fn frame_json(project: &Project, review: &Review, number: usize, frame: &Frame) -> Value {
    let check = review.to_check.get(&number).map_or(&[][..], Vec::as_slice);
    json!({
        "name": frame.name, "width": frame.width, "height": frame.height, "depth": frame.depth.is_some(),
        "camera": frame.posed_camera().is_some(), "mask": mask_state(project, number), "check": check,
    })
}

fn mask_state(project: &Project, number: usize) -> &'static str {
    match project.masks.get(&number) {
        None => "none",
        Some(mask) if mask.stale => "stale",
        Some(mask) if mask.origin == MaskOrigin::Keyframe => "anchor",
        Some(_) => "tracked",
    }
}
