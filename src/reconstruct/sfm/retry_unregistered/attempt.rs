//! What the first attempt reached, and what a search adds to it.

use std::collections::BTreeMap;

use crate::sfm::registration_report::FEW_FEATURES;
use crate::sfm::{ImageFeatures, MapProblem, Mapped, TriedPair};
use ostra_core::job::{PlannedStage, Progress, Stopped};

/// Input of the mapper, and its result.
pub(in crate::sfm) struct Attempt {
    /// The mapping problem.
    pub problem: MapProblem,
    /// Features by image.
    pub images: Vec<ImageFeatures>,
    /// All pairs that were matched.
    pub tried: Vec<TriedPair>,
    /// The models, the kept one first.
    pub models: Vec<Mapped>,
}

/// A model with more images, and the matches that led to them.
pub(super) struct Extended {
    pub model: Mapped,
    pub problem: MapProblem,
    pub gains: Gains,
}

/// Additional matches of images that were left out.
#[derive(Default)]
pub(super) struct Gains {
    /// Features of images that have more of them now, the known ones first.
    pub images: BTreeMap<usize, ImageFeatures>,
    /// Pairs that are new, or for which more matches agree than before.
    pub pairs: Vec<TriedPair>,
}

impl Attempt {
    /// Returns all matched pairs, with the additional ones.
    fn tried_with(&self, gains: &Gains) -> Vec<TriedPair> {
        let mut tried = self.tried.clone();
        for pair in &gains.pairs {
            match tried.iter_mut().find(|known| known.images == pair.images) {
                Some(known) => known.clone_from(pair),
                None => tried.push(pair.clone()),
            }
        }
        tried
    }

    /// Returns the problem, extended by the additional matches.
    pub(super) fn problem_with(&self, gains: &Gains) -> MapProblem {
        let mut problem = self.problem.clone();
        for (&image, found) in &gains.images {
            problem.images[image]
                .keypoints
                .clone_from(&found.features.keypoints);
        }
        let tried = self.tried_with(gains);
        problem.pairs = tried.into_iter().filter_map(|pair| pair.verified).collect();
        problem
    }

    /// Takes over a model with more images.
    pub(super) fn take(&mut self, extended: Extended) {
        self.tried = self.tried_with(&extended.gains);
        self.problem = extended.problem;
        self.images_take(extended.gains.images);
        self.models[0] = extended.model;
    }

    fn images_take(&mut self, images: BTreeMap<usize, ImageFeatures>) {
        for (image, found) in images {
            self.images[image] = found;
        }
    }
}

/// Begins a search, and announces what follows it.
pub(super) fn begin(progress: &Progress, search: PlannedStage) -> Result<(), Stopped> {
    let placing = PlannedStage::new(
        "place unregistered images",
        "Place left-over images",
        0.2 * search.weight,
    );
    let name = search.name;
    progress.plan_next(&[search, placing]);
    progress.stage(name)
}

/// Returns the images that no model contains although they have enough features.
pub(super) fn left_out(attempt: &Attempt) -> Vec<usize> {
    let is_placed = |image: usize| {
        attempt
            .models
            .iter()
            .any(|mapped| mapped.model.is_placed(image as u32))
    };
    let is_rich = |image: usize| attempt.images[image].features.keypoints.len() >= FEW_FEATURES;
    let mut images: Vec<usize> = (0..attempt.images.len())
        .filter(|&image| is_rich(image) && !is_placed(image))
        .collect();
    let most_matches = |image: usize| {
        let own = attempt
            .tried
            .iter()
            .filter(|pair| pair.images.contains(&(image as u32)));
        own.map(|pair| pair.matches).max()
    };
    images.sort_by_cached_key(|&image| (std::cmp::Reverse(most_matches(image)), image));
    images
}

/// Returns how many images the kept model contains.
pub(super) fn placed(models: &[Mapped]) -> usize {
    models.first().map_or(0, |kept| kept.model.placed().count())
}
