//! Prints gains and scores of fitted and held-out weights.

use rayon::prelude::*;

use ostra_masks::graph_cut::ranking::{Weights, best, expected_best};

use crate::KINDS;
use crate::cases::Case;
use crate::fit::fitted;
use crate::play::{Sample, oracle, play};

/// Returns the weights fitted without each clip.
fn held_out(samples: &[Sample], weights: &Weights) -> Vec<(String, Weights)> {
    let mut clips: Vec<&str> = samples.iter().map(|sample| &*sample.clip).collect();
    clips.sort_unstable();
    clips.dedup();
    clips
        .par_iter()
        .map(|&clip| (clip.to_owned(), fitted(samples, Some(clip), weights)))
        .collect()
}

fn without<'a>(held_out: &'a [(String, Weights)], clip: &str) -> &'a Weights {
    &held_out.iter().find(|(held, _)| *held == clip).unwrap().1
}

/// Returns the mean gain of a click chosen by the weights.
pub fn mean_gain(samples: &[Sample], weights: &Weights) -> f32 {
    let gain = |sample: &Sample| {
        let row = &weights[sample.kind as usize];
        let scores: Vec<f32> = sample
            .terms
            .iter()
            .map(|terms| {
                terms
                    .iter()
                    .zip(row)
                    .map(|(term, weight)| term * weight)
                    .sum()
            })
            .collect();
        sample.gains[expected_best(&scores, &sample.shared).unwrap()]
    };
    samples.iter().map(gain).sum::<f32>() / samples.len() as f32
}

/// Prints the mean gain of a click chosen by ground truth, held-out weights, and fitted weights.
///
/// Held-out weights are fitted without the click's clip.
pub fn gains(samples: &[Sample], weights: &Weights) {
    let held_out = held_out(samples, weights);
    for kind in KINDS {
        let of_kind: Vec<&Sample> = samples
            .iter()
            .filter(|sample| sample.kind == kind)
            .collect();
        let mean = |pick: &dyn Fn(&Sample) -> usize| {
            of_kind
                .iter()
                .map(|sample| sample.gains[pick(sample)])
                .sum::<f32>()
                / of_kind.len() as f32
        };
        let by = |weights: &Weights, sample: &Sample, sharp: f32| {
            let row = &weights[kind as usize];
            let scores: Vec<f32> = sample
                .terms
                .iter()
                .map(|terms| terms.iter().zip(row).map(|(a, b)| sharp * a * b).sum())
                .collect();
            expected_best(&scores, &sample.shared).unwrap()
        };
        let by_truth = mean(&|sample| oracle(&sample.gains));
        print!(
            "{kind:?}: {} clicks; gain by truth {by_truth:.4}, held out",
            of_kind.len()
        );
        for sharpness in [0.3, 0.6, 1.0, 2.0, 100.0] {
            print!(
                " {:.4}",
                mean(&|sample| by(without(&held_out, &sample.clip), sample, sharpness))
            );
        }
        println!(" fitted {:.4}", mean(&|sample| by(weights, sample, 1.0)));
    }
}

/// Plays the simulated user on every shown case.
///
/// Candidates are chosen by ground truth, by weights fitted without the clip, and by weights fitted
/// on all.
pub fn plays(cases: &[Case], samples: &[Sample], weights: &Weights) {
    let held_out = held_out(samples, weights);
    let shown: Vec<&Case> = cases.iter().filter(|case| case.is_shown).collect();
    for (title, mode) in [("truth", 0), ("held out", 1), ("fitted", 2)] {
        let runs: Vec<Vec<f32>> = shown
            .par_iter()
            .map(|case| {
                play(case, &mut |found, gains| {
                    let by = |weights: &Weights| {
                        best(weights, found.kind, &found.terms, &found.shared).unwrap()
                    };
                    match mode {
                        0 => oracle(gains),
                        1 => by(without(&held_out, &case.clip)),
                        _ => by(weights),
                    }
                })
            })
            .collect();
        let mut groups: Vec<&str> = shown.iter().map(|case| group(case)).collect();
        groups.sort_unstable();
        groups.dedup();
        for name in groups {
            let of_group = || {
                shown
                    .iter()
                    .zip(&runs)
                    .filter(|(case, _)| group(case) == name)
            };
            summary(
                title,
                name,
                &of_group().map(|(_, run)| run).collect::<Vec<_>>(),
                of_group().next().unwrap().0,
            );
        }
    }
}

fn group(case: &Case) -> &str {
    match case.has_depth() {
        false => "davis",
        true => case
            .clip
            .trim_end_matches(|letter: char| letter.is_ascii_digit()),
    }
}

fn summary(title: &str, name: &str, runs: &[&Vec<f32>], case: &Case) {
    const WANTED: f32 = 0.85;
    let count = runs.len() as f32;
    let after = |clicks: usize| {
        runs.iter()
            .map(|run| run.get(clicks - 1).or(run.last()).unwrap())
            .sum::<f32>()
            / count
    };
    let to = |run: &&Vec<f32>| {
        run.iter()
            .position(|&iou| iou >= WANTED)
            .map_or(case.clicks, |at| at + 1) as f32
    };
    let failed = runs
        .iter()
        .filter(|run| run.iter().all(|&iou| iou < WANTED))
        .count();
    let ious: Vec<String> = [1, 2, 3, 5, 10, 20]
        .into_iter()
        .filter(|&clicks| clicks <= case.clicks)
        .map(|clicks| format!("{:.3}", after(clicks)))
        .collect();
    println!(
        "{title:9} {name:10}: {:.2} clicks an object to {WANTED}, {failed} of {} failed; IoU after 1 2 3 5 10 20: {}",
        runs.iter().map(to).sum::<f32>() / count,
        runs.len(),
        ious.join(" ")
    );
}
