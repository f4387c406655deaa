use std::f32::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};

use super::drive::Driver;
use super::values;
use ostra_cloud::{LabelledMesh, voxel_faces, voxelize};
use ostra_frames::TurntableOptions;
use ostra_project::export_targets::ExportTargets;
use ostra_view::{
    Appearance, Axes, Coloring, RenderRequest, SceneModel, SceneStyle, ViewError, default_view,
    write_png,
};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ShotColor {
    Rgb,
    Labels,
    Confidence,
    Conflict,
    Views,
    Normals,
    Height,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ShotModel {
    Cloud,
    Mesh,
    Voxels,
}

#[derive(Debug, Args)]
pub(super) struct ShotArgs {
    /// Project folder.
    pub project: PathBuf,
    /// PNG file to write.
    pub out: PathBuf,
    /// Colours of the points.
    #[arg(long, default_value = "rgb")]
    pub color: ShotColor,
    /// Model to draw.
    #[arg(long, default_value = "cloud")]
    pub model: ShotModel,
    /// Replace deeper labels by their ancestor at this level (1 = top).
    #[arg(long, value_name = "N", value_parser = values::from_one)]
    pub level: Option<usize>,
    /// Size of image and video in pixels.
    #[arg(long, default_value = "1280x960", value_name = "WxH", value_parser = values::size)]
    pub size: (u32, u32),
    /// Make the background of the image transparent.
    #[arg(long)]
    pub transparent: bool,
    /// Also write a video that goes once around the model (needs ffmpeg).
    #[arg(long, value_name = "FILE.mp4")]
    pub turntable: Option<PathBuf>,
    /// Duration of the video in seconds.
    #[arg(long, default_value = "8", value_name = "S", requires = "turntable", value_parser = values::seconds)]
    pub seconds: f64,
    /// Frames per second of the video.
    #[arg(long, default_value_t = 25, requires = "turntable", value_parser = clap::value_parser!(u32).range(1..=120))]
    pub fps: u32,
    /// Replace earlier exports even if they were changed since. Other files are never replaced.
    #[arg(long)]
    pub overwrite: bool,
}

pub(super) fn shot(args: &ShotArgs) -> Result<()> {
    let mut driver = Driver::view(&args.project)?;
    for file in std::iter::once(&args.out).chain(&args.turntable) {
        driver.check_export(file, args.overwrite)?;
    }
    let model = model(args, &mut driver)?;
    let style = style(args, &driver)?;
    let (width, height) = args.size;
    let frames = &driver.project()?.frames;
    let orbit = default_view(model.points(), frames, width as f32 / height as f32)
        .ok_or(ViewError::Empty)?;
    let portrait = RenderRequest::new(model, orbit, style, height);
    ExportTargets::write_files(std::slice::from_ref(&args.out), || {
        write_png(
            &args.out,
            &portrait.draw(width, height, 0.0, args.transparent),
            args.transparent,
        )
        .with_context(|| format!("{}: the image could not be written", args.out.display()))
    })?;
    turntable(args, &mut driver, portrait)
}

fn turntable(args: &ShotArgs, driver: &mut Driver, portrait: RenderRequest) -> Result<()> {
    let Some(path) = &args.turntable else {
        return Ok(());
    };
    let fps = f64::from(args.fps);
    let count = (args.seconds * fps).round().max(1.0) as usize;
    let (width, height) = args.size;
    let options = TurntableOptions {
        size: args.size,
        count,
        fps,
    };
    driver.write_turntable(path, options, args.overwrite, move |number| {
        portrait
            .draw(width, height, TAU * number as f32 / count as f32, false)
            .image
    })
}

fn style(args: &ShotArgs, driver: &Driver) -> Result<SceneStyle> {
    let coloring = match args.color {
        ShotColor::Rgb => Coloring::Rgb,
        ShotColor::Labels => Coloring::Label,
        ShotColor::Confidence => Coloring::Confidence,
        ShotColor::Conflict => Coloring::Conflict,
        ShotColor::Views => Coloring::Views,
        ShotColor::Normals => Coloring::Normals,
        ShotColor::Height => Coloring::Height,
    };
    let votes = driver.votes().filter(|_| coloring.needs_votes());
    ensure!(
        !coloring.needs_votes() || (votes.is_some() && args.model == ShotModel::Cloud),
        "--color conflict and --color views need the votes of a cloud; run 'ostra fuse' and use --model cloud"
    );
    let up = Axes::of_cameras(&driver.project()?.frames).up;
    let appearance = Appearance {
        coloring,
        votes,
        up,
        ..Appearance::default()
    };
    Ok(SceneStyle {
        appearance,
        ..SceneStyle::default()
    })
}

/// Returns the model to draw.
fn model(args: &ShotArgs, driver: &mut Driver) -> Result<SceneModel> {
    match args.model {
        ShotModel::Cloud => {
            let cloud = driver.cloud()?;
            Ok(SceneModel::Cloud(args.level.map_or_else(
                || Arc::clone(&cloud),
                |level| Arc::new(cloud.at_level(level)),
            )))
        }
        ShotModel::Mesh => driver
            .mesh()
            .and_then(|mesh| surface(args, driver, LabelledMesh::clone(&mesh))),
        ShotModel::Voxels => voxels(driver).and_then(|mesh| surface(args, driver, mesh)),
    }
}

fn surface(args: &ShotArgs, driver: &Driver, mut mesh: LabelledMesh) -> Result<SceneModel> {
    mesh.vertices.tree = driver.project()?.labels.clone();
    if let Some(level) = args.level {
        mesh.vertices = mesh.vertices.at_level(level);
    }
    Ok(SceneModel::Surface(Arc::new(mesh.split_at_labels())))
}

fn voxels(driver: &mut Driver) -> Result<LabelledMesh> {
    let voxel = driver.surface_voxel()?;
    let cloud = driver.cloud()?;
    Ok(voxel_faces(
        &voxelize(&cloud, driver.votes().as_deref(), voxel)?,
        voxel,
    ))
}
