use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::values;

#[derive(Debug, Subcommand)]
pub(super) enum EvalVerb {
    /// J and F of masks against true masks.
    Masks(EvalArgs),
    /// Labels and surface of a cloud against a true cloud.
    Cloud(EvalArgs),
    /// Camera centres and rotations against true cameras.
    Cameras(EvalArgs),
    /// A robot user: clicks needed over a sequence.
    Interact(InteractArgs),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Align {
    None,
    Se3,
    Sim3,
}

#[derive(Debug, Args)]
pub(super) struct EvalArgs {
    /// What is right.
    #[arg(long, value_name = "PATH")]
    pub truth: PathBuf,
    /// What is judged.
    #[arg(long, value_name = "PATH")]
    pub result: PathBuf,
    /// Distances in cloud units; the first one decides which points match.
    #[arg(long, value_name = "D[,D…]", value_delimiter = ',', value_parser = values::positive)]
    pub within: Vec<f64>,
    /// Read deeper labels as their ancestor at this depth (1 = top).
    #[arg(long, value_name = "N", value_parser = values::from_one)]
    pub level: Option<usize>,
    /// How cameras are brought together first.
    #[arg(long, default_value = "none")]
    pub align: Align,
    /// Align the cameras' orientations with their centres, which alone leave the turn about a straight path open.
    #[arg(long)]
    pub turns: bool,
    /// Cameras that have seen the truth, for --min-views and the share in depth.
    #[arg(long, value_name = "DIR", requires = "min_views")]
    pub cameras: Option<PathBuf>,
    /// Completeness only over truth points inside this many frusta.
    #[arg(long, value_name = "N", requires = "cameras")]
    pub min_views: Option<usize>,
    /// Folder of frames, film, or project of these cameras: what the pictures have in common tells which truth points
    /// each sees, for the share in depth.
    #[arg(long, value_name = "PATH")]
    pub frames: Option<PathBuf>,
    /// Leave the first frame out.
    #[arg(long)]
    pub skip_first: bool,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(super) struct InteractArgs {
    /// Folder of frames, film, or project (whose frames have depth and cameras).
    #[arg(long, value_name = "PATH")]
    pub frames: PathBuf,
    /// Folder of true masks.
    #[arg(long, value_name = "MASKS")]
    pub truth: PathBuf,
    /// auto, xmem, deaot, geometry or flow.
    #[arg(long, default_value = "auto", value_name = "NAME")]
    pub tracker: String,
    /// auto, sam, sam-close (looks closely around each prompt), geometry (solid things in frames with depth and cameras) or builtin.
    #[arg(long, default_value = "auto", value_name = "NAME")]
    pub segmenter: String,
    /// How far clicks fall from where they are meant: standard deviation along each axis.
    #[arg(long, default_value = "0", value_name = "PX", value_parser = values::from_zero)]
    pub jitter: f64,
    /// Another seed makes clicks fall elsewhere.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}
