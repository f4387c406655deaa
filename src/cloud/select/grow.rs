//! Region growing by similarity, and the connected components of a selection.

use glam::{IVec3, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::points::Neighbours;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{lab_of_pixel, squared_difference};

/// Maximum distance between neighbours, in spacings of the cloud.
const REACH: f32 = 2.5;
/// Number of neighbours that are examined.
const NEIGHBOURS: usize = 12;

/// Similarity that points need to be added to a selection.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Likeness {
    /// Maximum angle between the normals of neighbours, in degrees, 0–180.
    ///
    /// A point without a normal is similar to any other.
    pub normal_deg: f32,
    /// Maximum colour difference from the starting point, as CIE 1976 ΔE, 0 or above.
    pub color: f32,
}

impl Default for Likeness {
    fn default() -> Self {
        Self {
            normal_deg: 20.0,
            color: 15.0,
        }
    }
}

impl Likeness {
    /// Adds the points that can be reached from `inside` over similar neighbours.
    ///
    /// Normals are compared between neighbours, so they may turn gradually (Rabbani, van den
    /// Heuvel, Vosselman, Segmentation of point clouds using smoothness constraint, ISPRS 2006).
    /// Colours are compared with the starting point.
    pub(super) fn grow(
        &self,
        cloud: &LabelledCloud,
        neighbours: &Neighbours,
        spacing: f32,
        inside: &mut [bool],
        progress: &Progress,
    ) -> Result<(), SceneError> {
        let sound = (0.0..=180.0).contains(&self.normal_deg) && self.color >= 0.0;
        if !sound {
            return Err(SceneError::Request(
                "the angle must be 0 to 180 degrees, the colour difference at least 0".into(),
            ));
        }
        let (least_cosine, most) = (self.normal_deg.to_radians().cos(), self.color * self.color);
        let alike = |from: u32, seed: u32, to: usize| {
            let (a, b) = (cloud.normals[from as usize], cloud.normals[to]);
            let smooth = a == glam::Vec3::ZERO || b == glam::Vec3::ZERO || a.dot(b) >= least_cosine;
            let (began, color) = (
                lab_of_pixel(cloud.colors[seed as usize]),
                lab_of_pixel(cloud.colors[to]),
            );
            smooth && squared_difference(began, color) <= most
        };
        let mut front: Vec<(u32, u32)> = (0..cloud.len() as u32)
            .filter(|&p| inside[p as usize])
            .map(|p| (p, p))
            .collect();
        while !front.is_empty() {
            progress.check()?;
            let reached = |&(point, seed): &(u32, u32)| {
                let near = neighbours.nearest_n(cloud.positions[point as usize], NEIGHBOURS);
                let near = near
                    .into_iter()
                    .filter(|&(other, far)| far <= REACH * spacing && !inside[other]);
                near.filter(|&(other, _)| alike(point, seed, other))
                    .map(|(other, _)| (other as u32, seed))
                    .collect()
            };
            let found: Vec<Vec<(u32, u32)>> = front.par_iter().map(reached).collect();
            front.clear();
            for (point, seed) in found.into_iter().flatten() {
                if !std::mem::replace(&mut inside[point as usize], true) {
                    front.push((point, seed));
                }
            }
        }
        Ok(())
    }
}

/// Edge length of the cells that connect points, in spacings of the cloud.
///
/// Gaps below one cell do not separate components.
const CELL: f32 = 2.0;

/// Returns the connected components of some points, the largest first.
///
/// Components of equal size are ordered by their first point, and points are ascending within a
/// component. Points are connected if their cells touch, including at a corner (connected
/// components of occupied voxels).
pub(super) fn pieces(positions: &[Vec3], spacing: f32, chosen: &[u32]) -> Vec<Vec<u32>> {
    let cell = |point: u32| {
        (positions[point as usize] / (CELL * spacing))
            .floor()
            .as_ivec3()
    };
    let mut cells: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
    for &point in chosen {
        cells.entry(cell(point)).or_default().push(point);
    }
    let mut pieces: Vec<Vec<u32>> = Vec::new();
    for &point in chosen {
        let Some(first) = cells.remove(&cell(point)) else {
            continue;
        };
        let (mut piece, mut open) = (first, vec![cell(point)]);
        while let Some(at) = open.pop() {
            for step in around() {
                if let Some(members) = cells.remove(&(at + step)) {
                    piece.extend(members);
                    open.push(at + step);
                }
            }
        }
        piece.sort_unstable();
        pieces.push(piece);
    }
    pieces.sort_by(|a, b| b.len().cmp(&a.len()).then(a.cmp(b)));
    pieces
}

fn around() -> impl Iterator<Item = IVec3> {
    (0..27).map(|at| IVec3::new(at % 3, at / 3 % 3, at / 9) - IVec3::ONE)
}
