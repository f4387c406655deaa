use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;

use super::drive::{Driver, label_id};
use super::values;
use ostra_cloud::measure::{GroundChoice, LengthUnit};
use ostra_frames::cameras::ModelEncoding;
use ostra_masks::LabelId;
use ostra_project::{ExportRequest, Project};
use ostra_session::Command;

#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Labelled cloud (.ply, .las, .laz or .pcd).
    #[arg(long, value_name = "F")]
    pub cloud: Option<PathBuf>,
    /// Labelled mesh (.ply, .obj or .glb).
    #[arg(long, value_name = "F")]
    pub mesh: Option<PathBuf>,
    /// Labelled voxels (.ply, .npz or .vox).
    #[arg(long, value_name = "F")]
    pub voxels: Option<PathBuf>,
    /// COLMAP text model.
    #[arg(long, value_name = "DIR")]
    pub cameras: Option<PathBuf>,
    /// The COLMAP model in its binary encoding.
    #[arg(long, requires = "cameras")]
    pub binary: bool,
    /// Pictures and masks without lens distortion, with a COLMAP model of their cameras.
    #[arg(long, value_name = "DIR")]
    pub undistorted: Option<PathBuf>,
    /// Fill voxels with what they enclose.
    #[arg(long, requires = "voxels")]
    pub solid: bool,
    /// Masks of all frames, with labels.json.
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// How masks are written: davis (palette PNGs), binary, coco or yolo.
    #[arg(long, requires = "masks", value_parser = ["davis", "binary", "coco", "yolo"])]
    pub mask_format: Option<String>,
    /// 32-bit float TIFFs in world units.
    #[arg(long, value_name = "DIR")]
    pub depths: Option<PathBuf>,
    /// Measurements per label.
    #[arg(long, value_name = "F.csv")]
    pub traits: Option<PathBuf>,
    /// Measure heights above a label (a table, the soil) or the plane NX,NY,NZ,D (all x with N·x = D); fitted when absent.
    #[arg(
        long,
        value_name = "LABEL|NX,NY,NZ,D",
        requires = "traits",
        allow_hyphen_values = true
    )]
    pub ground: Option<String>,
    /// Tell the angle between these two labels where they meet too. May be given more than once.
    #[arg(long, value_names = ["LABEL", "LABEL"], num_args = 2, requires = "traits")]
    pub angle: Vec<String>,
    /// Give lengths in m, cm or mm (of a scene whose scale is known), or in the scene's own units.
    #[arg(long, requires = "traits", value_parser = values::length_unit)]
    pub unit: Option<LengthUnit>,
    /// Read deeper labels as their ancestor at this depth (1 = top).
    #[arg(long, value_name = "N", value_parser = values::from_one)]
    pub level: Option<usize>,
    /// Write the same points in label colours beside the file.
    #[arg(long)]
    pub twin: bool,
    /// Write one file per label too.
    #[arg(long)]
    pub per_label: bool,
    /// Keep this share of the mesh's triangles; borders of labels stay.
    #[arg(long, value_name = "SHARE", requires = "mesh", value_parser = values::part)]
    pub simplify: Option<f64>,
    /// Replace earlier exports that were changed since; sources and files that OSTRA did not write are never replaced.
    #[arg(long)]
    pub overwrite: bool,
}

pub(super) fn export(args: ExportArgs) -> Result<()> {
    let driver = Driver::view(&args.project)?;
    let angles = args
        .angle
        .chunks_exact(2)
        .map(|pair| angle(driver.project()?, pair))
        .collect::<Result<_>>()?;
    let ground = args
        .ground
        .as_deref()
        .map_or(Ok(GroundChoice::Fitted), |text| {
            ground(driver.project()?, text)
        })?;
    let request = ExportRequest {
        cloud: args.cloud,
        mesh: args.mesh,
        voxels: args.voxels,
        cameras: args.cameras,
        camera_encoding: if args.binary {
            ModelEncoding::Binary
        } else {
            ModelEncoding::Text
        },
        undistorted: args.undistorted,
        solid: args.solid,
        masks: args.masks,
        mask_format: args.mask_format,
        depths: args.depths,
        traits: args.traits,
        ground,
        angles,
        unit: args.unit,
        level: args.level,
        twin: args.twin,
        per_label: args.per_label,
        simplify: args.simplify,
        overwrite: args.overwrite,
    };
    if request
        == (ExportRequest {
            level: request.level,
            twin: request.twin,
            per_label: request.per_label,
            overwrite: request.overwrite,
            ..Default::default()
        })
    {
        bail!(
            "nothing to export was named; give --cloud, --mesh, --voxels, --cameras, --masks, --depths or --traits with a path"
        );
    }
    driver.act_and_save([Command::Export(request)])
}

/// The labels of these two names.
fn angle(project: &Project, names: &[String]) -> Result<[LabelId; 2]> {
    Ok([label_id(project, &names[0])?, label_id(project, &names[1])?])
}

/// Four numbers are a plane, all else is a label's name.
fn ground(project: &Project, text: &str) -> Result<GroundChoice> {
    let numbers: Result<Vec<f64>, _> = text
        .split(',')
        .map(|number| number.trim().parse())
        .collect();
    match numbers.as_deref() {
        Ok(&[x, y, z, offset]) => Ok(GroundChoice::Plane {
            normal: [x, y, z],
            offset,
        }),
        _ => Ok(GroundChoice::Label(label_id(project, text)?)),
    }
}
