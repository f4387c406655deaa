use std::path::PathBuf;

use clap::{Parser, Subcommand, ValueEnum};

use super::cloud::{AdoptArgs, DoubtArgs, FuseArgs, InstancesArgs};
use super::demo::DemoArgs;
use super::eval::EvalVerb;
use super::info::InfoArgs;
use super::masks::{GroundArgs, MasksArgs, PromptArgs, TidyArgs, TraceArgs};
use super::models::ModelsVerb;
use super::project::{LabelArgs, ReconstructArgs, RelocateArgs, ScaleArgs, TrackArgs};
use super::shot::ShotArgs;
use super::sources::{AddArgs, NewArgs};
use ostra_compute::nn::Provider;

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
