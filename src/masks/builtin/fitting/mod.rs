//! Fits the weights of `choice.rs` on pictures with truth, and plays the robot user with weights that were fitted
//! without the clip played. Run by hand:
//!
//! `cargo test --release --lib builtin::fitting -- --ignored --nocapture`
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

use super::choice::{Kind, WEIGHTS};
use cases::{davis, recording, recordings};
use play::{Sample, explore};

const KINDS: [Kind; 6] =
    [Kind::First, Kind::Include, Kind::Exclude, Kind::DeepFirst, Kind::DeepInclude, Kind::DeepExclude];

#[test]
#[ignore = "a tool: minutes of work on data that is not part of the program"]
fn fit() {
    let data = std::env::var_os("OSTRA_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let mut cases = davis(&data.join("davis2016"));
    cases.extend(recording(&data.join("apc_shelf_rgbd_labels"), "shelf", 1));
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
        println!("    [{}],", row.map(|weight| format!("{weight:.4}")).join(", "));
    }
    println!("];");
    report::plays(&cases, &samples, &weights);
}
