//! SuperGlue: matching by a network, and optimal transport of its scores.

use std::path::Path;

use rayon::prelude::*;

use super::keypoints::{load_only, match_twice};
use crate::sfm::{Descriptors, FeatureError, FeatureMatcher, Features};
use ostra_compute::nn::{Network, NnError, Tensor};

/// Options of [`SuperGlue`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuperGlueOptions {
    /// Number of keypoints used per image. The first are taken, as extractors return the strongest
    /// first; time grows with the square.
    pub most: usize,
    /// Number of keypoints in a first pass, if there are more. If hardly any of these match, the
    /// images do not overlap and are not matched further.
    pub first_keypoints: usize,
    /// Minimum share of a keypoint that is assigned to its partner, 0–1.
    pub least_share: f64,
}

impl Default for SuperGlueOptions {
    /// Uses the share that the authors published.
    fn default() -> Self {
        Self {
            most: 1024,
            first_keypoints: 512,
            least_share: 0.2,
        }
    }
}

/// Matches keypoints of [`super::SuperPoint`] by a network that sees all keypoints of both images.
///
/// Sarlin, DeTone, Malisiewicz, Rabinovich: "SuperGlue: Learning Feature Matching with Graph Neural
/// Networks", CVPR 2020.
#[derive(Debug)]
pub struct SuperGlue {
    network: Network,
    options: SuperGlueOptions,
}

/// Iterations of the transport, as published by the authors.
const ROUNDS: usize = 100;
/// Share of the longer side to which positions are scaled.
const SCALE: f64 = 0.7;

impl SuperGlue {
    /// Loads a network (`superglue-indoor`, `superglue-outdoor`) from a folder of networks.
    ///
    /// # Errors
    /// Fails if it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, name: &str, options: SuperGlueOptions) -> Result<Self, NnError> {
        Ok(Self::of_network(load_only(folder, name)?, options))
    }

    pub(super) fn of_network(network: Network, options: SuperGlueOptions) -> Self {
        Self { network, options }
    }

    /// Returns the scores of all pairs of the first `most` keypoints, `[1, first, second]`, and the score of no match.
    ///
    /// `None` if an image has no keypoints.
    pub(super) fn agreement(
        &self,
        both: [&Features; 2],
        most: usize,
    ) -> Result<Option<(Tensor, f32)>, FeatureError> {
        let [first, second] = both.map(|features| fed(features, most));
        let ([at0, confidence0, look0], [at1, confidence1, look1]) = (first?, second?);
        let (rows, columns) = (confidence0.shape()[1], confidence1.shape()[1]);
        if rows == 0 || columns == 0 {
            return Ok(None);
        }
        let given = [
            ("keypoints0", &at0),
            ("scores0", &confidence0),
            ("descriptors0", &look0),
            ("keypoints1", &at1),
            ("scores1", &confidence1),
            ("descriptors1", &look1),
        ];
        let answer = self.network.run(&given).map_err(|error| failed(&error))?;
        match <[Tensor; 2]>::try_from(answer) {
            Ok([agreement, alone])
                if agreement.shape() == [1, rows, columns] && alone.shape() == [1] =>
            {
                let alone = alone.as_floats().first().copied().unwrap_or_default();
                Ok(Some((agreement, alone)))
            }
            _ => Err(FeatureError::Network(
                "SuperGlue has other outputs than how keypoints agree".to_owned(),
            )),
        }
    }
}

fn failed(error: &NnError) -> FeatureError {
    FeatureError::Network(error.to_string())
}

/// Returns positions, scores and descriptors of the first `most` keypoints as the network takes them.
fn fed(features: &Features, most: usize) -> Result<[Tensor; 3], FeatureError> {
    let count = features.keypoints.len().min(most);
    let Descriptors::Floats { dim, values } = &features.descriptors else {
        return Err(FeatureError::Kinds(
            "SuperGlue matches the descriptors of SuperPoint only".to_owned(),
        ));
    };
    let size = glam::DVec2::new(f64::from(features.width), f64::from(features.height));
    // The network was trained on positions that count from the centre of the first pixel.
    let placed = features.keypoints[..count]
        .iter()
        .map(|&at| (at - 0.5 - size / 2.0) / (SCALE * size.max_element()));
    let positions = placed.flat_map(|at| [at.x as f32, at.y as f32]).collect();
    let made = |shape: &[usize], values: Vec<f32>| {
        Tensor::floats(shape, values).map_err(|error| failed(&error))
    };
    Ok([
        made(&[1, count, 2], positions)?,
        made(&[1, count], features.scores[..count].to_vec())?,
        made(&[1, count, *dim], values[..count * dim].to_vec())?,
    ])
}

impl FeatureMatcher for SuperGlue {
    fn name(&self) -> &'static str {
        "superglue"
    }

    fn matches(
        &self,
        first: &Features,
        second: &Features,
    ) -> Result<Vec<(u32, u32)>, FeatureError> {
        let SuperGlueOptions {
            most,
            first_keypoints,
            least_share,
        } = self.options;
        match_twice([first, second], first_keypoints, most, |most| {
            let Some((agreement, alone)) = self.agreement([first, second], most)? else {
                return Ok(Vec::new());
            };
            let columns = agreement.shape()[2];
            Ok(Transport::new(agreement.as_floats(), columns, alone, ROUNDS).mutual(least_share))
        })
    }
}

/// Shares of each keypoint of one image that are assigned to each of another, or to none.
///
/// Rows and columns are scaled in turn (Sinkhorn, Knopp: "Concerning Nonnegative Matrices and
/// Doubly Stochastic Matrices", Pacific Journal of Mathematics 1967) until each keypoint has given
/// one, and the unmatched row and column have taken the rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Transport {
    /// Keypoints of the second image, and one column for "no match".
    columns: usize,
    /// Row by row; the last row and column stand for "no match". Each value is divided by the
    /// scales of its row and column.
    kernel: Vec<f32>,
    of_rows: Vec<f64>,
    of_columns: Vec<f64>,
}

/// Columns that one thread adds up at a time.
const BAND: usize = 128;

impl Transport {
    /// Solves the transport for the scores `[rows][columns]` of all pairs and the score `alone` of no match.
    pub fn new(agreement: &[f32], columns: usize, alone: f32, rounds: usize) -> Self {
        let rows = agreement.len() / columns;
        let mut kernel = Vec::with_capacity((rows + 1) * (columns + 1));
        for row in agreement.chunks_exact(columns) {
            kernel.extend_from_slice(row);
            kernel.push(alone);
        }
        kernel.resize((rows + 1) * (columns + 1), alone);
        exponentials(&mut kernel, columns + 1);
        let share = |others: usize, count: usize| {
            let mut shares = vec![1.0; count + 1];
            shares[count] = others as f64;
            shares
        };
        let mut transport = Self {
            columns: columns + 1,
            kernel,
            of_rows: share(columns, rows),
            of_columns: share(rows, columns),
        };
        transport.balance(rounds);
        transport
    }

    /// Finds scales such that rows and columns sum to `of_rows` and `of_columns`.
    fn balance(&mut self, rounds: usize) {
        let (wanted_rows, wanted_columns) = (self.of_rows.clone(), self.of_columns.clone());
        let columns = self.columns;
        self.of_columns.fill(1.0);
        for _ in 0..rounds {
            let (kernel, of_columns) = (&self.kernel, &self.of_columns);
            self.of_rows
                .par_iter_mut()
                .enumerate()
                .for_each(|(row, scale)| {
                    let row_of = &kernel[row * columns..][..columns];
                    let sum: f64 = row_of
                        .iter()
                        .zip(of_columns)
                        .map(|(&value, scale)| f64::from(value) * scale)
                        .sum();
                    *scale = wanted_rows[row] / sum;
                });
            let of_rows = &self.of_rows;
            self.of_columns
                .par_chunks_mut(BAND)
                .enumerate()
                .for_each(|(band, scales)| {
                    let start = band * BAND;
                    scales.fill(0.0);
                    for (row, by) in kernel.chunks_exact(columns).zip(of_rows) {
                        let values = &row[start..start + scales.len()];
                        scales
                            .iter_mut()
                            .zip(values)
                            .for_each(|(sum, &value)| *sum += by * f64::from(value));
                    }
                    let wanted = &wanted_columns[start..start + scales.len()];
                    scales
                        .iter_mut()
                        .zip(wanted)
                        .for_each(|(scale, wanted)| *scale = wanted / *scale);
                });
        }
    }

    /// Returns pairs that are each other's largest share, if it is above `least`; ascending by the first.
    pub fn mutual(&self, least: f64) -> Vec<(u32, u32)> {
        let (rows, columns) = (self.of_rows.len() - 1, self.columns - 1);
        let mut best_of_column = vec![(0.0, 0); columns];
        let mut best_of_row = vec![(0.0, 0); rows];
        for (row, best) in best_of_row.iter_mut().enumerate() {
            let values = &self.kernel[row * self.columns..][..columns];
            for (column, (&value, of_column)) in values.iter().zip(&mut best_of_column).enumerate()
            {
                let share = f64::from(value) * self.of_rows[row] * self.of_columns[column];
                if share > best.0 {
                    *best = (share, column);
                }
                if share > of_column.0 {
                    *of_column = (share, row);
                }
            }
        }
        let confidence = best_of_row
            .iter()
            .enumerate()
            .filter(|&(row, &(share, column))| share > least && best_of_column[column].1 == row);
        confidence
            .map(|(row, &(_, column))| (row as u32, column as u32))
            .collect()
    }
}

/// Replaces all values by exponentials, after subtracting the largest of the row and then of the column.
///
/// The scales compensate for the subtraction, and nothing overflows.
fn exponentials(values: &mut [f32], columns: usize) {
    values.par_chunks_exact_mut(columns).for_each(|row| {
        let largest = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        row.iter_mut().for_each(|value| *value -= largest);
    });
    let mut largest = vec![f32::NEG_INFINITY; columns];
    for row in values.chunks_exact(columns) {
        largest
            .iter_mut()
            .zip(row)
            .for_each(|(largest, &value)| *largest = largest.max(value));
    }
    values.par_chunks_exact_mut(columns).for_each(|row| {
        row.iter_mut()
            .zip(&largest)
            .for_each(|(value, &largest)| *value = (*value - largest).exp());
    });
}
