use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;

use super::drive::{Driver, label_id};
use super::values;
use ostra_cloud::formats::{CloudFormat, MeshFormat, VoxelFormat};
use ostra_cloud::measure::{GroundChoice, LengthUnit};
use ostra_frames::cameras::ModelEncoding;
use ostra_masks::{LabelId, MaskFormat};
use ostra_project::{ExportRequest, Project};
use ostra_session::Command;

#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    /// Project folder.
    pub project: PathBuf,
    #[arg(long, value_name = "F", help = format!("Labelled cloud ({})", CloudFormat::endings()))]
    pub cloud: Option<PathBuf>,
    #[arg(long, value_name = "F", help = format!("Labelled mesh ({})", MeshFormat::endings()))]
    pub mesh: Option<PathBuf>,
    #[arg(long, value_name = "F", help = format!("Labelled voxels ({})", VoxelFormat::endings()))]
    pub voxels: Option<PathBuf>,
    /// Cameras as a COLMAP text model.
    #[arg(long, value_name = "DIR")]
    pub cameras: Option<PathBuf>,
    /// Write the COLMAP model in binary form.
    #[arg(long, requires = "cameras")]
    pub binary: bool,
    /// Undistorted images and masks with a COLMAP model of their cameras.
    #[arg(long, value_name = "DIR")]
    pub undistorted: Option<PathBuf>,
    /// Fill the inside of closed surfaces.
    #[arg(long, requires = "voxels")]
    pub solid: bool,
    /// Masks of all frames, with labels.json.
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Format of the masks; davis (palette PNGs) unless another one is named.
    #[arg(long, requires = "masks", value_parser = values::mask_format())]
    pub mask_format: Option<MaskFormat>,
    /// Depth maps as 32-bit float TIFFs in world units.
    #[arg(long, value_name = "DIR")]
    pub depths: Option<PathBuf>,
    /// Table of traits per label.
    #[arg(long, value_name = "F.csv")]
    pub traits: Option<PathBuf>,
    /// Ground for heights: a label (table, soil) or the plane N·x = D [default: fitted]
    #[arg(
        long,
        value_name = "LABEL|NX,NY,NZ,D",
        requires = "traits",
        allow_hyphen_values = true
    )]
    pub ground: Option<String>,
    /// Add the angle between these two labels (repeatable).
    #[arg(long, value_names = ["LABEL", "LABEL"], num_args = 2, requires = "traits")]
    pub angle: Vec<String>,
    /// Unit of lengths: m, cm or mm (needs a known scale), or units [default: m if the scale is known,
    /// else units]
    #[arg(long, requires = "traits", value_parser = values::length_unit)]
    pub unit: Option<LengthUnit>,
    /// Replace deeper labels by their ancestor at this level (1 = top).
    #[arg(long, value_name = "N", value_parser = values::from_one)]
    pub level: Option<usize>,
    /// Also write a copy in label colours.
    #[arg(long)]
    pub twin: bool,
    /// Also write one file per label.
    #[arg(long)]
    pub per_label: bool,
    /// Simplify the mesh to this share of its triangles, keeping label borders.
    #[arg(long, value_name = "SHARE", requires = "mesh", value_parser = values::part)]
    pub simplify: Option<f64>,
    /// Replace earlier exports even if they were changed since. Other files are never replaced.
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
            "nothing to export; give --cloud, --mesh, --voxels, --cameras, --undistorted, --masks, --depths or --traits with a path"
        );
    }
    driver.act_and_save([Command::Export(request)])
}

/// Returns the ids of two labels given by name.
fn angle(project: &Project, names: &[String]) -> Result<[LabelId; 2]> {
    Ok([label_id(project, &names[0])?, label_id(project, &names[1])?])
}

/// Parses a ground: four numbers are a plane, any other text is the name of a label.
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
