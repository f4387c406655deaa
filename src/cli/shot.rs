use anyhow::{Context, Result};

use super::args::{ShotArgs, ShotColor, ShotModel};
use super::drive::Driver;
use crate::frames::Image;
use crate::scene::{LabelledMesh, voxel_faces, voxelize};
use crate::view::{Coloring, ShotOptions, shot as draw, shot_mesh, write_png};

pub(super) fn shot(args: &ShotArgs) -> Result<()> {
    let mut driver = Driver::open(&args.project)?;
    let coloring = match args.color {
        ShotColor::Rgb => Coloring::Rgb,
        ShotColor::Labels => Coloring::Label,
        ShotColor::Confidence => Coloring::Confidence,
    };
    let options = ShotOptions { coloring, ..ShotOptions::default() };
    let picture = match args.model {
        ShotModel::Cloud => {
            let cloud = driver.cloud()?;
            let coarse = args.level.map(|level| cloud.at_level(level));
            draw(coarse.as_ref().unwrap_or(&cloud), &driver.project()?.frames, &options)?
        }
        ShotModel::Mesh => draw_surface(args, &mut driver, &options, mesh)?,
        ShotModel::Voxels => draw_surface(args, &mut driver, &options, voxels)?,
    };
    write_png(&args.out, &picture).with_context(|| format!("{}: no picture was written", args.out.display()))
}

fn draw_surface(
    args: &ShotArgs,
    driver: &mut Driver,
    options: &ShotOptions,
    model: fn(&mut Driver) -> Result<LabelledMesh>,
) -> Result<Image> {
    let mut mesh = model(driver)?;
    let project = driver.project()?;
    mesh.vertices.tree = project.labels.clone();
    if let Some(level) = args.level {
        mesh.vertices = mesh.vertices.at_level(level);
    }
    Ok(shot_mesh(&mesh.split_at_labels(), &project.frames, options)?)
}

fn mesh(driver: &mut Driver) -> Result<LabelledMesh> {
    driver.mesh().map(|mesh| LabelledMesh::clone(&mesh))
}

fn voxels(driver: &mut Driver) -> Result<LabelledMesh> {
    let voxel = driver.surface_voxel()?;
    let cloud = driver.cloud()?;
    Ok(voxel_faces(&voxelize(&cloud, driver.votes().as_deref(), voxel)?, voxel))
}
