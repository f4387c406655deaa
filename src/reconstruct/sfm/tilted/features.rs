use glam::DVec2;

use super::view::{Tilt, TiltedView};
use crate::sfm::{FeatureError, FeatureExtractor, Features};

/// Features of a grey picture (`width · height` values in 0..1, row by row) as it looks under a tilt, at their places in
/// the picture itself; only where `allowed` is true, everywhere without it.
///
/// # Errors
/// Where the extractor fails.
pub fn tilted_features(
    extractor: &dyn FeatureExtractor,
    grey: &[f32],
    [width, height]: [usize; 2],
    allowed: Option<&[bool]>,
    tilt: Tilt,
) -> Result<Features, FeatureError> {
    let view = TiltedView::new(grey, width, height, tilt);
    let found = extractor.extract(
        &view.grey,
        view.width,
        view.height,
        Some(&allowed_in(&view, width, allowed)),
    )?;
    Ok(Features {
        width: width as u32,
        height: height as u32,
        keypoints: found
            .keypoints
            .iter()
            .map(|&at_px| view.original(at_px))
            .collect(),
        ..found
    })
}

/// Pixels of a view that show an allowed one of the picture.
fn allowed_in(view: &TiltedView, width: usize, allowed: Option<&[bool]>) -> Vec<bool> {
    let pixels = (0..view.height)
        .flat_map(|y| (0..view.width).map(move |x| DVec2::new(x as f64, y as f64) + 0.5));
    let is_allowed =
        |at: DVec2| allowed.is_none_or(|allowed| allowed[at.y as usize * width + at.x as usize]);
    pixels
        .map(|at_px| view.shows(at_px) && is_allowed(view.original(at_px)))
        .collect()
}
