//! Files of the 3-D view: images and turntable videos.

use std::f32::consts::TAU;
use std::path::Path;

use anyhow::Result;

use super::dialogs::{ScreenshotRequest, Take};
use ostra_frames::TurntableOptions;
use ostra_session::Session;
use ostra_view::{RenderRequest, write_png};

/// Renders an image or video of the 3-D view in the background.
///
/// # Errors
///
/// Returns an error if the file may not be written.
pub(super) fn write_scene_image(
    session: &mut Session,
    request: &ScreenshotRequest,
    portrait: RenderRequest,
) -> Result<()> {
    let (width, height) = request.size;
    match request.take {
        Take::Still { transparent } => {
            let write = move |path: &Path| {
                Ok(write_png(
                    path,
                    &portrait.draw(width, height, 0.0, transparent),
                    transparent,
                )?)
            };
            session.write_image(&request.path, request.overwrite, write)
        }
        Take::Turntable { count, fps } => {
            let options = TurntableOptions {
                size: request.size,
                count,
                fps: f64::from(fps),
            };
            session.write_turntable(&request.path, options, request.overwrite, move |number| {
                portrait
                    .draw(width, height, TAU * number as f32 / count as f32, false)
                    .image
            })
        }
    }?;
    Ok(())
}
