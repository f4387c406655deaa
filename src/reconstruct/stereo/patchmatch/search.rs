//! The search of one view from coarse to fine, and its rounds with geometric consistency.

use std::sync::Arc;

use glam::Vec3;

use super::level::{FoundPlanes, PlanePrior, coarse_mask, level};
use super::pixel_update::SweepState;
use super::plane::{Field, Plane, Raster, WORST};
use super::search_input::{DepthSearch, PatchMatchOptions, PlaneMap, Round};
use super::start::{priors, random_field};
use super::sweep::Passes;
use super::window::SupportWindow;
use ostra_core::job::Progress;

/// Runs PatchMatch stereo of one view from coarse to fine, by the images alone.
///
/// The method is that of M. Bleyer, C. Rhemann, C. Rother, *PatchMatch Stereo*, BMVC 2011, with the
/// checkerboard order and sampling of Q. Xu and W. Tao, CVPR 2019. `P` defines where the passes
/// run.
///
/// # Errors
/// Those of the passes.
pub fn search<P: Passes>(
    passes: &mut P,
    search: &DepthSearch<'_>,
    options: &PatchMatchOptions,
    progress: &Progress,
) -> Result<PlaneMap, P::Error> {
    let window = SupportWindow::default();
    let mut visit = 0;
    let mut coarser: Option<P::Field> = None;
    for number in (0..search.reference.levels.len()).rev() {
        let masked = search
            .allowed
            .map(|allowed| coarse_mask(allowed, search.reference, number));
        let mut level = level(search, number, options, &window, masked.as_deref());
        let iterations = if coarser.is_none() {
            options.coarse_iterations
        } else {
            options.fine_iterations
        };
        let first_reach = if coarser.is_none() { 16.0 } else { 2.0 };
        let mut field = match &coarser {
            None => passes.begin(&level, random_field(&level, search.seeds, number))?,
            Some(coarser) => {
                level.hints = priors(&level, &passes.copied(coarser)?);
                level.pull = options.prior_weight;
                passes.finer(&level, coarser)?
            }
        };
        passes.score(&level, &mut field, progress)?;
        for iteration in 0..iterations {
            let reach = first_reach * 0.5f32.powi(iteration as i32);
            let random_samples = if coarser.is_none() {
                1
            } else {
                options.restarts
            };
            passes.sweep(
                &level,
                &mut field,
                SweepState {
                    visit,
                    iteration,
                    reach,
                    random_samples,
                },
                progress,
            )?;
            visit += 1;
        }
        coarser = Some(field);
    }
    let field = coarser.map(|field| passes.finish(field)).transpose()?;
    Ok(field.map(|field| found(&field)).unwrap_or_default())
}

/// Runs a round with geometric consistency.
///
/// It starts from an earlier round's planes and compares with those of the sources. The planes of
/// the sources are hypotheses too where the reference sees them.
///
/// # Errors
/// Those of the passes.
pub fn search_consistent<P: Passes>(
    passes: &mut P,
    search: &DepthSearch<'_>,
    round: &Round<'_>,
    options: &PatchMatchOptions,
    progress: &Progress,
) -> Result<PlaneMap, P::Error> {
    let (
        window,
        &Round {
            start,
            others,
            before,
        },
    ) = (SupportWindow::default(), round);
    let mut level = level(search, 0, options, &window, search.allowed);
    for ((source, image), found) in level.sources.iter_mut().zip(search.sources).zip(others) {
        let back = image.transfer(search.reference, 0);
        source.found = found.as_ref().map(|planes| FoundPlanes {
            planes: Arc::clone(planes),
            back,
        });
    }
    level.hints = hints(search, round, level.step);
    let mut field = Field::new(start.width, start.height);
    for (at, &plane) in start.planes.iter().enumerate() {
        field.set(at % start.width, at / start.width, plane, WORST);
    }
    let mut field = passes.begin(&level, field)?;
    passes.score(&level, &mut field, progress)?;
    for iteration in 0..options.geometric_iterations {
        let visit = 64 * (before + 1) + iteration;
        let reach = 0.5f32.powi((before + iteration) as i32);
        let turn = SweepState {
            visit,
            iteration: iteration + 2,
            reach,
            random_samples: 0,
        };
        passes.sweep(&level, &mut field, turn, progress)?;
    }
    Ok(found(&passes.finish(field)?))
}

fn found(field: &Field) -> PlaneMap {
    let (width, height) = (field.width, field.height);
    let all = (0..width * height).map(|at| field.at(at % width, at / width));
    let searched = all.map(|(plane, cost)| {
        if cost < WORST {
            (plane, cost)
        } else {
            (Plane::default(), cost)
        }
    });
    let (planes, costs) = searched.unzip();
    PlaneMap {
        width,
        height,
        planes,
        costs,
    }
}

/// Planes of sources with a higher cost are not used as hints.
const MAX_COST: f32 = 0.6;
/// The surface of a flat patch with a lower cost is known.
const CONFIDENT: f32 = 0.7;

/// Returns what a round knows of each pixel beforehand, row by row.
///
/// This is planes of other views, and the surface where the round before was confident of it.
/// `step` is the change of inverse depth that makes another surface.
pub fn hints(search: &DepthSearch<'_>, round: &Round<'_>, step: f32) -> Vec<PlanePrior> {
    let planes = of_sources(search, round.start, round.others, step);
    let hint = |(plane, &cost): (Plane, &f32)| PlanePrior {
        plane,
        is_known: cost < CONFIDENT,
    };
    planes
        .into_iter()
        .zip(&round.start.costs)
        .map(hint)
        .collect()
}

/// Returns for each pixel of the reference the cheapest plane of a source that is seen there.
///
/// Planes of the pixel's own surface are left out; inverse depth 0 = none (view propagation of M.
/// Bleyer, C. Rhemann, C. Rother, *PatchMatch Stereo*, BMVC 2011).
fn of_sources(
    search: &DepthSearch<'_>,
    start: &PlaneMap,
    others: &[Option<Arc<PlaneMap>>],
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

/// Returns the plane `vector · X = 1` (camera space) at a pixel.
fn seen_from(vector: Vec3, raster: &Raster, x: f32, y: f32) -> Plane {
    let slope = [vector.x / raster.focal[0], vector.y / raster.focal[1]];
    Plane {
        inverse_depth: vector.dot(raster.ray(x, y)),
        slope,
    }
}
