use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::parser::ValueSource;
use clap::{ArgMatches, Args};

use super::values;
use ostra_frames::cameras::{DepthCameraSource, IntrinsicsSource};
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_session::NewProject;

#[derive(Debug, Args)]
pub(super) struct SourceArgs {
    /// Folder of images (with subfolders), image or video (repeatable).
    #[arg(long, required = true, num_args = 1.., value_name = "PATH")]
    pub frames: Vec<PathBuf>,
    /// Folder of depth images (16-bit PNG or TIFF, or float TIFF) for the --frames before it.
    #[arg(long, num_args = 1.., value_name = "PATH")]
    pub depth: Vec<PathBuf>,
    /// Metres per step of the depth values; float depth is in metres unless this is given.
    #[arg(long, default_value = "0.001", value_name = "METRES_PER_STEP", value_parser = values::positive)]
    pub depth_unit: f64,
    /// Intrinsics of the depth camera, where depth is not aligned with the images.
    #[arg(long, value_name = "FX,FY,CX,CY|FILE", value_parser = values::intrinsics)]
    pub depth_intrinsics: Option<IntrinsicsSource>,
    /// File with the 4 × 4 matrix image_camera_from_depth_camera, row by row, in metres [default:
    /// identity]
    #[arg(long, value_name = "FILE", requires = "depth_intrinsics")]
    pub depth_pose: Option<PathBuf>,
    /// Cameras: COLMAP model, transforms.json, trajectory or pose files.
    #[arg(long, value_name = "PATH")]
    pub cameras: Option<PathBuf>,
    /// Intrinsics of all frames in pixels (centre of the top-left pixel at 0.5, 0.5).
    #[arg(long, value_name = "FX,FY,CX,CY|FILE", value_parser = values::intrinsics)]
    pub intrinsics: Option<IntrinsicsSource>,
    /// Use every Nth source frame.
    #[arg(long, default_value = "1", value_name = "N", value_parser = values::from_one)]
    pub every: usize,
    /// First source frame.
    #[arg(long, value_name = "K")]
    pub from: Option<usize>,
    /// Last source frame, included.
    #[arg(long, value_name = "K")]
    pub to: Option<usize>,
}

#[derive(Debug, Args)]
pub(super) struct NewArgs {
    /// Project folder to create.
    pub project: PathBuf,
    #[command(flatten)]
    pub sources: SourceArgs,
}

#[derive(Debug, Args)]
pub(super) struct AddArgs {
    /// Project folder.
    pub project: PathBuf,
    #[command(flatten)]
    pub sources: SourceArgs,
}

/// Returns the sources for `new` and `add`.
///
/// `matches` are those of the subcommand, which record the order of `--frames` and `--depth`.
pub(super) fn new_project(
    root: PathBuf,
    args: SourceArgs,
    matches: &ArgMatches,
) -> Result<NewProject> {
    let places =
        |name: &str| -> Vec<usize> { matches.indices_of(name).into_iter().flatten().collect() };
    let sources = pair(
        &args.frames,
        &places("frames"),
        &args.depth,
        &places("depth"),
    )?;
    let pose = args.depth_pose;
    let depth_camera = args
        .depth_intrinsics
        .map(|intrinsics| DepthCameraSource { intrinsics, pose });
    let (depth_unit, every, from, to) = (args.depth_unit, args.every, args.from, args.to);
    // Float depth is in metres unless a unit is given; the default of 0.001 is for integers.
    let is_given = matches.value_source("depth_unit") == Some(ValueSource::CommandLine);
    let float_depth_unit = if is_given { depth_unit } else { 1.0 };
    Ok(NewProject {
        root,
        open: OpenRequest {
            sources,
            depth_unit,
            float_depth_unit,
            depth_camera,
            ignore_depth: false,
            every,
            from,
            to,
        },
        cameras: args.cameras,
        intrinsics: args.intrinsics,
    })
}

/// Assigns each depth folder to the frames folder given just before it.
fn pair(
    frames: &[PathBuf],
    frames_at: &[usize],
    depths: &[PathBuf],
    depths_at: &[usize],
) -> Result<Vec<FrameFolder>> {
    let mut sources: Vec<FrameFolder> = frames
        .iter()
        .map(|path| FrameFolder {
            frames: path.clone(),
            depth: None,
        })
        .collect();
    for (depth, at) in depths.iter().zip(depths_at) {
        let Some(owner) = frames_at.iter().rposition(|frames_at| frames_at < at) else {
            bail!(
                "--depth {} comes before any --frames; give it directly after its --frames",
                depth.display()
            );
        };
        if let Some(other) = sources[owner].depth.replace(depth.clone()) {
            bail!(
                "{} and {} are both given as the depth of {}; give each --depth directly after its --frames",
                other.display(),
                depth.display(),
                frames[owner].display()
            );
        }
    }
    Ok(sources)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(names: &[&str]) -> Vec<PathBuf> {
        names.iter().map(PathBuf::from).collect()
    }

    #[test]
    fn depth_belongs_to_the_preceding_frames() {
        let sources = pair(
            &paths(&["a", "b", "c"]),
            &[2, 6, 8],
            &paths(&["da", "dc"]),
            &[4, 10],
        )
        .unwrap();
        let depths: Vec<_> = sources
            .iter()
            .map(|source| source.depth.as_deref().and_then(|p| p.to_str()))
            .collect();
        assert_eq!(depths, [Some("da"), None, Some("dc")]);
    }

    #[test]
    fn depth_without_frames_and_second_depth_are_rejected() {
        assert!(pair(&paths(&["a"]), &[4], &paths(&["d"]), &[2]).is_err());
        assert!(pair(&paths(&["a"]), &[2], &paths(&["d", "e"]), &[4, 6]).is_err());
    }
}
