use std::f32::consts::TAU;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::args::{ShotArgs, ShotColor, ShotModel};
use super::drive::Driver;
use crate::frames::FilmOptions;
use crate::scene::{LabelledCloud, LabelledMesh, voxel_faces, voxelize};
use crate::view::{
    Appearance, Axes, Coloring, Orbit, SceneStyle, Shot, ShotOptions, ViewError, default_view, shot_from,
    shot_mesh_from, write_png,
};

pub(super) fn shot(args: &ShotArgs) -> Result<()> {
    let mut driver = Driver::open(&args.project)?;
    let subject = Subject::of(args, &mut driver)?;
    let options = options(args, &driver)?;
    let (width, height) = args.size;
    let frames = &driver.project()?.frames;
    let orbit = default_view(subject.points(), frames, width as f32 / height as f32).ok_or(ViewError::Empty)?;
    let picture = subject.draw(&orbit, &options, args.transparent);
    write_png(&args.out, &picture, args.transparent)
        .with_context(|| format!("{}: no picture was written", args.out.display()))?;
    turntable(args, &mut driver, subject, orbit, options)
}

fn turntable(args: &ShotArgs, driver: &mut Driver, subject: Subject, orbit: Orbit, options: ShotOptions) -> Result<()> {
    let Some(path) = &args.turntable else { return Ok(()) };
    let fps = f64::from(args.fps);
    let count = (args.seconds * fps).round().max(1.0) as usize;
    driver.write_film(path, FilmOptions { size: args.size, count, fps }, move |number| {
        let mut turned = orbit;
        turned.turn(TAU * number as f32 / count as f32);
        subject.draw(&turned, &options, false).image
    })
}

fn options(args: &ShotArgs, driver: &Driver) -> Result<ShotOptions> {
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
        "conflict and views are known for the points of a voted cloud; draw '--model cloud' after 'ostra fuse'"
    );
    let up = Axes::of_cameras(&driver.project()?.frames).up;
    let appearance = Appearance { coloring, votes, up, ..Appearance::default() };
    Ok(ShotOptions { size: args.size, style: SceneStyle { appearance, ..SceneStyle::default() } })
}

/// What is drawn.
enum Subject {
    Cloud(Arc<LabelledCloud>),
    Surface(LabelledMesh),
}

impl Subject {
    fn of(args: &ShotArgs, driver: &mut Driver) -> Result<Self> {
        match args.model {
            ShotModel::Cloud => {
                let cloud = driver.cloud()?;
                Ok(Self::Cloud(args.level.map_or_else(|| Arc::clone(&cloud), |level| Arc::new(cloud.at_level(level)))))
            }
            ShotModel::Mesh => driver.mesh().and_then(|mesh| surface(args, driver, LabelledMesh::clone(&mesh))),
            ShotModel::Voxels => voxels(driver).and_then(|mesh| surface(args, driver, mesh)),
        }
    }

    fn points(&self) -> &LabelledCloud {
        match self {
            Self::Cloud(cloud) => cloud,
            Self::Surface(mesh) => &mesh.vertices,
        }
    }

    fn draw(&self, orbit: &Orbit, options: &ShotOptions, transparent: bool) -> Shot {
        match self {
            Self::Cloud(cloud) => shot_from(cloud, orbit, options),
            Self::Surface(mesh) => shot_mesh_from(mesh, orbit, options, transparent),
        }
    }
}

fn surface(args: &ShotArgs, driver: &Driver, mut mesh: LabelledMesh) -> Result<Subject> {
    mesh.vertices.tree = driver.project()?.labels.clone();
    if let Some(level) = args.level {
        mesh.vertices = mesh.vertices.at_level(level);
    }
    Ok(Subject::Surface(mesh.split_at_labels()))
}

fn voxels(driver: &mut Driver) -> Result<LabelledMesh> {
    let voxel = driver.surface_voxel()?;
    let cloud = driver.cloud()?;
    Ok(voxel_faces(&voxelize(&cloud, driver.votes().as_deref(), voxel)?, voxel))
}
