//! Plays the simulated user on a case and records its clicks.

use std::collections::BTreeMap;

use ostra_eval::simulated_click::next_label_click;
use ostra_masks::graph_cut::ranked_click::{ClickCandidates, RankedClick, RankedFrame};
use ostra_masks::graph_cut::ranking::{ClickKind, TERMS, Weights, best};
use ostra_masks::{Click, LabelId, LabelMask, Region};

use crate::cases::Case;

/// A click of a game: the gain in mean IoU of each candidate.
pub struct Sample {
    pub clip: String,
    pub kind: ClickKind,
    pub terms: Vec<[f32; TERMS]>,
    pub gains: Vec<f32>,
    pub shared: Vec<Vec<f32>>,
}

/// Chooses among the candidates of a click by their features and gains.
pub type Choose<'a> = dyn FnMut(&ClickCandidates, &[f32]) -> usize + 'a;

/// Returns the mean IoU over the objects after each round of one click per object.
pub fn play(case: &Case, choose: &mut Choose<'_>) -> Vec<f32> {
    let (frame, truth) = case.load();
    let mut game = Game::new(&frame, &truth);
    let most = case.clicks * game.objects.len();
    let mut means = Vec::new();
    for given in 0..most {
        // Each object gets one click first; all further clicks go into the largest error.
        let left: Vec<LabelId> = game
            .objects
            .iter()
            .copied()
            .filter(|id| game.given(*id) < case.clicks)
            .collect();
        let new: Vec<LabelId> = left
            .iter()
            .copied()
            .filter(|id| game.given(*id) == 0)
            .collect();
        let open = if new.is_empty() { left } else { new };
        let Some(next) = next_label_click(&truth, &game.mask, &open) else {
            break;
        };
        game.answer(next.label, next.click, choose);
        if (given + 1) % game.objects.len() == 0 {
            means.push(game.mean_iou());
        }
    }
    if means.is_empty() {
        means.push(game.mean_iou());
    }
    means
}

/// Plays with the current weights, sometimes with another candidate, and records every click.
pub fn explore(case: &Case, weights: &Weights, seed: u64) -> Vec<Sample> {
    let mut samples = Vec::new();
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    play(case, &mut |found, gains| {
        samples.push(Sample {
            clip: case.clip.clone(),
            kind: found.kind,
            terms: found.terms.clone(),
            gains: gains.to_vec(),
            shared: found.shared.clone(),
        });
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        match state >> 60 {
            0..2 => (state >> 20) as usize % found.changes.len(),
            2..5 => oracle(gains),
            _ => best(weights, found.kind, &found.terms, &found.shared).unwrap(),
        }
    });
    samples
}

/// Returns the candidate with the largest gain.
pub fn oracle(gains: &[f32]) -> usize {
    (0..gains.len())
        .max_by(|&a, &b| gains[a].total_cmp(&gains[b]))
        .unwrap()
}

/// A frame that is being labelled.
struct Game<'a> {
    frame: &'a RankedFrame,
    truth: &'a LabelMask,
    objects: Vec<LabelId>,
    mask: LabelMask,
    clicks: BTreeMap<LabelId, Vec<Click>>,
}

impl<'a> Game<'a> {
    fn new(frame: &'a RankedFrame, truth: &'a LabelMask) -> Self {
        let mut objects: Vec<LabelId> = truth
            .ids
            .iter()
            .copied()
            .filter(|&id| id != LabelId::NONE)
            .collect();
        objects.sort_unstable();
        objects.dedup();
        Self {
            frame,
            truth,
            objects,
            mask: LabelMask::empty(truth.width, truth.height),
            clicks: BTreeMap::new(),
        }
    }

    fn given(&self, label: LabelId) -> usize {
        self.clicks.get(&label).map_or(0, Vec::len)
    }

    /// Applies a click as the session does.
    ///
    /// The label under the click gives way; the others keep their pixels.
    fn answer(&mut self, label: LabelId, click: Click, choose: &mut Choose<'_>) {
        let at = click.pixel_in(self.mask.width, self.mask.height).unwrap();
        let contested = if click.include {
            self.mask.ids[at]
        } else {
            LabelId::NONE
        };
        let free = |id: LabelId| id == LabelId::NONE || id == label || id == contested;
        let rivals = self
            .clicks
            .iter()
            .filter(|(id, _)| **id != label)
            .flat_map(|(_, clicks)| clicks);
        let rivals = rivals.filter(|click| click.include).map(|click| Click {
            include: false,
            ..*click
        });
        let earlier: Vec<Click> = rivals
            .chain(self.clicks.get(&label).into_iter().flatten().copied())
            .collect();
        self.clicks.entry(label).or_default().push(click);
        let taken = Region {
            inside: self.mask.ids.iter().map(|&id| !free(id)).collect(),
            ..self.mask.region(label)
        };
        let previous = self.mask.region(label);
        let request = RankedClick {
            click,
            earlier: &earlier,
            previous: (!previous.is_empty()).then_some(&previous),
            taken: &taken,
        };
        let answer = self.frame.answer(&request, &mut |found| {
            let gains = self.gains(found, label, contested, click.include);
            choose(found, &gains)
        });
        for (id, &inside) in self.mask.ids.iter_mut().zip(&answer.inside) {
            *id = match (inside, *id) {
                (true, _) => label,
                (false, id) if id == label => LabelId::NONE,
                (false, id) => id,
            };
        }
    }

    /// Returns the gain in mean IoU of each candidate, by counts per region.
    fn gains(
        &self,
        found: &ClickCandidates,
        label: LabelId,
        contested: LabelId,
        include: bool,
    ) -> Vec<f32> {
        let changing = |id: LabelId| match include {
            true => id == LabelId::NONE || id == contested,
            false => id == label,
        };
        let to = if include { label } else { LabelId::NONE };
        let mut counts = Counts::new();
        // Number of (truth, current) pairs that would change, per region.
        let mut movable: Vec<BTreeMap<(LabelId, LabelId), f32>> =
            vec![BTreeMap::new(); self.frame.region_count()];
        for ((&region, &truth), &current) in self
            .frame
            .region_of_pixel()
            .iter()
            .zip(&self.truth.ids)
            .zip(&self.mask.ids)
        {
            *counts.entry((truth, current)).or_default() += 1.0;
            if changing(current) {
                *movable[region as usize]
                    .entry((truth, current))
                    .or_default() += 1.0;
            }
        }
        let before = mean_iou(&counts, &self.objects);
        let gain = |change: &[bool]| {
            let mut counts = counts.clone();
            for (pairs, _) in movable.iter().zip(change).filter(|(_, change)| **change) {
                for (&(truth, current), &pixels) in pairs {
                    *counts.entry((truth, current)).or_default() -= pixels;
                    *counts.entry((truth, to)).or_default() += pixels;
                }
            }
            mean_iou(&counts, &self.objects) - before
        };
        found.changes.iter().map(|change| gain(change)).collect()
    }

    fn mean_iou(&self) -> f32 {
        let mut counts = Counts::new();
        for pair in self
            .truth
            .ids
            .iter()
            .copied()
            .zip(self.mask.ids.iter().copied())
        {
            *counts.entry(pair).or_default() += 1.0;
        }
        mean_iou(&counts, &self.objects)
    }
}

/// Number of pixels per (truth, current) pair.
type Counts = BTreeMap<(LabelId, LabelId), f32>;

fn mean_iou(counts: &Counts, objects: &[LabelId]) -> f32 {
    let of = |object: LabelId| {
        let sum = |keep: &dyn Fn(LabelId, LabelId) -> bool| -> f32 {
            counts
                .iter()
                .filter(|((truth, current), _)| keep(*truth, *current))
                .map(|(_, pixels)| pixels)
                .sum()
        };
        sum(&|truth, current| truth == object && current == object)
            / sum(&|truth, current| truth == object || current == object).max(1.0)
    };
    objects.iter().map(|&object| of(object)).sum::<f32>() / objects.len().max(1) as f32
}
