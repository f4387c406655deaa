use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::neighbours::Neighbours;
use crate::SceneError;
use ostra_core::job::Progress;

/// Which points lie apart from all others.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OutlierOptions {
    /// Neighbours whose mean distance is taken; at least 1.
    pub neighbours: usize,
    /// Standard deviations above the mean of all points at which a point is an outlier; 0 or more.
    pub std_ratio: f64,
}

impl Default for OutlierOptions {
    fn default() -> Self {
        Self {
            neighbours: 16,
            std_ratio: 2.0,
        }
    }
}

/// Statistical outlier removal (Rusu, Marton, Blodow, Dolha, Beetz: *Towards 3D point cloud based object maps for
/// household environments*, Robotics and Autonomous Systems 2008): says for each point whether the mean distance to its
/// neighbours is above that of all points by more than so many standard deviations.
///
/// # Errors
/// [`SceneError::Stopped`].
pub fn outliers(
    points: &[Vec3],
    options: &OutlierOptions,
    progress: &Progress,
) -> Result<Vec<bool>, SceneError> {
    progress.stage("outliers")?;
    let Some(neighbours) = Neighbours::new(points) else {
        return Ok(Vec::new());
    };
    let mean_distance = |&point: &Vec3| {
        // The nearest of all is the point itself.
        let around = neighbours.nearest_n(point, options.neighbours.max(1) + 1);
        let others = around.get(1..).unwrap_or_default();
        others
            .iter()
            .map(|&(_, distance)| f64::from(distance))
            .sum::<f64>()
            / others.len().max(1) as f64
    };
    let distances: Vec<Vec<f64>> = points
        .par_chunks(4096)
        .map(|chunk| {
            progress
                .check()
                .map(|()| chunk.iter().map(mean_distance).collect())
        })
        .collect::<Result<_, _>>()?;
    let distances: Vec<f64> = distances.concat();
    let count = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / count;
    let variance = distances
        .iter()
        .map(|distance| (distance - mean).powi(2))
        .sum::<f64>()
        / count;
    let limit = mean + options.std_ratio * variance.sqrt();
    Ok(distances.iter().map(|&distance| distance > limit).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_apart_is_found() {
        let mut points: Vec<Vec3> = (0..900)
            .map(|i| Vec3::new((i % 30) as f32, (i / 30) as f32, 0.0))
            .collect();
        points.push(Vec3::new(15.0, 15.0, 9.0));
        points.push(Vec3::new(-12.0, 4.0, 0.0));
        let far = outliers(&points, &OutlierOptions::default(), &Progress::default()).unwrap();
        let found: Vec<usize> = (0..far.len()).filter(|&i| far[i]).collect();
        assert_eq!(found, [900, 901]);
        assert_eq!(
            outliers(&[], &OutlierOptions::default(), &Progress::default()).unwrap(),
            Vec::<bool>::new()
        );
        assert_eq!(
            outliers(
                &[Vec3::ONE],
                &OutlierOptions::default(),
                &Progress::default()
            )
            .unwrap(),
            [false]
        );
    }
}
