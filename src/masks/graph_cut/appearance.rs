//! Colour and texture models: histograms over a palette of the frame.

use rayon::prelude::*;

use super::region_stats::RegionStats;

/// Number of palette entries.
const ENTRIES: usize = 64;
/// Distance at which two palette entries count as the same appearance, ΔE.
const BANDWIDTH: f32 = 7.0;

type ColorFeature = [f32; 4];

/// Palette of the appearances in a frame, with the entry of each region and similarities.
pub(super) struct Palette {
    /// Palette entry of each region.
    pub of_region: Vec<u8>,
    /// Similarities of the entries, `ENTRIES²` values 0–1; rows sum to 1.
    alike: Vec<f32>,
}

impl Palette {
    /// Clusters the regions by k-means on (L, a, b, texture), weighted by area.
    pub fn new(regions: &[RegionStats]) -> Self {
        let features: Vec<(ColorFeature, f32)> = regions
            .iter()
            .map(|region| (feature(region), region.area))
            .collect();
        let mut entries = spread_out(&features);
        let mut of_region = Vec::new();
        for _ in 0..6 {
            of_region = features
                .par_iter()
                .map(|(feature, _)| nearest(&entries, feature))
                .collect::<Vec<u8>>();
            let mut sums = vec![([0.0f32; 4], 0.0f32); entries.len()];
            for ((feature, area), &entry) in features.iter().zip(&of_region) {
                let sum = &mut sums[usize::from(entry)];
                (0..4).for_each(|axis| sum.0[axis] += feature[axis] * area);
                sum.1 += area;
            }
            for (entry, (sum, area)) in entries.iter_mut().zip(sums) {
                if area > 0.0 {
                    *entry = sum.map(|sum| sum / area);
                }
            }
        }
        Self {
            of_region,
            alike: likeness(&entries),
        }
    }

    /// Returns the number of entries.
    pub fn entries(&self) -> u8 {
        ENTRIES as u8
    }

    /// Returns the memory used in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.of_region) + size_of_val(&*self.alike)
    }

    /// Returns a model of weighted regions.
    ///
    /// It holds how often each entry, or a similar one, occurs. Its values sum to 1 unless all
    /// weights are 0.
    pub fn model(&self, weighted: impl Iterator<Item = (usize, f32)>) -> PaletteHistogram {
        let mut counts = [0.0f32; ENTRIES];
        let mut total = 0.0;
        for (region, weight) in weighted {
            counts[usize::from(self.of_region[region])] += weight;
            total += weight;
        }
        let mut share = [0.0; ENTRIES];
        for (count, alike) in counts.iter().zip(self.alike.chunks_exact(ENTRIES)) {
            share
                .iter_mut()
                .zip(alike)
                .for_each(|(share, alike)| *share += count * alike);
        }
        PaletteHistogram {
            share: share.map(|share| share / total.max(f32::MIN_POSITIVE)),
        }
    }
}

/// A smoothed histogram over a [`Palette`].
#[derive(Debug, Clone)]
pub(super) struct PaletteHistogram {
    share: [f32; ENTRIES],
}

impl PaletteHistogram {
    /// Returns the share of entry `entry` in the modelled regions.
    pub fn share(&self, entry: u8) -> f32 {
        self.share[usize::from(entry)]
    }
}

fn feature(region: &RegionStats) -> ColorFeature {
    let [l, a, b] = region.lab;
    [0.7 * l, a, b, 0.8 * region.texture]
}

fn squared(a: &ColorFeature, b: &ColorFeature) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

fn nearest(entries: &[ColorFeature], feature: &ColorFeature) -> u8 {
    let mut best = (0, f32::INFINITY);
    for (at, entry) in entries.iter().enumerate() {
        let distance = squared(entry, feature);
        if distance < best.1 {
            best = (at as u8, distance);
        }
    }
    best.0
}

/// Returns the initial palette entries for k-means.
///
/// It starts with the first region and repeatedly adds the one with the largest area-weighted
/// distance to all earlier entries.
fn spread_out(features: &[(ColorFeature, f32)]) -> Vec<ColorFeature> {
    let mut entries = vec![features[0].0];
    let mut apart: Vec<f32> = vec![f32::INFINITY; features.len()];
    while entries.len() < ENTRIES {
        let latest = entries[entries.len() - 1];
        let mut farthest = (0, -1.0);
        for (at, (feature, area)) in features.iter().enumerate() {
            apart[at] = apart[at].min(squared(feature, &latest));
            let weight = apart[at] * area;
            if weight > farthest.1 {
                farthest = (at, weight);
            }
        }
        entries.push(features[farthest.0].0);
    }
    entries
}

fn likeness(entries: &[ColorFeature]) -> Vec<f32> {
    let mut alike = Vec::with_capacity(ENTRIES * ENTRIES);
    for a in entries {
        let row: Vec<f32> = entries
            .iter()
            .map(|b| (-squared(a, b) / (2.0 * BANDWIDTH * BANDWIDTH)).exp())
            .collect();
        let sum: f32 = row.iter().sum();
        alike.extend(row.iter().map(|value| value / sum));
    }
    alike
}
