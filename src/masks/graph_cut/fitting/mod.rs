//! Fits the weights of `ranking.rs` on pictures with truth, and plays the robot user with weights that were fitted
//! without the clip played. As a test it does so on three pictures of the shelf; the whole of it, minutes of work, is run
//! by hand:
//!
//! `OSTRA_FIT=1 cargo test --release --lib builtin::fitting -- --nocapture`
//!
//! Pictures with depth and several objects (`color/`, `depth/`, `labels/` with one value per object) are played as the
//! session does it: one click for the object with the largest error, the others' clicks excluded. `OSTRA_MORE` names a
//! folder of further such folders; those of a name with `alone` in it are played object by object.

mod cases;
mod fit;
mod play;
mod report;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::ranking::{Kind, WEIGHTS};
use cases::{davis, recording, recordings};
use play::{Sample, explore};

const KINDS: [Kind; 6] = [
    Kind::First,
    Kind::Include,
    Kind::Exclude,
    Kind::DeepFirst,
    Kind::DeepInclude,
    Kind::DeepExclude,
];

#[test]
fn fitted_weights_gain_more_than_none() {
    let data = std::env::var_os("OSTRA_DATA")
        .map_or_else(|| PathBuf::from("../../../shared/data"), PathBuf::from);
    if !data.is_dir() {
        assert!(
            std::env::var_os("CI").is_none(),
            "{}: the test data is missing",
            data.display()
        );
        println!("skipped: no test data at {}", data.display());
        return;
    }
    let is_whole = std::env::var_os("OSTRA_FIT").is_some();
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
