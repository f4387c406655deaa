//! Fits the weights of `choice.rs` on pictures with truth, and plays the robot user with weights that were fitted
//! without the clip played. Run by hand:
//!
//! `cargo test --release --lib builtin::fitting -- --ignored --nocapture`

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::candidates::{CandidateOptions, Candidates, candidates};
use super::choice::{Kind, TERMS, WEIGHTS, Weights, best, expected_best, kind_of, terms};
use super::prepared::Prepared;
use super::query::Query;
use super::segmenter::prepare;
use crate::engine::job::Progress;
use crate::frames::{DepthMap, Image};
use crate::masks::{Region, next_click};

const CAP: usize = 20;
const KINDS: [Kind; 6] =
    [Kind::First, Kind::Include, Kind::Exclude, Kind::DeepFirst, Kind::DeepInclude, Kind::DeepExclude];

/// One click met while playing: what each candidate would gain in IoU.
struct Sample {
    clip: String,
    kind: Kind,
    terms: Vec<[f32; TERMS]>,
    gains: Vec<f32>,
    shared: Vec<Vec<f32>>,
}

/// A picture with truth.
struct Case {
    clip: String,
    name: String,
    image: PathBuf,
    depth: Option<PathBuf>,
    truth: PathBuf,
    /// Value of the object in the truth; `None` = any but 0.
    value: Option<u8>,
    clicks: usize,
    is_shown: bool,
}

#[test]
#[ignore = "a tool: minutes of work on data that is not part of the program"]
fn fit() {
    let data = std::env::var_os("OSTRA_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let mut cases = davis(&data.join("davis2016"));
    cases.extend(shelf(&data.join("apc_shelf_rgbd_labels"), "shelf", 3, 4, 5));
    // More pictures with depth, in the same layout, e.g. views of made scenes.
    if let Some(more) = std::env::var_os("OSTRA_MORE") {
        cases.extend(shelf(Path::new(&more), "more", 1, 3, 8));
    }
    if let Ok(only) = std::env::var("OSTRA_ONLY") {
        cases.retain(|case| case.clip.starts_with(&only));
    }
    let rounds: usize = std::env::var("ROUNDS").map_or(1, |rounds| rounds.parse().unwrap());
    let mut weights = WEIGHTS;
    let mut samples: Vec<Sample> = Vec::new();
    for round in 0..rounds {
        let found: Vec<Vec<Sample>> =
            cases.par_iter().enumerate().map(|(at, case)| explore(case, &weights, (at + round) as u64)).collect();
        samples.extend(found.into_iter().flatten());
        weights = fitted(&samples, None);
        report(&samples, &weights);
    }
    println!("const WEIGHTS: Weights = [");
    for row in &weights {
        println!("    [{}],", row.map(|weight| format!("{weight:.4}")).join(", "));
    }
    println!("];");
    play_all(&cases, &samples, &weights);
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

fn davis(root: &Path) -> Vec<Case> {
    let mut cases = Vec::new();
    for clip in sorted(&root.join("JPEGImages")) {
        let pictures = sorted(&clip);
        let clip = clip.file_name().unwrap().to_string_lossy().to_string();
        let last = pictures.len() - 1;
        for at in (0..pictures.len()).filter(|at| at % 12 == 0 || *at == last || *at == pictures.len() / 2) {
            cases.push(Case {
                clip: clip.clone(),
                name: format!("{clip}-{at}"),
                image: pictures[at].clone(),
                depth: None,
                truth: root.join("Annotations").join(&clip).join(format!("{at:05}.png")),
                value: None,
                clicks: CAP,
                is_shown: at == 0 || at == last || at == pictures.len() / 2,
            });
        }
    }
    cases
}

fn shelf(root: &Path, name: &str, every: usize, objects: u8, clicks: usize) -> Vec<Case> {
    let mut cases = Vec::new();
    for (at, picture) in sorted(&root.join("color")).iter().enumerate().step_by(every) {
        let file = picture.file_name().unwrap();
        for object in 1..=objects {
            for depth in [None, Some(root.join("depth").join(file))] {
                if depth.is_none() && name != "shelf" {
                    continue;
                }
                cases.push(Case {
                    clip: format!("{name} {object}"),
                    name: format!("{name}{at}-{object}{}", if depth.is_some() { "d" } else { "" }),
                    image: picture.clone(),
                    depth,
                    truth: root.join("labels").join(file),
                    value: Some(object),
                    clicks,
                    is_shown: true,
                });
            }
        }
    }
    cases
}

fn load(case: &Case) -> (Prepared, Region) {
    let image = image::open(&case.image).unwrap().to_rgb8();
    let (width, height) = image.dimensions();
    let image = Arc::new(Image { width, height, pixels: image.pixels().map(|pixel| pixel.0).collect() });
    let depth = case.depth.as_ref().map(|path| {
        let depths =
            image::open(path).unwrap().to_luma16().pixels().map(|pixel| f32::from(pixel.0[0]) * 1e-3).collect();
        DepthMap { width, height, depths }
    });
    let is_inside = |value: u8| case.value.map_or(value > 127, |object| value == object);
    let truth = image::open(&case.truth).unwrap().to_luma8();
    let inside = truth.pixels().map(|pixel| is_inside(pixel.0[0])).collect();
    (prepare(&image, depth.as_ref(), &Progress::default()).unwrap(), Region { width, height, inside })
}

fn iou(a: &Region, b: &Region) -> f32 {
    let pairs = || a.inside.iter().zip(&b.inside);
    let both = pairs().filter(|(a, b)| **a && **b).count();
    both as f32 / pairs().filter(|(a, b)| **a || **b).count().max(1) as f32
}

/// IoU after each click, choosing with `choose` (number of the click, kind, terms, gains) among the candidates.
fn play(case: &Case, mut choose: impl FnMut(Kind, &Candidates, &[f32]) -> usize) -> Vec<f32> {
    let (frame, truth) = load(case);
    let share = {
        let mut share = vec![0.0f32; frame.graph.region_count()];
        for (&region, &inside) in frame.raster.of_pixel.iter().zip(&truth.inside) {
            share[region as usize] += f32::from(u8::from(inside));
        }
        share
    };
    let total: f32 = share.iter().sum();
    let mut answer = Region::empty(truth.width, truth.height);
    let mut clicks = Vec::new();
    let mut ious = Vec::new();
    while let Some(click) = next_click(&truth, &answer).filter(|_| ious.len() < case.clicks) {
        clicks.push(click);
        let previous = answer.clone();
        let mut query = Query::new(&frame, None);
        if clicks.len() > 1 {
            query.start_from(&previous);
        }
        clicks[..clicks.len() - 1].iter().for_each(|click| query.add_known_click(click));
        query.note_new_click(&click);
        let change = query.situation().map(|situation| {
            let mut found = candidates(&situation, &CandidateOptions::default());
            let regions = &frame.graph.regions;
            let score = |change: Option<&[bool]>| {
                let (mut both, mut any) = (0.0, total);
                for (at, region) in regions.iter().enumerate() {
                    let changes = change.is_some_and(|change| change[at]);
                    if if changes { click.include } else { query.inside[at] } {
                        both += share[at];
                        any += region.area - share[at];
                    }
                }
                both / any
            };
            let before = score(None);
            let gains: Vec<f32> = found.all.iter().map(|candidate| score(Some(&candidate.change)) - before).collect();
            let chosen = choose(kind_of(&situation), &found, &gains);
            found.all.swap_remove(chosen).change
        });
        if let Some(change) = change {
            query.apply(&change, click.include);
        }
        answer = query.answer();
        ious.push(iou(&truth, &answer));
    }
    ious
}

/// Plays with the weights so far, now and then taking another candidate, and notes every click.
fn explore(case: &Case, weights: &Weights, seed: u64) -> Vec<Sample> {
    let mut samples = Vec::new();
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    play(case, |kind, found, gains| {
        samples.push(Sample {
            clip: case.clip.clone(),
            kind,
            terms: found.all.iter().map(|candidate| terms(&candidate.traits)).collect(),
            gains: gains.to_vec(),
            shared: found.shared.clone(),
        });
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        match state >> 60 {
            0..2 => (state >> 20) as usize % found.all.len(),
            2..5 => oracle(gains),
            _ => best(weights, kind, found).unwrap(),
        }
    });
    samples
}

fn oracle(gains: &[f32]) -> usize {
    (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b])).unwrap()
}

fn fitted(samples: &[Sample], without: Option<&str>) -> Weights {
    KINDS.map(|kind| {
        // Clicks without depth say something about those with depth too.
        let importance = |other: Kind| match other {
            _ if other == kind => 1.0,
            _ if other as usize + 3 == kind as usize => 0.15,
            _ => 0.0,
        };
        let of_kind: Vec<(&Sample, f64)> = samples
            .iter()
            .filter(|sample| sample.gains.len() > 1 && Some(&*sample.clip) != without)
            .map(|sample| (sample, importance(sample.kind)))
            .filter(|(_, importance)| *importance > 0.0)
            .collect();
        ascend(&of_kind)
    })
}

/// Raises the expected gain of a candidate drawn by softmax of its score, by gradient (Adam).
fn ascend(samples: &[(&Sample, f64)]) -> [f32; TERMS] {
    const ROUNDS: i32 = 250;
    const DECAY: f64 = 2e-3;
    let rows = || samples.iter().flat_map(|(sample, _)| &sample.terms);
    let count = rows().count().max(1) as f64;
    let mean: [f64; TERMS] = std::array::from_fn(|term| rows().map(|row| f64::from(row[term])).sum::<f64>() / count);
    let spread: [f64; TERMS] = std::array::from_fn(|term| {
        (rows().map(|row| (f64::from(row[term]) - mean[term]).powi(2)).sum::<f64>() / count).sqrt() + 1e-6
    });
    let (mut weights, mut first, mut second) = ([0.0f64; TERMS], [0.0; TERMS], [0.0; TERMS]);
    let total: f64 = samples.iter().map(|(_, share)| share).sum();
    for round in 1..=ROUNDS {
        let gradients: Vec<[f64; TERMS]> = samples
            .par_iter()
            .map(|(sample, share)| gradient(sample, &weights, &mean, &spread).map(|slope| slope * share))
            .collect();
        for term in 0..TERMS {
            let slope =
                gradients.iter().map(|gradient| gradient[term]).sum::<f64>() / total.max(1.0) - DECAY * weights[term];
            first[term] = 0.9 * first[term] + 0.1 * slope;
            second[term] = 0.99 * second[term] + 0.01 * slope * slope;
            let step = first[term] / (1.0 - 0.9f64.powi(round));
            weights[term] += 0.05 * step / ((second[term] / (1.0 - 0.99f64.powi(round))).sqrt() + 1e-8);
        }
    }
    std::array::from_fn(|term| (weights[term] / spread[term]) as f32)
}

fn gradient(sample: &Sample, weights: &[f64; TERMS], mean: &[f64; TERMS], spread: &[f64; TERMS]) -> [f64; TERMS] {
    let scaled: Vec<[f64; TERMS]> = sample
        .terms
        .iter()
        .map(|row| std::array::from_fn(|term| (f64::from(row[term]) - mean[term]) / spread[term]))
        .collect();
    let scores: Vec<f64> = scaled.iter().map(|row| row.iter().zip(weights).map(|(a, b)| a * b).sum()).collect();
    let top = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let chances: Vec<f64> = scores.iter().map(|score| (score - top).exp()).collect();
    let total: f64 = chances.iter().sum();
    let gains = || sample.gains.iter().map(|&gain| f64::from(gain));
    let expected: f64 = chances.iter().zip(gains()).map(|(chance, gain)| chance / total * gain).sum();
    let range = gains().fold(f64::NEG_INFINITY, f64::max) - gains().fold(f64::INFINITY, f64::min);
    let importance = 1.0 / (0.05 + range).sqrt();
    let mut gradient = [0.0; TERMS];
    for ((row, chance), gain) in scaled.iter().zip(&chances).zip(gains()) {
        let pull = importance * chance / total * (gain - expected);
        gradient.iter_mut().zip(row).for_each(|(slope, value)| *slope += pull * value);
    }
    gradient
}

/// Mean gain of a click when chosen by truth, by weights fitted without its clip, by weights fitted on all.
fn report(samples: &[Sample], weights: &Weights) {
    let mut clips: Vec<&str> = samples.iter().map(|sample| &*sample.clip).collect();
    clips.sort_unstable();
    clips.dedup();
    let held_out: Vec<(&str, Weights)> = clips.iter().map(|&clip| (clip, fitted(samples, Some(clip)))).collect();
    for kind in KINDS {
        let of_kind: Vec<&Sample> = samples.iter().filter(|sample| sample.kind == kind).collect();
        let mean = |pick: &dyn Fn(&Sample) -> usize| {
            of_kind.iter().map(|sample| sample.gains[pick(sample)]).sum::<f32>() / of_kind.len() as f32
        };
        let by = |weights: &Weights, sample: &Sample, sharp: f32| {
            let row = &weights[kind as usize];
            let scores: Vec<f32> =
                sample.terms.iter().map(|terms| terms.iter().zip(row).map(|(a, b)| sharp * a * b).sum()).collect();
            expected_best(&scores, &sample.shared).unwrap()
        };
        let without = |sample: &Sample, sharp: f32| {
            by(&held_out.iter().find(|(clip, _)| *clip == sample.clip).unwrap().1, sample, sharp)
        };
        print!(
            "{kind:?}: {} clicks; gain by truth {:.4}, held out",
            of_kind.len(),
            mean(&|sample| oracle(&sample.gains))
        );
        for sharpness in [0.3, 0.6, 1.0, 2.0, 100.0] {
            print!(" {:.4}", mean(&|sample| without(sample, sharpness)));
        }
        println!(" fitted {:.4}", mean(&|sample| by(weights, sample, 1.0)));
    }
}

fn play_all(cases: &[Case], samples: &[Sample], weights: &Weights) {
    let mut clips: Vec<&str> = cases.iter().map(|case| &*case.clip).collect();
    clips.dedup();
    clips.sort_unstable();
    clips.dedup();
    let held_out: Vec<(&str, Weights)> = clips.iter().map(|&clip| (clip, fitted(samples, Some(clip)))).collect();
    for (title, mode) in [("truth", 0), ("held out", 1), ("fitted", 2)] {
        let shown: Vec<&Case> = cases.iter().filter(|case| case.is_shown).collect();
        let runs: Vec<Vec<f32>> = shown
            .par_iter()
            .map(|case| {
                let held = &held_out.iter().find(|(clip, _)| *clip == case.clip).unwrap().1;
                play(case, |kind, found, gains| match mode {
                    0 => oracle(gains),
                    1 => best(held, kind, found).unwrap(),
                    _ => best(weights, kind, found).unwrap(),
                })
            })
            .collect();
        for part in ["davis", "rgb shelf", "rgbd shelf", "more"] {
            let is_part = |case: &Case| match part {
                "davis" => case.clicks == CAP,
                "more" => case.clip.starts_with("more"),
                _ => case.clip.starts_with("shelf") && case.depth.is_some() == (part == "rgbd shelf"),
            };
            let runs: Vec<&Vec<f32>> =
                runs.iter().zip(&shown).filter(|(_, case)| is_part(case)).map(|(run, _)| run).collect();
            if runs.is_empty() {
                continue;
            }
            let after = |clicks: usize| {
                runs.iter().map(|run| run.get(clicks - 1).or(run.last()).unwrap()).sum::<f32>() / runs.len() as f32
            };
            let to = |run: &&Vec<f32>| run.iter().position(|&iou| iou >= 0.85).map_or(CAP, |at| at + 1) as f32;
            let failed = runs.iter().filter(|run| run.iter().all(|&iou| iou < 0.85)).count();
            let falls = (2..=CAP).filter(|&clicks| after(clicks) < after(clicks - 1)).count();
            println!(
                "{title:9} {part:10}: {:.2} clicks to 0.85, {failed} of {} failed; IoU after 1 2 3 5 10 20: {}; {falls} falls",
                runs.iter().map(to).sum::<f32>() / runs.len() as f32,
                runs.len(),
                [1, 2, 3, 5, 10, 20].map(|clicks| format!("{:.3}", after(clicks))).join(" ")
            );
        }
        if mode == 1 {
            for (case, run) in shown.iter().zip(&runs).filter(|(case, _)| case.clicks == CAP) {
                let at = |clicks: usize| run.get(clicks - 1).or(run.last()).unwrap();
                println!("   {:18} {:.3} {:.3} {:.3} {:.3}", case.name, at(1), at(3), at(10), at(20));
            }
        }
    }
}
