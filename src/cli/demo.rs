use std::sync::Arc;

use anyhow::{Context, Result};

use super::args::{DemoArgs, MethodName, SceneName};
use super::drive::ProgressLines;
use super::print::say;
use ostra_eval::demo::{DemoMethod, DemoOptions, finish, run_demo};
use ostra_eval::synthetic::{SceneKind, SceneOptions, SensorNoise};
use ostra_session::Session;
use ostra_view::{
    Appearance, Coloring, Model, Portrait, SceneStyle, ViewError, default_view, write_png,
};

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
    let report = run_demo(&mut session, &options, &mut |jobs| lines.glance(jobs))?;
    lines.end();
    session.save()?;
    draw(&session, args)?;
    drop(session);
    finish(&args.out)?;
    say(&report.table());
    say(&format!(
        "\nresults in {}: cloud.ply, mesh.ply, shot.png, report.json, truth/, project/\n",
        args.out.display()
    ));
    if args.headless || !has_display() {
        Ok(())
    } else {
        ostra_app::run(Some(args.out.join("project")))
    }
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
    let portrait = Portrait::new(Model::Cloud(Arc::clone(cloud)), orbit, style, height);
    Ok(write_png(
        &args.out.join("shot.png"),
        &portrait.draw((width, height), 0.0, false),
        false,
    )?)
}

/// Whether a window can be opened; other systems than X11 and Wayland always have one.
fn has_display() -> bool {
    !cfg!(target_os = "linux")
        || ["DISPLAY", "WAYLAND_DISPLAY"]
            .iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}
