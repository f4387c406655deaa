use serde::{Deserialize, Serialize};

use crate::SceneError;

/// When points of a label are one instance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct InstanceOptions {
    /// Points at most this many spacings (median distances to the nearest neighbour) apart are neighbours, 1.5–20.
    pub radius: f64,
    /// A point links others only if it has so many neighbours, 1–100: stray points of noise between two things have few.
    pub min_neighbours: usize,
    /// Groups of fewer points are no instance, 1–1 000 000.
    pub min_points: usize,
}

impl Default for InstanceOptions {
    fn default() -> Self {
        Self {
            radius: 3.0,
            min_neighbours: 5,
            min_points: 50,
        }
    }
}

impl InstanceOptions {
    /// Whether every number is in its range.
    ///
    /// # Errors
    /// [`SceneError::Request`] naming the first that is not.
    pub fn check(&self) -> Result<(), SceneError> {
        let ranges = [
            ("radius in spacings", self.radius, 1.5, 20.0),
            (
                "smallest number of neighbours",
                self.min_neighbours as f64,
                1.0,
                100.0,
            ),
            (
                "smallest instance in points",
                self.min_points as f64,
                1.0,
                1e6,
            ),
        ];
        match ranges
            .into_iter()
            .find(|(_, value, low, high)| !(low..=high).contains(&value))
        {
            Some((what, value, low, high)) => Err(SceneError::Request(format!(
                "the {what} is {value}; choose {low} to {high}"
            ))),
            None => Ok(()),
        }
    }
}
