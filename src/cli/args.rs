use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use glam::DVec2;

use super::eval_args::EvalVerb;
use super::mask_args::{GroundArgs, MasksArgs, PromptArgs, TidyArgs, TraceArgs};
use super::values;
use ostra_cloud::instances::InstanceOptions;
use ostra_cloud::measure::LengthUnit;
use ostra_compute::nn::Provider;
use ostra_frames::cameras::IntrinsicsSource;
use ostra_session::AdoptRequest;

/// Turns pictures into labelled 3-D: click, track, reconstruct, vote, measure, export.
#[derive(Debug, Parser)]
#[command(name = "ostra", version, args_conflicts_with_subcommands = true)]
pub(super) struct Cli {
    /// Open the window on a project, a folder of frames, a film or a labelled PLY.
    pub path: Option<PathBuf>,
    /// What networks run on; where it does not start, the processor does it, with a warning.
    #[arg(long, global = true, value_enum, default_value = "cpu")]
    pub provider: ProviderName,
    #[command(subcommand)]
    pub verb: Option<Verb>,
}

/// What networks run on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ProviderName {
    Cpu,
    Cuda,
    #[value(name = "tensorrt")]
    TensorRt,
    #[value(name = "coreml")]
    CoreMl,
    #[value(name = "directml")]
    DirectMl,
}

impl From<ProviderName> for Provider {
    fn from(name: ProviderName) -> Self {
        match name {
            ProviderName::Cpu => Self::Cpu,
            ProviderName::Cuda => Self::Cuda,
            ProviderName::TensorRt => Self::TensorRt,
            ProviderName::CoreMl => Self::CoreMl,
            ProviderName::DirectMl => Self::DirectMl,
        }
    }
}

#[derive(Debug, Subcommand)]
pub(super) enum Verb {
    /// A made scene with exact truth → the whole job → accuracy report, cloud, picture.
    Demo(DemoArgs),
    /// Make a project from frames.
    New(NewArgs),
    /// Put more frames into a project; nothing that is there changes.
    Add(AddArgs),
    /// Point frames to the folder (or video) that their files were moved to.
    Relocate(RelocateArgs),
    /// Make a label.
    Label(LabelArgs),
    /// Set what is given for a label on a frame (clicks, boxes) and segment it.
    Prompt(PromptArgs),
    /// Give a thin structure (stem, wire) through some points to a label.
    Trace(TraceArgs),
    /// Fill small holes of a label on a frame and remove its islands.
    Tidy(TidyArgs),
    /// Find objects by text on a frame.
    Ground(GroundArgs),
    /// Read or write masks.
    Masks(MasksArgs),
    /// Carry the masks of the anchor frames through the sequence.
    Track(TrackArgs),
    /// Delete, lock, hide, merge, split, interpolate or copy labels over a range of frames.
    Range(super::range::RangeArgs),
    /// List areas that no label explains and that move or stand apart, or all things that a segmenter sees on one frame.
    Suggest {
        /// The project's folder.
        project: PathBuf,
        /// Only this frame, and all that the segmenter takes for a thing; needs Segment Anything.
        #[arg(long, value_name = "K")]
        frame: Option<usize>,
    },
    /// Make cameras and depths.
    Reconstruct(ReconstructArgs),
    /// Give the scene a unit by a known length, e.g. of a ruler.
    Scale(ScaleArgs),
    /// Make the labelled cloud by a vote of all views.
    Fuse(FuseArgs),
    /// Say which masks the cloud's vote contradicts, the worst first; accept the vote as a frame's mask.
    Doubt(DoubtArgs),
    /// Give pieces of the cloud without a label that hang on one labelled thing to it, in the masks, too.
    Adopt(AdoptArgs),
    /// Tell the instances of a class apart by what hangs together in the cloud.
    Instances(InstancesArgs),
    /// Write results to files.
    Export(super::export::ExportArgs),
    /// Draw the labelled cloud into a PNG, or a film that goes around it.
    Shot(ShotArgs),
    /// Say what a project holds.
    Info(InfoArgs),
    /// Score a result against truth.
    #[command(subcommand)]
    Eval(EvalVerb),
    /// Networks: list, install, add, check.
    #[command(subcommand)]
    Models(ModelsVerb),
    /// Run a recipe: a list of commands.
    Run {
        /// A file as the window saves it.
        recipe: PathBuf,
    },
}

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
    /// Folder for everything the demo makes.
    #[arg(default_value = "OUT")]
    pub out: PathBuf,
    /// Do not open the window on the result.
    #[arg(long)]
    pub headless: bool,
    /// Which scene.
    #[arg(long, default_value = "tiller")]
    pub scene: SceneName,
    /// Where cameras and depths come from.
    #[arg(long, default_value = "given")]
    pub method: MethodName,
    /// Number of views.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(2..=1000))]
    pub frames: u32,
    /// Size of the views.
    #[arg(long, default_value = "480x640", value_name = "WxH", value_parser = values::size)]
    pub size: (u32, u32),
    /// Another seed makes another plant.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Colour and depth as an RGB-D sensor would see them, not exact.
    #[arg(long)]
    pub noise: bool,
}

#[derive(Debug, Args)]
pub(super) struct SourceArgs {
    /// Folder of pictures (with subfolders), picture or film; may be given more than once.
    #[arg(long, required = true, num_args = 1.., value_name = "PATH")]
    pub frames: Vec<PathBuf>,
    /// Folder of depth images (16-bit PNG or TIFF, or float TIFF) for the frames given just before.
    #[arg(long, num_args = 1.., value_name = "PATH")]
    pub depth: Vec<PathBuf>,
    /// Metres per step of the stored depth; float depths are in metres unless this is given.
    #[arg(long, default_value = "0.001", value_name = "METRES_PER_STEP", value_parser = values::positive)]
    pub depth_unit: f64,
    /// Intrinsics of the camera that measured the depths, where they do not lie on the pictures pixel for pixel.
    #[arg(long, value_name = "FX,FY,CX,CY|FILE", value_parser = values::intrinsics)]
    pub depth_intrinsics: Option<IntrinsicsSource>,
    /// 4 × 4 matrix, row by row, in metres, that takes points of the depth camera to the pictures'; without it both stand in
    /// one place.
    #[arg(long, value_name = "FILE", requires = "depth_intrinsics")]
    pub depth_pose: Option<PathBuf>,
    /// Cameras: COLMAP model, transforms.json, trajectory, pose files …
    #[arg(long, value_name = "PATH")]
    pub cameras: Option<PathBuf>,
    /// For every frame, in pixels, centre of the top-left pixel at 0.5.
    #[arg(long, value_name = "FX,FY,CX,CY|FILE", value_parser = values::intrinsics)]
    pub intrinsics: Option<IntrinsicsSource>,
    /// Take every n-th source frame.
    #[arg(long, default_value = "1", value_name = "N", value_parser = values::from_one)]
    pub every: usize,
    /// First source frame taken.
    #[arg(long, value_name = "K")]
    pub from: Option<usize>,
    /// Last source frame taken (included).
    #[arg(long, value_name = "K")]
    pub to: Option<usize>,
}

#[derive(Debug, Args)]
pub(super) struct NewArgs {
    /// Folder to make.
    pub project: PathBuf,
    #[command(flatten)]
    pub sources: SourceArgs,
}

#[derive(Debug, Args)]
pub(super) struct AddArgs {
    /// The project's folder.
    pub project: PathBuf,
    #[command(flatten)]
    pub sources: SourceArgs,
}

#[derive(Debug, Args)]
pub(super) struct RelocateArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Folder or video that is gone, as 'ostra info' names it.
    pub from: PathBuf,
    /// Where it is now; images must have the sizes that the frames had.
    pub to: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct LabelArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// The label's name.
    pub name: String,
    /// Name of the label above it.
    #[arg(long, value_name = "NAME")]
    pub parent: Option<String>,
    /// Its colour.
    #[arg(long, value_name = "#rrggbb", value_parser = values::color)]
    pub color: Option<[u8; 3]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Way {
    Both,
    Forward,
    Backward,
}

#[derive(Debug, Args)]
pub(super) struct TrackArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// auto, xmem, deaot, geometry or flow.
    #[arg(long, default_value = "auto", value_name = "NAME")]
    pub tracker: String,
    /// First frame.
    #[arg(long, value_name = "K")]
    pub from: Option<usize>,
    /// Last frame (included).
    #[arg(long, value_name = "K")]
    pub to: Option<usize>,
    /// Which way masks go from an anchor.
    #[arg(long, default_value = "both")]
    pub direction: Way,
    /// Frames between the anchors next to anchor K, both excluded.
    #[arg(long, value_name = "K", conflicts_with_all = ["from", "to"])]
    pub around: Option<usize>,
    /// Only these labels; every pixel of another label stays as it is.
    #[arg(long, value_name = "NAME")]
    pub label: Vec<String>,
    /// Write these labels over others too.
    #[arg(long, requires = "label")]
    pub replace: bool,
    /// Hold the masks against the anchors' masks carried through geometry.
    #[arg(long)]
    pub constrain: bool,
    /// End at the first frame on which a label is less sure than this.
    #[arg(long, value_name = "C", value_parser = values::share)]
    pub pause_below: Option<f32>,
    /// Shorter side of the pictures that xmem and deaot see; more shows thinner things and takes longer (deaot never
    /// enlarges).
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(64..=4096))]
    pub short_side: Option<u32>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Method {
    Auto,
    Sfm,
    Mvs,
    Rgbd,
}

#[derive(Debug, Args)]
pub(super) struct ReconstructArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// sfm: only cameras.
    #[arg(long, default_value = "auto")]
    pub method: Method,
    /// Reconstruct from every n-th frame.
    #[arg(long, default_value = "1", value_name = "N", value_parser = values::from_one)]
    pub every: usize,
    /// Where kernels run.
    #[arg(long, default_value = "auto", value_parser = ["auto", "cpu", "gpu"])]
    pub device: String,
    /// Longer sides are worked on at this size.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(64..=8192))]
    pub max_side: Option<u32>,
    /// Only where masks have a label.
    #[arg(long)]
    pub only_labelled: bool,
    /// Feature detector.
    #[arg(long, default_value = "auto", value_parser = ["auto", "sift", "xfeat", "superpoint"])]
    pub features: String,
    /// Feature matcher.
    #[arg(long, default_value = "auto", value_parser = ["auto", "nearest", "lighterglue", "superglue"])]
    pub matcher: String,
    /// Match these two frames besides those that are chosen.
    #[arg(long, value_name = "K,K", value_parser = values::frame_pair)]
    pub pair: Vec<[usize; 2]>,
    /// How pieces of an RGB-D recording that nothing else ties together are joined.
    #[arg(long, default_value = "auto", value_parser = ["auto", "fgr", "ransac"])]
    pub registration: String,
}

#[derive(Debug, Args)]
pub(super) struct ScaleArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// The known length. Everything that the project has made is scaled with it, in one step that can be undone.
    #[arg(long, value_name = "L", value_parser = values::positive)]
    pub length: f64,
    /// What the length is given in: m, cm or mm.
    #[arg(long, default_value = "m", value_parser = values::metric_unit)]
    pub unit: LengthUnit,
    /// Where a frame sees the one end: frame, x, y; for two frames or more.
    #[arg(long, value_name = "K,X,Y", value_parser = values::sighting, required = true)]
    pub from: Vec<(usize, DVec2)>,
    /// Where a frame sees the other end.
    #[arg(long, value_name = "K,X,Y", value_parser = values::sighting, required = true)]
    pub to: Vec<(usize, DVec2)>,
}

#[derive(Debug, Args)]
pub(super) struct DoubtArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Frame whose mask becomes what all frames voted for; it becomes an anchor. May be given more than once.
    #[arg(long, value_name = "K")]
    pub accept: Vec<usize>,
    /// Accept the vote for this label alone. May be given more than once.
    #[arg(long, value_name = "NAME", requires = "accept")]
    pub label: Vec<String>,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(super) struct AdoptArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Points at most this many spacings of the labelled points apart hang together.
    #[arg(long, value_name = "R", default_value_t = AdoptRequest::default().radius)]
    pub radius: f64,
}

#[derive(Debug, Args)]
pub(super) struct InstancesArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// The class; the instances become labels below it.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// Points at most this many spacings of the cloud apart are neighbours.
    #[arg(long, value_name = "R", default_value_t = InstanceOptions::default().radius)]
    pub radius: f64,
    /// Groups of fewer points are no instance.
    #[arg(long, value_name = "N", default_value_t = InstanceOptions::default().min_points)]
    pub min_points: usize,
}

#[derive(Debug, Args)]
pub(super) struct FuseArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Edge of a voxel in world units; chosen from the data when absent.
    #[arg(long, value_name = "SIZE", value_parser = values::positive)]
    pub voxel: Option<f64>,
    /// Drop points whose label won less than this share of the vote.
    #[arg(long, value_name = "C", value_parser = values::share)]
    pub min_confidence: Option<f32>,
    /// Drop points without a label.
    #[arg(long)]
    pub drop_unlabelled: bool,
    /// Vote on the points of this cloud.
    #[arg(long, value_name = "CLOUD.ply")]
    pub onto: Option<PathBuf>,
}

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
    /// The project's folder.
    pub project: PathBuf,
    /// PNG to write.
    pub out: PathBuf,
    /// What colours show.
    #[arg(long, default_value = "rgb")]
    pub color: ShotColor,
    /// What is drawn.
    #[arg(long, default_value = "cloud")]
    pub model: ShotModel,
    /// Read deeper labels as their ancestor at this depth (1 = top).
    #[arg(long, value_name = "N", value_parser = values::from_one)]
    pub level: Option<usize>,
    /// Size of picture and film.
    #[arg(long, default_value = "1280x960", value_name = "WxH", value_parser = values::size)]
    pub size: (u32, u32),
    /// Leave the picture's background transparent.
    #[arg(long)]
    pub transparent: bool,
    /// Write a film too that goes once around (ffmpeg makes it).
    #[arg(long, value_name = "FILE.mp4")]
    pub turntable: Option<PathBuf>,
    /// How long the film lasts.
    #[arg(long, default_value = "8", value_name = "S", requires = "turntable", value_parser = values::seconds)]
    pub seconds: f64,
    /// Pictures a second of the film.
    #[arg(long, default_value_t = 25, requires = "turntable", value_parser = clap::value_parser!(u32).range(1..=120))]
    pub fps: u32,
    /// Replace earlier exports that were changed since; sources and files that OSTRA did not write are never replaced.
    #[arg(long)]
    pub overwrite: bool,
}

#[derive(Debug, Args)]
pub(super) struct InfoArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
pub(super) enum ModelsVerb {
    /// What is known and what is installed.
    List,
    /// Get a network.
    Install {
        /// Its name in the catalogue.
        name: String,
    },
    /// Take a network from files.
    Add {
        /// Its name in the catalogue.
        name: String,
        /// Its files.
        #[arg(required = true)]
        files: Vec<PathBuf>,
    },
    /// Load a network and check its inputs and outputs.
    Check {
        /// Its name in the catalogue.
        name: String,
    },
}
