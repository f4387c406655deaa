use glam::{DVec3, IVec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::dice::Dice;
use super::mesh::face_normal;
use super::model::Model;

/// A point on a surface of a model.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) triangle: u32,
    /// Shares of the triangle's corners, sum 1.
    pub(super) shares: [f64; 3],
    pub(super) x: DVec3,
}

/// Candidates thrown for each point kept; the surface is then full but for a few gaps.
const THROWS: usize = 8;
/// Least distance of points as a share of their spacing; gives about one point per squared spacing.
const LEAST: f64 = 0.8;

/// Covers each part with points at random that keep a distance from one another (dart throwing; Cook, "Stochastic
/// sampling in computer graphics", ACM Transactions on Graphics 1986), about one per `spacing(part)²` square metres.
/// Parts whose spacing is `None` are left out.
pub(super) fn cover(
    model: &Model,
    seed: u64,
    spacing: impl Fn(usize) -> Option<f64> + Sync,
) -> Vec<Spot> {
    let mut triangles_of = vec![Vec::new(); model.looks.len()];
    for (triangle, &look) in model.look_of.iter().enumerate() {
        triangles_of[usize::from(look)].push(triangle as u32);
    }
    let covered: Vec<Vec<Spot>> = triangles_of
        .par_iter()
        .enumerate()
        .filter_map(|(part, triangles)| Some((part, triangles, spacing(part)?)))
        .map(|(part, triangles, spacing)| {
            cover_part(model, triangles, spacing, &mut Dice::new(seed, part as u64))
        })
        .collect();
    covered.concat()
}

fn cover_part(model: &Model, triangles: &[u32], spacing: f64, dice: &mut Dice) -> Vec<Spot> {
    let mut kept: Vec<Spot> = Vec::new();
    let mut grid: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
    let least = LEAST * spacing;
    for _ in 0..THROWS {
        let mut owed = dice.range(0.0, 1.0);
        for &triangle in triangles {
            owed += 0.5
                * face_normal(&model.positions, model.triangles[triangle as usize]).length()
                / spacing.powi(2);
            while owed >= 1.0 {
                owed -= 1.0;
                let spot = throw(model, triangle, dice);
                let cell = (spot.x / least).floor().as_ivec3();
                let near = |k: i32| cell + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
                let crowded =
                    |&k: &u32| kept[k as usize].x.distance_squared(spot.x) < least * least;
                if (0..27)
                    .filter_map(|k| grid.get(&near(k)))
                    .flatten()
                    .any(crowded)
                {
                    continue;
                }
                grid.entry(cell).or_default().push(kept.len() as u32);
                kept.push(spot);
            }
        }
    }
    kept
}

fn throw(model: &Model, triangle: u32, dice: &mut Dice) -> Spot {
    let (mut a, mut b) = (dice.range(0.0, 1.0), dice.range(0.0, 1.0));
    if a + b > 1.0 {
        (a, b) = (1.0 - a, 1.0 - b);
    }
    let shares = [1.0 - a - b, a, b];
    let corners = model.triangles[triangle as usize].map(|v| model.positions[v as usize]);
    let x = corners
        .iter()
        .zip(shares)
        .map(|(&corner, share)| share * corner)
        .sum();
    Spot {
        triangle,
        shares,
        x,
    }
}
