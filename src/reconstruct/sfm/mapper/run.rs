use std::collections::BTreeMap;

use glam::DVec2;

use super::MapperOptions;
use super::first_pair::Start;
use super::register::Refusal;
use super::state::Mapper;
use crate::sfm::{Correspondences, IntrinsicsSource, MapProblem, SparseModel};
use ostra_core::job::{Progress, Stopped};

/// One model, and why images that see something of it are not in it.
#[derive(Debug, Clone)]
pub struct Mapped {
    /// What was placed.
    pub model: SparseModel,
    /// How it was begun.
    pub start: Start,
    /// Images that were tried and refused.
    pub refused: BTreeMap<u32, Refusal>,
    /// Whether it was stopped before every image had been tried.
    pub stopped: bool,
}

/// Focal lengths, relative to the guess, with which a start is tried where nothing is known of a camera.
const FOCAL_FACTORS: [f64; 5] = [1.0, 0.7, 1.4, 0.5, 2.0];

/// Incremental structure from motion: places images one after the other, and makes another model of those left over as
/// long as that is possible. The largest model comes first; where poses are given, theirs (Schönberger & Frahm,
/// "Structure-from-Motion Revisited", CVPR 2016). Stopped, it gives what it has.
///
/// # Errors
/// [`Stopped`] before anything was placed.
pub fn map(
    problem: &MapProblem,
    options: &MapperOptions,
    progress: &Progress,
) -> Result<Vec<Mapped>, Stopped> {
    let links = Correspondences::new(problem);
    let mut closed = vec![false; problem.images.len()];
    let mut models: Vec<Mapped> = Vec::new();
    loop {
        let mapped = match best_start(problem, &links, options, &closed, progress) {
            Ok(Some(mapped)) => mapped,
            Err(stopped) if models.is_empty() => return Err(stopped),
            Ok(None) | Err(Stopped) => break,
        };
        for image in mapped.model.placed() {
            closed[image as usize] = true;
        }
        models.push(mapped);
    }
    models.sort_by_key(|mapped| {
        (
            mapped.start != Start::Given,
            std::cmp::Reverse(mapped.model.placed().count()),
        )
    });
    Ok(models)
}

/// One model; where a camera is unknown and not half of the images that could be are placed, the best of several focal
/// lengths to start from.
fn best_start(
    problem: &MapProblem,
    links: &Correspondences,
    options: &MapperOptions,
    closed: &[bool],
    progress: &Progress,
) -> Result<Option<Mapped>, Stopped> {
    let linked = |image: u32| {
        problem
            .pairs
            .iter()
            .any(|pair| pair.images.contains(&image))
    };
    let could = (0..problem.images.len() as u32)
        .filter(|&image| !closed[image as usize] && linked(image))
        .count();
    let unknown = problem
        .cameras
        .iter()
        .any(|camera| camera.source == IntrinsicsSource::Guessed);
    let mut best: Option<Mapped> = None;
    for factor in FOCAL_FACTORS {
        let grown = match one_model(problem, links, options, closed, factor, progress) {
            Err(stopped) if best.is_none() => return Err(stopped),
            grown => grown.ok().flatten(),
        };
        let placed = |mapped: &Option<Mapped>| {
            mapped
                .as_ref()
                .map_or(0, |mapped| mapped.model.placed().count())
        };
        if placed(&grown) > placed(&best) {
            best = grown;
        }
        if !unknown || 2 * placed(&best) >= could || progress.check().is_err() {
            break;
        }
    }
    if let Some(best) = &mut best {
        best.stopped |= progress.check().is_err();
    }
    let (images, points) = (options.min_model_images, options.min_model_points);
    Ok(best.filter(|Mapped { model, .. }| {
        model.placed().count() >= images && model.points().count() >= points
    }))
}

fn one_model(
    problem: &MapProblem,
    links: &Correspondences,
    options: &MapperOptions,
    closed: &[bool],
    factor: f64,
    progress: &Progress,
) -> Result<Option<Mapped>, Stopped> {
    let mut mapper = Mapper::new(problem, links, options, progress);
    mapper.closed = closed.to_vec();
    for (camera, known) in problem.cameras.iter().enumerate() {
        if known.source == IntrinsicsSource::Guessed && factor != 1.0 {
            mapper.model.cameras[camera].focal_px *= DVec2::splat(factor);
            mapper.cast_rays(camera);
        }
    }
    let first = !closed.contains(&true);
    let given = if first {
        mapper.start_from_given()?
    } else {
        None
    };
    let start = match given {
        Some(start) => Some(start),
        None => mapper.start_from_pair()?,
    };
    let Some(start) = start else { return Ok(None) };
    if let Start::Pair { images, .. } = start {
        for image in images {
            mapper.focal_known[problem.images[image as usize].camera] = true;
        }
    }
    let grown = mapper.grow();
    let stopped = grown.is_err();
    Ok(Some(Mapped {
        model: mapper.model,
        start,
        refused: grown.unwrap_or_default(),
        stopped,
    }))
}
