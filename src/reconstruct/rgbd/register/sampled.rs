use super::align::align;
use super::pairs::Pairs;
use ostra_geometry::Pose;
use ostra_geometry::ransac::{Estimator, RansacOptions, consensus};

/// How alike the edges of a sample must be in both clouds.
const EDGE_RATIO: f64 = 0.9;
const MAX_ITERATIONS: usize = 1_000_000;
const CONFIDENCE: f64 = 0.999;

/// The pose that most matched points agree on, over random samples of three whose edges have the same lengths in both
/// clouds (M. A. Fischler, R. C. Bolles, *Random sample consensus*, CACM 1981; the check of edges: A. G. Buch et al.,
/// *Pose estimation using local structure-specific shape and appearance context*, ICRA 2013).
pub fn sampled(pairs: &Pairs, min_agreeing: usize, seed: u64) -> Option<Pose> {
    let options = RansacOptions {
        confidence: CONFIDENCE,
        max_iterations: MAX_ITERATIONS,
        max_vain: MAX_ITERATIONS,
        min_inliers: min_agreeing,
        seed,
    };
    consensus(pairs, &options).map(|found| found.model)
}

impl Estimator for Pairs {
    type Model = Pose;
    const SAMPLE: usize = 3;

    fn count(&self) -> usize {
        self.points.len()
    }

    fn fit(&self, sample: &[usize], found: &mut Vec<Pose>) {
        let &[a, b, c] = sample else { return };
        if ![[a, b], [b, c], [c, a]]
            .iter()
            .all(|&[one, other]| self.fit_together(one, other, EDGE_RATIO))
        {
            return;
        }
        let pose = align(
            sample
                .iter()
                .map(|&pair| (self.points[pair][0], self.points[pair][1], 1.0)),
        );
        found.extend(pose.filter(|pose| sample.iter().all(|&pair| self.same_normal(pose, pair))));
    }

    fn cost(&self, pose: &Pose, enough: f64) -> f64 {
        Self::cost(self, pose, enough)
    }

    fn inliers(&self, pose: &Pose) -> Vec<u32> {
        self.within(pose)
    }

    fn refine(&self, pose: &Pose) -> Option<Pose> {
        self.refined(pose)
    }
}
