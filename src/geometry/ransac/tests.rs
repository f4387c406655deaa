use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;

/// A line `y = slope · x + offset` through points.
struct Line {
    points: Vec<[f64; 2]>,
    limit: f64,
}

impl Line {
    fn miss(&self, line: &[f64; 2], i: usize) -> f64 {
        (self.points[i][1] - line[0] * self.points[i][0] - line[1]).abs()
    }
}

impl Estimator for Line {
    type Model = [f64; 2];
    const SAMPLE: usize = 2;

    fn count(&self) -> usize {
        self.points.len()
    }

    fn fit(&self, sample: &[usize], found: &mut Vec<[f64; 2]>) {
        let ([a, b], [c, d]) = (self.points[sample[0]], self.points[sample[1]]);
        assert_ne!(sample[0], sample[1]);
        let slope = (d - b) / (c - a);
        found.push([slope, b - slope * a]);
    }

    fn cost(&self, line: &[f64; 2], _enough: f64) -> f64 {
        (0..self.points.len())
            .map(|i| self.miss(line, i).min(self.limit).powi(2))
            .sum()
    }

    fn inliers(&self, line: &[f64; 2]) -> Vec<u32> {
        (0..self.points.len() as u32)
            .filter(|&i| self.miss(line, i as usize) < self.limit)
            .collect()
    }

    fn refine(&self, line: &[f64; 2]) -> Option<[f64; 2]> {
        let chosen: Vec<[f64; 2]> = self
            .inliers(line)
            .iter()
            .map(|&i| self.points[i as usize])
            .collect();
        let count = chosen.len() as f64;
        let mean = [0, 1].map(|k| chosen.iter().map(|p| p[k]).sum::<f64>() / count);
        let [xy, xx] = [1, 0].map(|k| {
            chosen
                .iter()
                .map(|p| (p[0] - mean[0]) * (p[k] - mean[k]))
                .sum::<f64>()
        });
        (count > 2.0).then(|| [xy / xx, mean[1] - xy / xx * mean[0]])
    }
}

fn points(good: usize, bad: usize) -> Line {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let mut points: Vec<[f64; 2]> = Vec::new();
    for i in 0..good + bad {
        let x: f64 = random.random_range(-10.0..10.0);
        let noise = random.random_range(-0.05..0.05);
        // Inliers last: the order must not matter.
        points.push([
            x,
            if i < bad {
                random.random_range(-20.0..20.0)
            } else {
                2.0 * x - 1.0 + noise
            },
        ]);
    }
    Line { points, limit: 0.1 }
}

const OPTIONS: RansacOptions = RansacOptions {
    confidence: 0.999,
    max_iterations: 5000,
    max_vain: 1000,
    min_inliers: 10,
    seed: 3,
};

#[test]
fn line_is_found_among_outliers_and_reproduced() {
    let lines = points(60, 140);
    let found = consensus(&lines, &OPTIONS).unwrap();
    assert!(
        (found.model[0] - 2.0).abs() < 2e-3 && (found.model[1] + 1.0).abs() < 1e-2,
        "{:?}",
        found.model
    );
    assert!(found.inliers.len() >= 60 && found.inliers.is_sorted());
    assert_eq!(found, consensus(&lines, &OPTIONS).unwrap());
}

#[test]
fn too_few_inliers_give_none() {
    assert_eq!(consensus(&points(5, 60), &OPTIONS), None);
    assert_eq!(consensus(&points(9, 0), &OPTIONS), None);
    assert_eq!(
        consensus(
            &points(0, 0),
            &RansacOptions {
                min_inliers: 0,
                ..OPTIONS
            }
        ),
        None
    );
}
