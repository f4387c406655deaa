use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};

use super::drive::ProgressLines;
use super::print::print_text;
use super::values;
use ostra_core::job::Progress;
use ostra_eval::demo::{DemoMethod, DemoOptions, finish, make_example, run_demo};
use ostra_eval::synthetic::{SceneKind, SceneOptions, SensorNoise};
use ostra_session::Session;
use ostra_view::{
    Appearance, Coloring, RenderRequest, SceneModel, SceneStyle, ViewError, default_view, write_png,
};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum SceneName {
    Tiller,
    Bricks,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum MethodName {
    Given,
    Mvs,
    Rgbd,
}

#[derive(Debug, Args)]
pub(super) struct DemoArgs {
    /// Output folder.
    #[arg(default_value = "OUT")]
    pub out: PathBuf,
    /// Do not open the result in the window.
    #[arg(long)]
    pub headless: bool,
    /// Synthetic scene.
    #[arg(long, default_value = "tiller")]
    pub scene: SceneName,
    /// Source of cameras and depth maps: exact (given), photos (mvs) or an RGB-D recording (rgbd).
    #[arg(long, default_value = "given")]
    pub method: MethodName,
    /// Number of views.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(2..=1000))]
    pub frames: u32,
    /// Size of the images in pixels.
    #[arg(long, default_value = "480x640", value_name = "WxH", value_parser = values::size)]
    pub size: (u32, u32),
    /// Seed of the scene.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Add the noise of an RGB-D sensor to colour and depth.
    #[arg(long)]
    pub noise: bool,
}

pub(super) fn demo(args: &DemoArgs) -> Result<()> {
    let method = match args.method {
        MethodName::Given => DemoMethod::Given,
        MethodName::Mvs => DemoMethod::Stereo,
        MethodName::Rgbd => DemoMethod::Rgbd,
    };
    let (width, height) = args.size;
    let scene = match args.scene {
        SceneName::Tiller => SceneKind::Tiller,
        SceneName::Bricks => SceneKind::Bricks,
    };
    let noise = args.noise.then(SensorNoise::default);
    let (views, seed) = (args.frames as usize, args.seed);
    let scene = SceneOptions {
        scene,
        views,
        width,
        height,
        seed,
        noise,
        ..SceneOptions::default()
    };
    let mut session = Session::new();
    let mut lines = ProgressLines::default();
    let options = DemoOptions {
        out: args.out.clone(),
        scene,
        method,
    };
    let report = run_demo(&mut session, &options, &mut |jobs| lines.update(jobs))?;
    lines.end();
    session.save()?;
    draw(&session, args)?;
    drop(session);
    finish(&args.out)?;
    print_text(&report.table());
    print_text(&format!(
        "\nresults in {}: cloud.ply, mesh.ply, shot.png, report.json, truth/, project/\n",
        args.out.display()
    ));
    if args.headless || !has_display() {
        Ok(())
    } else {
        ostra_app::run(Some(args.out.join("project")), example)
    }
}

/// Makes the example project of the window; see [`make_example`].
pub(super) fn example(folder: &Path, progress: &Progress) -> Result<PathBuf> {
    make_example(folder, &SceneOptions::default(), progress)
}

fn draw(session: &Session, args: &DemoArgs) -> Result<()> {
    let cloud = session.cloud().context("the cloud is missing")?;
    let project = session.project().context("the project is missing")?;
    let appearance = Appearance {
        coloring: Coloring::Label,
        ..Appearance::default()
    };
    let (width, height) = (960, 1280);
    let orbit = default_view(cloud, &project.frames, width as f32 / height as f32)
        .ok_or(ViewError::Empty)?;
    let style = SceneStyle {
        appearance,
        ..SceneStyle::default()
    };
    let portrait = RenderRequest::new(SceneModel::Cloud(Arc::clone(cloud)), orbit, style, height);
    Ok(write_png(
        &args.out.join("shot.png"),
        &portrait.draw(width, height, 0.0, false),
        false,
    )?)
}

/// Returns `true` if a window can be opened. Only Linux may run without a display.
fn has_display() -> bool {
    !cfg!(target_os = "linux")
        || ["DISPLAY", "WAYLAND_DISPLAY"]
            .iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}
