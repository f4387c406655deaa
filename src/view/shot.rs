use std::collections::BTreeSet;
use std::path::Path;

use glam::Vec3;

use super::{Bounds, Coloring, Orbit, RasterStyle, ViewError, draw_cloud, draw_mesh};
use crate::frames::{Frame, Image};
use crate::masks::LabelId;
use crate::scene::{LabelledCloud, LabelledMesh};

/// What a shot shows.
#[derive(Debug, Clone, PartialEq)]
pub struct ShotOptions {
    /// Columns and rows in pixels.
    pub size: (u32, u32),
    /// What point colours show.
    pub coloring: Coloring,
    /// Labels (with all below them) that are not drawn.
    pub hidden: BTreeSet<LabelId>,
}

impl Default for ShotOptions {
    fn default() -> Self {
        Self { size: (1280, 960), coloring: Coloring::Rgb, hidden: BTreeSet::new() }
    }
}

/// Draws a cloud as [`default_view`] sees it, on the CPU: the same picture on every machine.
///
/// # Errors
/// [`ViewError::Empty`] without points.
pub fn shot(cloud: &LabelledCloud, frames: &[Frame], options: &ShotOptions) -> Result<Image, ViewError> {
    let orbit =
        default_view(cloud, frames, options.size.0 as f32 / options.size.1.max(1) as f32).ok_or(ViewError::Empty)?;
    let style = RasterStyle { coloring: options.coloring, hidden: options.hidden.clone(), ..RasterStyle::default() };
    Ok(draw_cloud(cloud, &orbit.camera(options.size.0, options.size.1), &style))
}

/// Draws a mesh as [`shot`] draws a cloud, each pixel the mean of four.
///
/// # Errors
/// [`ViewError::Empty`] without vertices.
pub fn shot_mesh(mesh: &LabelledMesh, frames: &[Frame], options: &ShotOptions) -> Result<Image, ViewError> {
    let (width, height) = options.size;
    let aspect = width as f32 / height.max(1) as f32;
    let orbit = default_view(&mesh.vertices, frames, aspect).ok_or(ViewError::Empty)?;
    let style = RasterStyle { coloring: options.coloring, hidden: options.hidden.clone(), ..RasterStyle::default() };
    let fine = draw_mesh(mesh, &orbit.camera(width * 2, height * 2), &style);
    let mean = |at: usize| {
        let (x, y) = (at % width as usize * 2, at / width as usize * 2);
        let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]
            .map(|(x, y)| fine.pixels[y * fine.width as usize + x].map(u32::from));
        [0, 1, 2].map(|channel| (four.iter().map(|color| color[channel]).sum::<u32>() / 4) as u8)
    };
    Ok(Image { width, height, pixels: (0..width as usize * height as usize).map(mean).collect() })
}

/// The view that shows the labelled points (all points where none has a label) as the cameras saw them: along the
/// mean direction of the cameras, upright as they stood; without cameras along +z with y down. `None` without points.
#[must_use]
pub fn default_view(cloud: &LabelledCloud, frames: &[Frame], aspect: f32) -> Option<Orbit> {
    let labelled = || cloud.positions.iter().zip(&cloud.labels).filter(|(_, label)| label.0 != 0).map(|(x, _)| *x);
    let bounds = Bounds::of(labelled()).or_else(|| Bounds::of(cloud.positions.iter().copied()))?;
    let poses = || frames.iter().filter_map(|frame| frame.posed_camera()).map(|(_, pose)| *pose);
    let mean = |axis: Vec3| poses().map(|pose| pose.rotation.as_quat().conjugate() * axis).sum::<Vec3>();
    let up = mean(Vec3::NEG_Y).try_normalize().unwrap_or(Vec3::NEG_Y);
    let direction = mean(Vec3::Z).try_normalize().unwrap_or(Vec3::new(0.25, 0.15, 1.0));
    let mut orbit = Orbit::framing(&bounds, direction, up);
    orbit.distance /= aspect.clamp(0.2, 1.0);
    Some(orbit)
}

/// Writes a picture as PNG, to a temporary name first.
///
/// # Errors
/// [`ViewError::Write`] when the folder is missing or cannot be written.
pub fn write_png(path: &Path, image: &Image) -> Result<(), ViewError> {
    let fail = |what: String| ViewError::Write { path: path.to_owned(), what };
    let part = path.with_extension("png.part");
    let bytes = bytemuck::cast_slice(&image.pixels);
    image::save_buffer_with_format(
        &part,
        bytes,
        image.width,
        image.height,
        image::ColorType::Rgb8,
        image::ImageFormat::Png,
    )
    .map_err(|error| fail(error.to_string()))?;
    std::fs::rename(&part, path).map_err(|error| fail(error.to_string()))
}
