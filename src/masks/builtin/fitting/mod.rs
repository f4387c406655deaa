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

#[test]
#[ignore = "temporary"]
fn dump() {
    use std::io::Write;
    let root = PathBuf::from(std::env::var_os("OSTRA_MORE").unwrap());
    for (at, case) in recordings(&root).iter().enumerate() {
        let (frame, truth) = case.load();
        let mut out =
            std::io::BufWriter::new(std::fs::File::create(format!("/tmp/dump/{}-{at}.bin", case.clip)).unwrap());
        let mut u = |v: u32| out.write_all(&v.to_le_bytes()).unwrap();
        u(truth.width);
        u(truth.height);
        u(frame.graph.regions.len() as u32);
        u(frame.graph.edges.len() as u32);
        frame.raster.of_pixel.iter().for_each(|&v| u(v));
        truth.ids.iter().for_each(|&v| u(u32::from(v.0)));
        for r in &frame.graph.regions {
            for v in [r.area, r.tone[0], r.tone[1], r.tone[2], r.texture, r.at[0], r.at[1], r.ln_depth] {
                u(v.to_bits());
            }
        }
        for e in &frame.graph.edges {
            u(e.a);
            u(e.b);
            u(e.length.to_bits());
            u(e.strength.to_bits());
        }
    }
}
