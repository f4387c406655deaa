use std::collections::BTreeMap;

use super::outcome::ViewOutcome;
use super::pictures::Pictures;
use super::run::StereoRequest;
use crate::stereo::patchmatch::MAX_SOURCES;
use crate::stereo::range::{depth_range, seen_points};
use crate::stereo::raster::raster_camera;
use crate::stereo::{SelectOptions, StereoError, select_sources};
use ostra_core::job::Progress;

/// What a view's depth is made from.
#[derive(Debug, Clone)]
pub struct PlannedView {
    /// Its frame number.
    pub frame: usize,
    /// The frames that it is compared with, the best first.
    pub sources: Vec<usize>,
    /// These, and further frames that see much of the same.
    pub around: Vec<usize>,
    /// Depths to search.
    pub depth_range: [f64; 2],
    /// Pixels of the raster whose depth sparse points tell.
    pub seeds: Vec<(usize, usize, f32)>,
}

/// The views that get depth, and what became of the others.
#[derive(Debug, Default)]
pub struct Planned {
    /// By rising frame number.
    pub views: Vec<PlannedView>,
    /// By frame number.
    pub outcomes: BTreeMap<usize, ViewOutcome>,
}

/// Chooses sources and depth ranges; views that cannot be read or compared are told apart.
///
/// # Errors
/// [`StereoError::Stopped`].
pub fn plan(
    request: &StereoRequest<'_>,
    pictures: &mut Pictures<'_>,
    options: &SelectOptions,
    progress: &Progress,
) -> Result<Planned, StereoError> {
    let mut planned = Planned::default();
    let mut usable = Vec::new();
    for (done, &number) in request.views.iter().enumerate() {
        progress.step(done, request.views.len())?;
        let outcome = match request.frames[number]
            .posed_camera()
            .map(|_| pictures.get(number))
        {
            None => ViewOutcome::NoCamera,
            Some(Err(why)) => ViewOutcome::Unreadable { why },
            Some(Ok(picture)) if picture.is_constant => ViewOutcome::Constant,
            Some(Ok(_)) => {
                usable.push(number);
                continue;
            }
        };
        planned.outcomes.insert(number, outcome);
    }
    let around = select_sources(request.frames, &usable, request.sparse, options);
    for (&number, around) in usable.iter().zip(around) {
        let frame = &request.frames[number];
        let points = seen_points(frame, number, request.sparse);
        match depth_range(&points)
            .filter(|_| !around.is_empty())
            .zip(frame.posed_camera())
        {
            Some((depth_range, (lens, _))) => {
                let raster = raster_camera(lens, pictures.max_side());
                let seeds = points.iter().filter_map(|x_in_camera| {
                    let at_px = raster
                        .project(*x_in_camera)
                        .filter(|&at_px| raster.contains(at_px))?;
                    Some((at_px.x as usize, at_px.y as usize, x_in_camera.z as f32))
                });
                let around: Vec<usize> = around.iter().map(|source| source.frame).collect();
                let sources = around
                    .iter()
                    .take(options.sources.clamp(1, MAX_SOURCES))
                    .copied()
                    .collect();
                planned.views.push(PlannedView {
                    frame: number,
                    sources,
                    around,
                    depth_range,
                    seeds: seeds.collect(),
                });
            }
            None => {
                planned.outcomes.insert(
                    number,
                    ViewOutcome::NothingShared {
                        points: points.len(),
                    },
                );
            }
        }
    }
    Ok(planned)
}
