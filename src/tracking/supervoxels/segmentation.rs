use glam::{IVec3, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::voxels::SurfaceVoxels;
use ostra_cloud::SceneError;
use ostra_core::job::Progress;

/// Rounds in which voxels choose their supervoxel.
const ROUNDS: usize = 6;
/// Weight of a colour difference (ΔE), relative to one seed step and to unit normals.
const COLOR_WEIGHT: f32 = 0.02;
/// Maximum distance of touching voxels, in sides of a voxel.
const TOUCH: f32 = 1.9;

/// Supervoxels: small surface parts of uniform position, normal and colour.
///
/// Papon, Abramov, Schoeler, Wörgötter, "Voxel cloud connectivity segmentation – supervoxels for
/// point clouds", CVPR 2013.
pub struct Supervoxels {
    /// The supervoxel of each voxel.
    pub of_voxel: Vec<u32>,
    /// Mean position of each supervoxel's voxels, in world space.
    pub places: Vec<Vec3>,
    /// Number of voxels of each supervoxel.
    pub sizes: Vec<u32>,
    /// Borders between touching supervoxels, sorted.
    pub borders: Vec<SupervoxelBorder>,
}

impl Supervoxels {
    /// Computes supervoxels about `step` (world units) wide from voxels and their normals.
    pub fn of(
        voxels: &SurfaceVoxels,
        normals: &[Vec3],
        step: f32,
        progress: &Progress,
    ) -> Result<Self, SceneError> {
        let mut of_voxel = seeds(voxels, step);
        for _ in 0..ROUNDS {
            progress.check()?;
            of_voxel = Means::of(voxels, normals, &mut of_voxel).choose(voxels, normals, step);
        }
        let means = Means::of(voxels, normals, &mut of_voxel);
        let borders = means.borders(&of_voxel, &voxels.pairs(TOUCH));
        Ok(Self {
            of_voxel,
            places: means.places,
            sizes: means.sizes,
            borders,
        })
    }

    pub fn len(&self) -> usize {
        self.places.len()
    }
}

/// Assigns one supervoxel to each cube of edge `step`.
fn seeds(voxels: &SurfaceVoxels, step: f32) -> Vec<u32> {
    let mut found: FxHashMap<[i32; 3], u32> = FxHashMap::default();
    let seed = |place: &Vec3| {
        let next = found.len() as u32;
        *found
            .entry((place / step).floor().as_ivec3().to_array())
            .or_insert(next)
    };
    voxels.places.iter().map(seed).collect()
}

/// Mean properties of each supervoxel.
struct Means {
    places: Vec<Vec3>,
    normals: Vec<Vec3>,
    colors: Vec<Vec3>,
    sizes: Vec<u32>,
}

impl Means {
    /// Computes the means of non-empty supervoxels and renumbers `of_voxel` without the empty.
    fn of(voxels: &SurfaceVoxels, normals: &[Vec3], of_voxel: &mut [u32]) -> Self {
        let mut numbers: FxHashMap<u32, u32> = FxHashMap::default();
        let (mut sizes, mut sums): (Vec<u32>, Vec<[Vec3; 3]>) = (Vec::new(), Vec::new());
        for (at, of) in of_voxel.iter_mut().enumerate() {
            let number = *numbers.entry(*of).or_insert(sizes.len() as u32);
            if number as usize == sizes.len() {
                sizes.push(0);
                sums.push([Vec3::ZERO; 3]);
            }
            *of = number;
            sizes[number as usize] += 1;
            let own = [voxels.places[at], normals[at], voxels.colors[at]];
            sums[number as usize]
                .iter_mut()
                .zip(own)
                .for_each(|(sum, own)| *sum += own);
        }
        let mean = |which: usize| {
            sums.iter()
                .zip(&sizes)
                .map(move |(sums, &size)| sums[which] / size as f32)
        };
        let normals = mean(1).map(Vec3::normalize_or_zero).collect();
        Self {
            places: mean(0).collect(),
            normals,
            colors: mean(2).collect(),
            sizes,
        }
    }

    /// Returns the most similar supervoxel nearby for every voxel.
    fn choose(&self, voxels: &SurfaceVoxels, normals: &[Vec3], step: f32) -> Vec<u32> {
        let cell = |place: Vec3| (place / step).floor().as_ivec3();
        let mut around: FxHashMap<[i32; 3], Vec<u32>> = FxHashMap::default();
        for (place, index) in self.places.iter().zip(0..) {
            around
                .entry(cell(*place).to_array())
                .or_default()
                .push(index);
        }
        let unlike = |at: usize, of: usize| {
            (voxels.places[at] - self.places[of]).length_squared() / (step * step)
                + (normals[at] - self.normals[of]).length_squared()
                + (voxels.colors[at] - self.colors[of]).length_squared()
                    * COLOR_WEIGHT
                    * COLOR_WEIGHT
        };
        let likest = |at: usize| {
            let middle = cell(voxels.places[at]);
            let cells = (0..27)
                .map(|i| (middle + IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1)).to_array());
            let near = cells.filter_map(|cell| around.get(&cell)).flatten();
            near.map(|&of| (unlike(at, of as usize), of))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map_or(0, |(_, of)| of)
        };
        (0..voxels.len()).into_par_iter().map(likest).collect()
    }

    fn borders(&self, of_voxel: &[u32], touching: &[(u32, u32)]) -> Vec<SupervoxelBorder> {
        let mut lengths: FxHashMap<(u32, u32), f32> = FxHashMap::default();
        for &(p, q) in touching {
            let (a, b) = (of_voxel[p as usize], of_voxel[q as usize]);
            if a != b {
                *lengths.entry((a.min(b), a.max(b))).or_default() += 1.0;
            }
        }
        let border = |((a, b), length)| {
            let side = |of: u32| OrientedPoint {
                place: self.places[of as usize],
                normal: self.normals[of as usize],
            };
            let color =
                (self.colors[a as usize] - self.colors[b as usize]) * Vec3::new(0.5, 1.0, 1.0);
            SupervoxelBorder {
                a,
                b,
                length,
                bend_deg: bend_deg(side(a), side(b)),
                color: color.length(),
            }
        };
        let mut borders: Vec<SupervoxelBorder> = lengths.into_iter().map(border).collect();
        borders.sort_unstable_by_key(|border| (border.a, border.b));
        borders
    }
}

/// Angle between normals, in degrees, up to which a border counts as flat.
const EVEN_DEG: f32 = 10.0;
/// Angle beyond flat, in degrees, at which a ridge is a full border.
const RIDGE_DEG: f32 = 200.0;

/// Border between two supervoxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupervoxelBorder {
    pub a: u32,
    pub b: u32,
    /// Number of touching voxel pairs.
    pub length: f32,
    /// Angle between the normals in degrees; positive over a ridge, negative in a groove.
    pub bend_deg: f32,
    /// Colour difference: ΔE with half the lightness, because shading varies within an object.
    pub color: f32,
}

/// Weights of angles and colours in the strength of a border.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundaryWeights {
    /// Angle beyond flat, in degrees, at which a groove is a full border.
    pub groove_deg: f32,
    /// Colour difference of a full border, ΔE.
    pub color: f32,
}

impl BoundaryWeights {
    /// Returns how likely a border separates two objects; 0 = not, 1 = full border.
    ///
    /// Objects meet in a groove, whereas a ridge is mostly an edge of one object (Stein, Schoeler,
    /// Papon, Wörgötter, "Object partitioning using local convexity", CVPR 2014).
    pub fn strength(&self, border: &SupervoxelBorder) -> f32 {
        let bend = (border.bend_deg.abs() - EVEN_DEG).max(0.0);
        let shape = if border.bend_deg < 0.0 {
            (bend / self.groove_deg).min(1.0)
        } else {
            bend / RIDGE_DEG
        };
        shape + border.color / self.color
    }
}

/// A place on a surface with its normal.
#[derive(Clone, Copy)]
struct OrientedPoint {
    place: Vec3,
    /// Unit vector; zero if it is missing.
    normal: Vec3,
}

/// Returns the angle between two normals in degrees, negative in a groove.
///
/// It is 0 if a normal is missing.
fn bend_deg(a: OrientedPoint, b: OrientedPoint) -> f32 {
    if a.normal == Vec3::ZERO || b.normal == Vec3::ZERO {
        return 0.0;
    }
    let bend = a.normal.angle_between(b.normal).to_degrees();
    if (a.normal - b.normal).dot(a.place - b.place) < 0.0 {
        -bend
    } else {
        bend
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groove_separates_objects_and_a_ridge_does_not() {
        let (left, right) = (Vec3::NEG_X, Vec3::X);
        let (leaning, away) = (
            Vec3::new(1.0, 0.0, 1.0).normalize(),
            Vec3::new(-1.0, 0.0, 1.0).normalize(),
        );
        let at = |place, normal| OrientedPoint { place, normal };
        let groove = bend_deg(at(left, leaning), at(right, away));
        let ridge = bend_deg(at(left, away), at(right, leaning));
        assert!(
            (groove + 90.0).abs() < 0.1 && (ridge - 90.0).abs() < 0.1,
            "{groove} {ridge}"
        );
        assert_eq!(bend_deg(at(left, Vec3::ZERO), at(right, away)), 0.0);
        let judgement = BoundaryWeights {
            groove_deg: 30.0,
            color: 80.0,
        };
        let strength = |bend_deg, color| {
            judgement.strength(&SupervoxelBorder {
                a: 0,
                b: 1,
                length: 1.0,
                bend_deg,
                color,
            })
        };
        assert_eq!(strength(groove, 0.0), 1.0);
        assert!(
            strength(ridge, 0.0) < 0.5 && strength(9.0, 0.0) == 0.0 && strength(0.0, 40.0) == 0.5
        );
    }
}
