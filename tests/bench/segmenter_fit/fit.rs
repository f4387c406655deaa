//! Fits ranking weights to recorded clicks.

use rayon::prelude::*;

use ostra_masks::graph_cut::ranking::{ClickKind, TERMS, Weights};

use crate::KINDS;
use crate::play::Sample;

/// Returns weights fitted to the samples without those of one clip.
///
/// Kinds without samples keep `weights`.
pub fn fitted(samples: &[Sample], without: Option<&str>, weights: &Weights) -> Weights {
    KINDS.map(|kind| {
        // Clicks without depth also inform the weights of those with depth.
        let importance = |other: ClickKind| match other {
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
        if samples.iter().any(|sample| sample.kind == kind) {
            ascend(&of_kind)
        } else {
            weights[kind as usize]
        }
    })
}

/// Returns weights that maximise the expected gain of a candidate, by gradient ascent (Adam).
///
/// Candidates are drawn by the softmax of their scores.
fn ascend(samples: &[(&Sample, f64)]) -> [f32; TERMS] {
    const ROUNDS: i32 = 250;
    const DECAY: f64 = 2e-3;
    let rows = || samples.iter().flat_map(|(sample, _)| &sample.terms);
    let count = rows().count().max(1) as f64;
    let mean: [f64; TERMS] =
        std::array::from_fn(|term| rows().map(|row| f64::from(row[term])).sum::<f64>() / count);
    let spread: [f64; TERMS] = std::array::from_fn(|term| {
        (rows()
            .map(|row| (f64::from(row[term]) - mean[term]).powi(2))
            .sum::<f64>()
            / count)
            .sqrt()
            + 1e-6
    });
    let (mut weights, mut first, mut second) = ([0.0f64; TERMS], [0.0; TERMS], [0.0; TERMS]);
    let total: f64 = samples.iter().map(|(_, share)| share).sum();
    for round in 1..=ROUNDS {
        let gradients: Vec<[f64; TERMS]> = samples
            .par_iter()
            .map(|(sample, share)| {
                gradient(sample, &weights, &mean, &spread).map(|slope| slope * share)
            })
            .collect();
        for term in 0..TERMS {
            let slope = gradients.iter().map(|gradient| gradient[term]).sum::<f64>()
                / total.max(1.0)
                - DECAY * weights[term];
            first[term] = 0.9 * first[term] + 0.1 * slope;
            second[term] = 0.99 * second[term] + 0.01 * slope * slope;
            let step = first[term] / (1.0 - 0.9f64.powi(round));
            weights[term] +=
                0.05 * step / ((second[term] / (1.0 - 0.99f64.powi(round))).sqrt() + 1e-8);
        }
    }
    std::array::from_fn(|term| (weights[term] / spread[term]) as f32)
}

fn gradient(
    sample: &Sample,
    weights: &[f64; TERMS],
    mean: &[f64; TERMS],
    spread: &[f64; TERMS],
) -> [f64; TERMS] {
    let scaled: Vec<[f64; TERMS]> = sample
        .terms
        .iter()
        .map(|row| std::array::from_fn(|term| (f64::from(row[term]) - mean[term]) / spread[term]))
        .collect();
    let scores: Vec<f64> = scaled
        .iter()
        .map(|row| row.iter().zip(weights).map(|(a, b)| a * b).sum())
        .collect();
    let top = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let chances: Vec<f64> = scores.iter().map(|score| (score - top).exp()).collect();
    let total: f64 = chances.iter().sum();
    let gains = || sample.gains.iter().map(|&gain| f64::from(gain));
    let expected: f64 = chances
        .iter()
        .zip(gains())
        .map(|(chance, gain)| chance / total * gain)
        .sum();
    let range = gains().fold(f64::NEG_INFINITY, f64::max) - gains().fold(f64::INFINITY, f64::min);
    let importance = 1.0 / (0.05 + range).sqrt();
    let mut gradient = [0.0; TERMS];
    for ((row, chance), gain) in scaled.iter().zip(&chances).zip(gains()) {
        let pull = importance * chance / total * (gain - expected);
        gradient
            .iter_mut()
            .zip(row)
            .for_each(|(slope, value)| *slope += pull * value);
    }
    gradient
}
