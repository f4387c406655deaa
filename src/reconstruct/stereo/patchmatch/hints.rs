use std::sync::Arc;

use glam::Vec3;

use super::level::Hint;
use super::plane::{Plane, Raster};
use super::search::{Found, Round, Search};

/// Planes of sources that cost more are no hints.
const MAX_COST: f32 = 0.6;
/// The surface of a flat patch that cost less is known.
const SURE: f32 = 0.7;

/// What a round knows beforehand, row by row: the planes of other views, and what surface lies there where the round
/// before was sure of it. `step` is the change of inverse depth that makes another surface.
pub fn hints(search: &Search<'_>, round: &Round<'_>, step: f32) -> Vec<Hint> {
    let planes = of_sources(search, round.start, round.others, step);
    let hint = |(plane, &cost): (Plane, &f32)| Hint {
        plane,
        is_known: cost < SURE,
    };
    planes
        .into_iter()
        .zip(&round.start.costs)
        .map(hint)
        .collect()
}

/// For each pixel of the reference the cheapest plane of a source that is seen there and is not the pixel's own surface
/// (view propagation of M. Bleyer, C. Rhemann, C. Rother, *PatchMatch Stereo*, BMVC 2011); inverse depth 0 = none.
fn of_sources(
    search: &Search<'_>,
    start: &Found,
    others: &[Option<Arc<Found>>],
    step: f32,
) -> Vec<Plane> {
    let mut planes = vec![Plane::default(); start.planes.len()];
    let mut costs = vec![MAX_COST; start.planes.len()];
    let raster = search.reference.raster(0);
    for (source, found) in search.sources.iter().zip(others) {
        let Some(found) = found else { continue };
        let from_source = search
            .reference
            .camera_from_world
            .compose(&source.camera_from_world.inverse());
        let back = source.transfer(search.reference, 0);
        let there = source.raster(0);
        for (at, (&plane, &cost)) in found.planes.iter().zip(&found.costs).enumerate() {
            if plane.inverse_depth <= 0.0 || cost >= MAX_COST {
                continue;
            }
            let (u, v) = ((at % found.width) as f32, (at / found.width) as f32);
            let [x, y, z] = back.apply(u, v, plane.inverse_depth);
            let (column, row) = ((x / z + 0.5) as usize, (y / z + 0.5) as usize);
            let seen = z > 0.0 && x > 0.0 && y > 0.0 && column < start.width && row < start.height;
            let pixel = row * start.width + column;
            if !seen || cost >= costs[pixel] {
                continue;
            }
            let vector = from_source.rotation.as_quat() * plane.vector(&there, u, v);
            let scale = 1.0 + vector.dot(from_source.translation.as_vec3());
            let here = seen_from(vector / scale, &raster, column as f32, row as f32);
            if (here.inverse_depth - start.planes[pixel].inverse_depth).abs() > step {
                (planes[pixel], costs[pixel]) = (here, cost);
            }
        }
    }
    planes
}

/// The plane `vector · X = 1` (camera space) at a pixel.
fn seen_from(vector: Vec3, raster: &Raster, x: f32, y: f32) -> Plane {
    let slope = [vector.x / raster.focal[0], vector.y / raster.focal[1]];
    Plane {
        inverse_depth: vector.dot(raster.ray(x, y)),
        slope,
    }
}
