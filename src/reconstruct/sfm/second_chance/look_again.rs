use rayon::prelude::*;

use super::attempt::Attempt;
use crate::sfm::matching::NearestMatcher;
use crate::sfm::tilted::{Merged, one_to_one};
use crate::sfm::verify::verify;
use crate::sfm::{FeatureMatcher, Features, PictureFeatures, SfmError, SparseModel, TriedPair};
use ostra_core::job::Progress;

/// Images of the model that an image is compared with, those first with which it has most matches.
const NEIGHBOURS: usize = 24;

/// More matches of one image.
pub(super) struct Gained {
    /// Its features, with those of tilted views behind its own.
    pub picture: PictureFeatures,
    /// Pairs of which more matches agree than before.
    pub pairs: Vec<TriedPair>,
}

/// Looks for matches of an image that no model holds with those of a model.
pub(super) struct LookAgain<'a> {
    pub attempt: &'a Attempt,
    pub model: &'a SparseModel,
    pub image: usize,
    pub seed: u64,
}

/// Matches of one view: number of the view, keypoints of view and neighbour.
type OfView = (usize, Vec<(u32, u32)>);

impl LookAgain<'_> {
    /// Matches of the image and of its tilted `views`; `None` where no more agree than before, or fewer than `enough` with
    /// any one image: too few for a place.
    pub fn gains(
        &self,
        views: &[PictureFeatures],
        enough: usize,
        progress: &Progress,
    ) -> Result<Option<Gained>, SfmError> {
        let own = &self.attempt.pictures[self.image];
        let all: Vec<&PictureFeatures> = std::iter::once(own).chain(views).collect();
        let neighbours = self.neighbours();
        let mut merged = Merged::new(own);
        let mut found = Vec::with_capacity(neighbours.len());
        for by_view in self.matches(&all, &neighbours, progress)? {
            let numbered = by_view.into_iter().flat_map(|(view, matches)| {
                let numbers: Vec<_> = matches
                    .into_iter()
                    .map(|(index, other)| (merged.number(all[view], index), other))
                    .collect();
                numbers
            });
            found.push(one_to_one(numbered));
        }
        let picture = merged.into_picture();
        let tried = neighbours
            .par_iter()
            .zip(&found)
            .map(|(&other, found)| self.verified(&picture, other, found));
        let pairs: Vec<TriedPair> = tried
            .filter(|pair| agreeing(pair) > self.agreed(pair.images))
            .collect();
        Ok(pairs
            .iter()
            .any(|pair| agreeing(pair) >= enough)
            .then_some(Gained { picture, pairs }))
    }

    /// Images of the model, ascending.
    fn neighbours(&self) -> Vec<usize> {
        let matches = |other: u32| {
            let pair = ordered(self.image as u32, other);
            self.attempt
                .tried
                .iter()
                .find(|tried| tried.images == pair)
                .map_or(0, |tried| tried.matches)
        };
        let mut ranked: Vec<(usize, u32)> = self
            .model
            .placed()
            .map(|other| (matches(other), other))
            .collect();
        ranked.sort_unstable_by_key(|&(matches, other)| (std::cmp::Reverse(matches), other));
        ranked.truncate(NEIGHBOURS);
        let mut neighbours: Vec<usize> = ranked
            .into_iter()
            .map(|(_, other)| other as usize)
            .collect();
        neighbours.sort_unstable();
        neighbours
    }

    /// By neighbour the matches of each view. Nearest neighbours whatever the matcher in use: there are many views.
    fn matches(
        &self,
        views: &[&PictureFeatures],
        neighbours: &[usize],
        progress: &Progress,
    ) -> Result<Vec<Vec<OfView>>, SfmError> {
        let others = neighbours
            .iter()
            .map(|&other| &self.attempt.pictures[other]);
        let set: Vec<&Features> = views
            .iter()
            .copied()
            .chain(others)
            .map(|picture| &picture.features)
            .collect();
        let matcher = match set[0].descriptors.as_bytes() {
            Some(_) => NearestMatcher::for_bytes(),
            None => NearestMatcher::for_floats(),
        };
        let matcher = matcher.of_set(&set)?;
        let of_neighbour = |other: usize| {
            let of_view = |view: usize| {
                progress.check()?;
                Ok((view, matcher(view, views.len() + other)?))
            };
            (0..views.len()).map(of_view).collect()
        };
        (0..neighbours.len())
            .into_par_iter()
            .map(of_neighbour)
            .collect()
    }

    /// What agrees of the matches of the picture, which is this image's, with another image.
    fn verified(
        &self,
        picture: &PictureFeatures,
        other: usize,
        matches: &[(u32, u32)],
    ) -> TriedPair {
        let camera =
            |image: usize| self.attempt.problem.cameras[self.attempt.problem.images[image].camera];
        let own = (self.image, &picture.features, camera(self.image));
        let other = (other, &self.attempt.pictures[other].features, camera(other));
        if own.0 < other.0 {
            return verify([own, other], matches, self.seed);
        }
        let turned: Vec<(u32, u32)> = matches.iter().map(|&(a, b)| (b, a)).collect();
        verify([other, own], &turned, self.seed)
    }

    /// Matches of a pair that agreed in the first attempt.
    fn agreed(&self, images: [u32; 2]) -> usize {
        self.attempt
            .tried
            .iter()
            .find(|pair| pair.images == images)
            .map_or(0, agreeing)
    }
}

fn agreeing(pair: &TriedPair) -> usize {
    pair.verified.as_ref().map_or(0, |pair| pair.matches.len())
}

fn ordered(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}
