//! Fits the weights by which the built-in segmenter ranks the candidates of a click.
//!
//! The weights are those of `src/masks/graph_cut/ranking.rs`, fitted on images with ground truth.
//! The simulated user then plays each clip with weights fitted without that clip.
//!
//! `cargo bench --bench segmenter_fit` uses three images of the shelf; `… -- all` uses all and
//! takes minutes.
//!
//! Images with depth and several objects (`color/`, `depth/`, `labels/` with one value per object)
//! are played as a session does it: one click for the object with the largest error, with the
//! others' clicks excluded.
//!
//! - `OSTRA_MORE` names a folder of further such folders; those with `alone` in their name are
//!   played object by object.
//! - `OSTRA_ONLY` limits the clips to those whose names start with one of its comma-separated
//!   values.
//! - `OSTRA_ROUNDS` repeats the fit, each time on clicks chosen by the weights before.

#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "a bench prints its table and ends where data is damaged"
)]

mod cases;
mod fit;
mod play;
mod report;

use std::path::{Path, PathBuf};

use ostra_masks::graph_cut::ranking::{ClickKind, WEIGHTS};
use rayon::prelude::*;

use cases::{davis, recording, recordings};
use play::{Sample, explore};

const KINDS: [ClickKind; 6] = [
    ClickKind::First,
    ClickKind::Include,
    ClickKind::Exclude,
    ClickKind::DeepFirst,
    ClickKind::DeepInclude,
    ClickKind::DeepExclude,
];

fn main() {
    let data = std::env::var_os("OSTRA_DATA")
        .map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    if !data.is_dir() {
        println!("no images at {}: set OSTRA_DATA", data.display());
        return;
    }
    let is_whole = std::env::args().any(|word| word == "all");
    let mut cases = recording(
        &data.join("apc_shelf_rgbd_labels"),
        "shelf",
        if is_whole { 1 } else { 7 },
    );
    if is_whole {
        cases.extend(davis(&data.join("davis2016")));
    }
    if let Some(more) = std::env::var_os("OSTRA_MORE") {
        cases.extend(recordings(Path::new(&more)));
    }
    if let Ok(only) = std::env::var("OSTRA_ONLY") {
        cases.retain(|case| only.split(',').any(|only| case.clip.starts_with(only)));
    }
    let rounds: usize = std::env::var("OSTRA_ROUNDS").map_or(1, |rounds| rounds.parse().unwrap());
    let mut weights = WEIGHTS;
    let mut samples: Vec<Sample> = Vec::new();
    for round in 0..rounds {
        let found: Vec<Vec<Sample>> = cases
            .par_iter()
            .enumerate()
            .map(|(at, case)| explore(case, &weights, (at + 1000 * round) as u64))
            .collect();
        samples.extend(found.into_iter().flatten());
        weights = fit::fitted(&samples, None, &weights);
        report::gains(&samples, &weights);
    }
    println!("const WEIGHTS: Weights = [");
    for row in &weights {
        println!(
            "    [{}],",
            row.map(|weight| format!("{weight:.4}")).join(", ")
        );
    }
    println!("];");
    report::plays(&cases, &samples, &weights);
    let none = WEIGHTS.map(|row| row.map(|_| 0.0));
    let (fitted, none) = (
        report::mean_gain(&samples, &weights),
        report::mean_gain(&samples, &none),
    );
    assert!(
        fitted > 1.2 * none.max(0.0),
        "a click gains {fitted} by fitted weights, {none} by none"
    );
}
