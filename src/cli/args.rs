use std::path::PathBuf;

use clap::{Parser, ValueEnum};

use super::bench::BenchArgs;
use super::cloud::{AttachArgs, ConflictsArgs, FuseArgs, InstancesArgs};
use super::demo::DemoArgs;
use super::eval::EvalCommand;
use super::info::InfoArgs;
use super::masks::{CleanArgs, GroundArgs, MasksArgs, PromptArgs, TraceArgs};
use super::models::ModelsCommand;
use super::project::{
    LabelArgs, ReconstructArgs, RelocateArgs, ScaleArgs, SelectModelArgs, TrackArgs,
};
use super::shot::ShotArgs;
use super::sources::{AddArgs, NewArgs};
use ostra_compute::nn::Provider;

/// Turn photos, videos and RGB-D recordings into labelled 3-D models.
///
/// The steps: open, label, track, reconstruct, fuse, measure, export. Without a command the window
/// opens.
#[derive(Debug, Parser)]
#[command(name = "ostra", version, args_conflicts_with_subcommands = true)]
pub(super) struct Cli {
    /// Project, folder of frames, video or labelled PLY to open in the window.
    pub path: Option<PathBuf>,
    /// Device that runs neural networks; falls back to the CPU with a warning.
    #[arg(long, global = true, value_enum, default_value = "cpu")]
    pub provider: ProviderName,
    #[command(subcommand)]
    pub command: Option<Subcommand>,
}

/// Device that runs neural networks.
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

#[derive(Debug, clap::Subcommand)]
pub(super) enum Subcommand {
    /// Run every step on a synthetic scene and report the accuracy against its ground truth.
    Demo(DemoArgs),
    /// Create a project from frames.
    New(NewArgs),
    /// Add frames to a project.
    Add(AddArgs),
    /// Update the paths of frames whose files have moved.
    Relocate(RelocateArgs),
    /// Add a label.
    Label(LabelArgs),
    /// Set the clicks and boxes of a label on a frame and segment it.
    Prompt(PromptArgs),
    /// Trace a stem or wire through some points.
    Trace(TraceArgs),
    /// Fill holes and remove specks of a label on a frame.
    #[command(alias = "tidy")]
    Clean(CleanArgs),
    /// Find objects by text on a frame.
    Ground(GroundArgs),
    /// Import or export masks.
    Masks(MasksArgs),
    /// Propagate the masks of keyframes to the other frames.
    Track(TrackArgs),
    /// Delete, lock, hide, merge, split, interpolate or copy labels over a range of frames.
    Range(super::range::RangeArgs),
    /// List unlabelled regions that are likely objects.
    Suggest {
        /// Project folder.
        project: PathBuf,
        /// List every object on this frame instead; needs Segment Anything.
        #[arg(long, value_name = "K")]
        frame: Option<usize>,
    },
    /// Compute cameras and depth maps.
    Reconstruct(ReconstructArgs),
    /// Use another one of the models that the images fall into, as listed by 'ostra info'.
    SelectModel(SelectModelArgs),
    /// Set the scale from a known length, such as a ruler.
    Scale(ScaleArgs),
    /// Fuse depth maps into a cloud and label each point by a vote of all views.
    Fuse(FuseArgs),
    /// List the frames whose masks disagree with the vote, or replace their masks by it.
    #[command(alias = "doubt")]
    Conflicts(ConflictsArgs),
    /// Give unlabelled fragments of the cloud to the object that they are attached to.
    #[command(alias = "adopt")]
    Attach(AttachArgs),
    /// Split a class into instances by connected points.
    Instances(InstancesArgs),
    /// Export clouds, meshes, voxels, masks, cameras, depth maps and traits.
    Export(super::export::ExportArgs),
    /// Render the cloud to an image or a turntable video.
    Shot(ShotArgs),
    /// Summarise a project.
    Info(InfoArgs),
    /// Remove the cached features and matches of a project; they are computed again when needed.
    CleanCache {
        /// Project folder.
        project: PathBuf,
    },
    /// Score a result against ground truth.
    #[command(subcommand)]
    Eval(EvalCommand),
    /// Measure the time, accuracy and memory of reconstructions of data sets.
    Bench(BenchArgs),
    /// List, install, add or check neural networks.
    #[command(subcommand)]
    Models(ModelsCommand),
    /// Run the commands of a recipe.
    Run {
        /// Recipe saved by the window, or the recipe.jsonl of a project.
        #[arg(required_unless_present = "schema")]
        recipe: Option<PathBuf>,
        /// Print the JSON Schema of recipes.
        #[arg(long, conflicts_with = "recipe")]
        schema: bool,
    },
}
