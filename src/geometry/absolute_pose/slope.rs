use glam::{DMat2, DVec2};

use crate::{Camera, Distortion};

/// Step on the plane z = 1 of the difference quotient.
const STEP: f64 = 1e-5;

/// Derivative of the pixel position by the position on the plane z = 1, at `at_plane`; `None` where the lens model folds
/// back.
pub(crate) fn pixel_slope(camera: &Camera, at_plane: DVec2) -> Option<DMat2> {
    if camera.distortion == Distortion::None {
        return Some(DMat2::from_diagonal(camera.focal_px));
    }
    let at = |offset: DVec2| camera.project((at_plane + offset).extend(1.0));
    let along = |axis: DVec2| Some((at(axis * STEP)? - at(axis * -STEP)?) / (2.0 * STEP));
    Some(DMat2::from_cols(along(DVec2::X)?, along(DVec2::Y)?))
}
