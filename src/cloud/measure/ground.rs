use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen};
use rand::RngExt;
use rand_pcg::Pcg32;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::point_sets::core_extent;
use super::trait_table::Dimension::Length;
use super::trait_table::Trait;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_core::statistics::quantile;
use ostra_masks::LabelId;

/// The plane above which heights are measured.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroundChoice {
    /// The largest plane among the unlabelled points that supports the labelled ones.
    ///
    /// If there is none, no heights are measured.
    #[default]
    Fitted,
    /// The plane through most points of a label, such as a table or the soil.
    Label(LabelId),
    /// All points `x` with `normal · x = offset`, in world units.
    ///
    /// Heights increase along the normal.
    Plane {
        /// The upward direction, of any length above 0.
        normal: [f64; 3],
        /// Distance from the origin times the length of the normal.
        offset: f64,
    },
}

/// An oriented plane.
pub(super) struct Ground {
    /// Unit vector.
    up: DVec3,
    offset: f64,
    definitions: [&'static str; 2],
}

/// Number of random triples of points.
const DRAWS: usize = 500;
/// Maximum number of points that each plane is tested on.
const TRIED: usize = 4000;
/// Maximum distance of a point from its plane, as a share of the extent of the labelled points.
const TOLERANCE: f64 = 0.01;
/// Share of the labelled points that are above a ground plane.
const ABOVE: f64 = 0.97;
/// Maximum height of the lowest labelled points above a ground plane, as a share of their extent.
const STANDS: f64 = 0.2;
/// Minimum share of the tested points that lie on a ground plane.
const LEAST: f64 = 0.05;

impl Ground {
    /// Determines the ground plane of a cloud, if there is one.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Request`] if a label has no points on a plane or the normal has length
    /// 0. Returns [`SceneError::Stopped`] if the job is stopped.
    pub(super) fn of(
        cloud: &LabelledCloud,
        choice: &GroundChoice,
        progress: &Progress,
    ) -> Result<Option<Self>, SceneError> {
        match *choice {
            GroundChoice::Fitted => {
                let definitions = [
                    "height of the highest point above the plane fitted to the points without a label that the labelled \
                     ones stand on",
                    "height of the lowest point above the plane fitted to the points without a label that the labelled \
                     ones stand on",
                ];
                Self::fitted(cloud, LabelId::NONE, definitions, progress)
            }
            GroundChoice::Label(id) => {
                let definitions = [
                    "height of the highest point above the plane fitted to the label chosen as ground",
                    "height of the lowest point above the plane fitted to the label chosen as ground",
                ];
                let name = cloud
                    .tree
                    .get(id)
                    .map_or_else(|| id.0.to_string(), |label| label.name.clone());
                let missing = || {
                    SceneError::Request(format!(
                        "'{name}' has no points on a plane; choose another label as ground"
                    ))
                };
                Self::fitted(cloud, id, definitions, progress)?
                    .ok_or_else(missing)
                    .map(Some)
            }
            GroundChoice::Plane { normal, offset } => {
                let normal = DVec3::from(normal);
                let up = normal
                    .try_normalize()
                    .filter(|_| offset.is_finite())
                    .ok_or_else(|| {
                        SceneError::Request("the ground normal must not be 0,0,0".into())
                    })?;
                let definitions = [
                    "height of the highest point above the given plane",
                    "height of the lowest point above the given plane",
                ];
                Ok(Some(Self {
                    up,
                    offset: offset / normal.length(),
                    definitions,
                }))
            }
        }
    }

    /// Fits the plane through most points of `id` that supports the other labelled points.
    ///
    /// The plane is found by RANSAC (Fischler, Bolles, "Random sample consensus", Communications of
    /// the ACM 1981) and refined by least squares.
    fn fitted(
        cloud: &LabelledCloud,
        id: LabelId,
        definitions: [&'static str; 2],
        progress: &Progress,
    ) -> Result<Option<Self>, SceneError> {
        let own = |label: LabelId| label == id || cloud.tree.path(label).contains(&id);
        let floor = sample(cloud, own);
        let standing = sample(cloud, |label| label != LabelId::NONE && !own(label));
        let is_chosen = id != LabelId::NONE;
        let Some(extent) = core_extent(if standing.is_empty() {
            &floor
        } else {
            &standing
        }) else {
            return Ok(None);
        };
        let tolerance = TOLERANCE * extent;
        let mut dice = Pcg32::new(5, 29);
        let mut best: Option<(usize, Self)> = None;
        for _ in 0..DRAWS {
            progress.check()?;
            if floor.len() < 3 {
                break;
            }
            let [a, b, c] = [(); 3].map(|()| floor[dice.random_range(0..floor.len())]);
            let Some(normal) = (b - a).cross(c - a).try_normalize() else {
                continue;
            };
            let plane = Self {
                up: normal,
                offset: normal.dot(a),
                definitions,
            }
            .upright(&standing);
            let held = floor
                .iter()
                .filter(|&&x| plane.height(x).abs() <= tolerance)
                .count();
            let better = best.as_ref().is_none_or(|(most, _)| held > *most);
            if better && (is_chosen || plane.carries(&standing, extent)) {
                best = Some((held, plane));
            }
        }
        let enough =
            best.filter(|(held, _)| *held >= 3 && *held as f64 >= LEAST * floor.len() as f64);
        Ok(enough.map(|(_, plane)| plane.refined(&floor, tolerance).refined(&floor, tolerance)))
    }

    /// Returns the plane, oriented so that most of the points are above it.
    fn upright(self, points: &[DVec3]) -> Self {
        let above = points.iter().filter(|&&x| self.height(x) > 0.0).count();
        if 2 * above >= points.len() {
            self
        } else {
            Self {
                up: -self.up,
                offset: -self.offset,
                ..self
            }
        }
    }

    fn carries(&self, points: &[DVec3], extent: f64) -> bool {
        let mut heights: Vec<f64> = points.iter().map(|&x| self.height(x)).collect();
        let Some(lowest) = quantile(&mut heights, 1.0 - ABOVE) else {
            return false;
        };
        (-TOLERANCE * extent..=STANDS * extent).contains(&lowest)
    }

    fn refined(self, points: &[DVec3], tolerance: f64) -> Self {
        let held: Vec<DVec3> = points
            .iter()
            .copied()
            .filter(|&x| self.height(x).abs() <= tolerance)
            .collect();
        if held.len() < 3 {
            return self;
        }
        let mean = held.iter().sum::<DVec3>() / held.len() as f64;
        let mut scatter = Matrix3::<f64>::zeros();
        for &x in &held {
            let d = nalgebra::Vector3::from((x - mean).to_array());
            scatter += d * d.transpose();
        }
        let eigen = SymmetricEigen::new(scatter);
        let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin());
        let up = DVec3::new(normal[0], normal[1], normal[2]).normalize_or(self.up);
        let up = if up.dot(self.up) < 0.0 { -up } else { up };
        Self {
            up,
            offset: up.dot(mean),
            ..self
        }
    }

    fn height(&self, x: DVec3) -> f64 {
        self.up.dot(x) - self.offset
    }

    /// Returns the heights of the highest and the lowest of some points.
    pub(super) fn traits(&self, points: &[DVec3]) -> Vec<Trait> {
        let heights = || points.iter().map(|&x| self.height(x));
        let (Some(highest), Some(lowest)) = (
            heights().max_by(f64::total_cmp),
            heights().min_by(f64::total_cmp),
        ) else {
            return Vec::new();
        };
        let found =
            |name, value, definition| Trait::new(name, value, Length, definition, points.len());
        let [top, bottom] = self.definitions;
        vec![
            found("height_max", highest, top),
            found("height_min", lowest, bottom),
        ]
    }
}

/// Returns a uniform sample of the points whose label satisfies `wanted`.
fn sample(cloud: &LabelledCloud, wanted: impl Fn(LabelId) -> bool) -> Vec<DVec3> {
    let table: Vec<bool> = (0..=u16::MAX).map(|id| wanted(LabelId(id))).collect();
    let labelled = cloud.positions.iter().zip(&cloud.labels);
    let all: Vec<DVec3> = labelled
        .filter(|(x, label)| table[usize::from(label.0)] && x.is_finite())
        .map(|(x, _)| x.as_dvec3())
        .collect();
    all.iter()
        .copied()
        .step_by(all.len().div_ceil(TRIED).max(1))
        .collect()
}
