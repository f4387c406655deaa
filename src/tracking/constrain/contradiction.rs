use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::options::ConstrainOptions;
use ostra_cloud::doubt::{Sighted, mask_has_near};
use ostra_masks::{Connectivity, LabelId, LabelMask, Region, components};

/// Where geometry contradicts a mask, but for borders that lie a little aside.
pub struct Contradictions {
    /// For each contradicted pixel the label that geometry gives it, 0 = nothing; `None` elsewhere.
    pub given: Vec<Option<LabelId>>,
    /// Labels whose pixels were taken away or given.
    pub touched: BTreeSet<LabelId>,
    /// Objects that geometry has mostly elsewhere (swapped with others, drifted away or lost), with what most of their
    /// pixels are given.
    pub strayed: BTreeMap<LabelId, LabelId>,
}

/// A label in a mask, and the other one that geometry has there.
type Pair = (LabelId, LabelId);

impl Contradictions {
    pub fn find(mask: &LabelMask, sighted: &Sighted, options: &ConstrainOptions) -> Self {
        let is_core: Vec<bool> = (0..mask.ids.len())
            .into_par_iter()
            .map(|at| is_beyond_borders(mask, sighted, at, options.border_px))
            .collect();
        let pair = |at: usize| Some((mask.ids[at], sighted.labels[at]?));
        let mut cores: BTreeMap<Pair, usize> = BTreeMap::new();
        (0..is_core.len())
            .filter(|&at| is_core[at])
            .filter_map(pair)
            .for_each(|pair| *cores.entry(pair).or_default() += 1);
        let strayed = strayed(mask, sighted, &cores, options);
        let (mut given, mut touched) = (vec![None; mask.ids.len()], BTreeSet::new());
        for &(held, label) in cores.keys() {
            let inside = (0..mask.ids.len())
                .map(|at| pair(at) == Some((held, label)))
                .collect();
            let patches = components(
                &Region {
                    width: mask.width,
                    height: mask.height,
                    inside,
                },
                Connectivity::Eight,
            );
            let mut of_patches = vec![0; patches.areas.len() + 1];
            patches
                .labels
                .iter()
                .zip(&is_core)
                .for_each(|(&at, &core)| of_patches[at as usize] += usize::from(core));
            let has_strayed = strayed.contains_key(&held) || strayed.contains_key(&label);
            let least = if has_strayed { 1 } else { options.least_area };
            for (given, &patch) in given.iter_mut().zip(&patches.labels) {
                if patch > 0 && of_patches[patch as usize] >= least {
                    *given = Some(label);
                    touched.extend([held, label]);
                }
            }
        }
        touched.remove(&LabelId::NONE);
        Self {
            given,
            touched,
            strayed,
        }
    }
}

/// Whether mask and geometry differ in a pixel, and either has the other's label nowhere near.
fn is_beyond_borders(mask: &LabelMask, sighted: &Sighted, at: usize, border_px: u32) -> bool {
    let held = mask.ids[at];
    sighted.labels[at].is_some_and(|label| {
        label != held
            && (!mask_has_near(mask, at, border_px, label)
                || !sighted.has_near(at, border_px, held))
    })
}

/// Labels contradicted in more pixels than mask and geometry agree in, with the label that takes most of theirs.
fn strayed(
    mask: &LabelMask,
    sighted: &Sighted,
    cores: &BTreeMap<Pair, usize>,
    options: &ConstrainOptions,
) -> BTreeMap<LabelId, LabelId> {
    let mut agreed: BTreeMap<LabelId, usize> = BTreeMap::new();
    let both = mask
        .ids
        .iter()
        .zip(&sighted.labels)
        .filter(|&(&held, &label)| label == Some(held));
    both.for_each(|(&held, _)| *agreed.entry(held).or_default() += 1);
    let labels: BTreeSet<LabelId> = cores
        .keys()
        .flat_map(|&(held, label)| [held, label])
        .collect();
    let has_strayed = |label: &LabelId| {
        let of_label = cores
            .iter()
            .filter(|&(&(held, given), _)| held == *label || given == *label);
        let contradicted: usize = of_label.map(|(_, count)| count).sum();
        contradicted >= options.least_area && contradicted > agreed.get(label).copied().unwrap_or(0)
    };
    let taken_by = |label: LabelId| {
        let taken = cores.iter().filter(|&(&(held, _), _)| held == label);
        taken
            .max_by_key(|&(_, count)| count)
            .map_or(LabelId::NONE, |(&(_, given), _)| given)
    };
    let labels = labels
        .into_iter()
        .filter(|&label| label != LabelId::NONE)
        .filter(has_strayed);
    labels.map(|label| (label, taken_by(label))).collect()
}
