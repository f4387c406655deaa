use std::sync::Arc;

use super::field::Field;
use super::hints::hints;
use super::options::PatchMatchOptions;
use super::passes::Passes;
use super::picture::Picture;
use super::plane::Plane;
use super::priors::priors;
use super::start::{coarse_mask, level, random_field};
use super::visit::Turn;
use super::window::Window;
use ostra_core::job::Progress;

/// What one view's depth is searched in.
#[derive(Debug, Clone)]
pub struct Search<'a> {
    /// The view.
    pub reference: &'a Picture,
    /// Its sources, the best first; those beyond the eighth are not looked at.
    pub sources: &'a [Arc<Picture>],
    /// Smallest and largest depth along the optical axis, world units, above 0.
    pub depth_range: [f64; 2],
    /// Pixels (column, row) whose depth is known from sparse points.
    pub seeds: &'a [(usize, usize, f32)],
    /// Pixels to be worked on, row by row; `None` = all.
    pub allowed: Option<&'a [bool]>,
}

/// The best plane of every pixel, row by row, and its cost, 0–2; no plane where nothing was searched.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Found {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The planes.
    pub planes: Vec<Plane>,
    /// Their costs.
    pub costs: Vec<f32>,
}

/// What a round with geometric consistency goes on from.
#[derive(Debug, Clone, Copy)]
pub struct Round<'a> {
    /// What is known of the view.
    pub start: &'a Found,
    /// What is known of each source; `None` for one of which nothing is.
    pub others: &'a [Option<Arc<Found>>],
    /// Such rounds that went before.
    pub before: u32,
}

/// PatchMatch stereo of one view from coarse to fine, by the pictures alone (M. Bleyer, C. Rhemann, C. Rother,
/// *PatchMatch Stereo*, BMVC 2011; checkerboard order and sampling of Q. Xu and W. Tao, CVPR 2019), wherever the passes
/// are carried out.
///
/// # Errors
/// Those of the passes.
pub fn search<P: Passes>(
    passes: &mut P,
    search: &Search<'_>,
    options: &PatchMatchOptions,
    progress: &Progress,
) -> Result<Found, P::Error> {
    let window = Window::default();
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
            let draws = if coarser.is_none() {
                1
            } else {
                options.restarts
            };
            passes.sweep(
                &level,
                &mut field,
                Turn {
                    visit,
                    iteration,
                    reach,
                    draws,
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

/// A round with geometric consistency: starts from an earlier round's planes and compares with those of the sources,
/// which are hypotheses too where they are seen in the reference.
///
/// # Errors
/// Those of the passes.
pub fn search_consistent<P: Passes>(
    passes: &mut P,
    search: &Search<'_>,
    round: &Round<'_>,
    options: &PatchMatchOptions,
    progress: &Progress,
) -> Result<Found, P::Error> {
    let (
        window,
        &Round {
            start,
            others,
            before,
        },
    ) = (Window::default(), round);
    let mut level = level(search, 0, options, &window, search.allowed);
    for ((source, picture), found) in level.sources.iter_mut().zip(search.sources).zip(others) {
        let back = picture.transfer(search.reference, 0);
        source.found = found.as_ref().map(|found| (Arc::clone(found), back));
    }
    level.hints = hints(search, round, level.step);
    let mut field = Field::new(start.width, start.height);
    for (at, &plane) in start.planes.iter().enumerate() {
        field.set(at % start.width, at / start.width, plane, super::ncc::WORST);
    }
    let mut field = passes.begin(&level, field)?;
    passes.score(&level, &mut field, progress)?;
    for iteration in 0..options.geometric_iterations {
        let visit = 64 * (before + 1) + iteration;
        let reach = 0.5f32.powi((before + iteration) as i32);
        let turn = Turn {
            visit,
            iteration: iteration + 2,
            reach,
            draws: 0,
        };
        passes.sweep(&level, &mut field, turn, progress)?;
    }
    Ok(found(&passes.finish(field)?))
}

fn found(field: &Field) -> Found {
    let (width, height) = (field.width, field.height);
    let all = (0..width * height).map(|at| field.at(at % width, at / width));
    let searched = all.map(|(plane, cost)| {
        if cost < super::ncc::WORST {
            (plane, cost)
        } else {
            (Plane::default(), cost)
        }
    });
    let (planes, costs) = searched.unzip();
    Found {
        width,
        height,
        planes,
        costs,
    }
}
