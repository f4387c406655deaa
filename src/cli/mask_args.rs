use std::path::PathBuf;

use clap::{Args, ValueEnum};
use glam::DVec2;

use super::values;

#[derive(Debug, Args)]
pub(super) struct PromptArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Frame number, from 0.
    #[arg(long, value_name = "K")]
    pub frame: usize,
    /// The label's name.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// Pixels that belong to it.
    #[arg(long, num_args = 1.., value_name = "X,Y", value_parser = values::point)]
    pub click: Vec<DVec2>,
    /// Pixels that do not.
    #[arg(long, num_args = 1.., value_name = "X,Y", value_parser = values::point)]
    pub not: Vec<DVec2>,
    /// Boxes around it.
    #[arg(long = "box", num_args = 1.., value_name = "X0,Y0,X1,Y1", value_parser = values::px_box)]
    pub boxes: Vec<[DVec2; 2]>,
    /// auto, sam, sam-close (looks closely around each prompt), geometry (solid things in frames with depth and cameras) or builtin.
    #[arg(long, default_value = "auto", value_name = "NAME")]
    pub segmenter: String,
}

#[derive(Debug, Args)]
pub(super) struct TraceArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Frame number, from 0.
    #[arg(long, value_name = "K")]
    pub frame: usize,
    /// The label's name.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// Points along it in their order, two or more; it ends at the first and the last.
    #[arg(long, required = true, num_args = 1.., value_name = "X,Y", value_parser = values::point)]
    pub point: Vec<DVec2>,
    /// Paint over other labels too.
    #[arg(long)]
    pub replace: bool,
}

#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("what").required(true).multiple(true).args(["holes_below", "islands_below"])))]
pub(super) struct TidyArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Frame number, from 0.
    #[arg(long, value_name = "K")]
    pub frame: usize,
    /// The label's name.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// Fill holes of fewer pixels.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 0,
        hide_default_value = true
    )]
    pub holes_below: usize,
    /// Remove islands of fewer pixels; the largest piece always stays.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 0,
        hide_default_value = true
    )]
    pub islands_below: usize,
}

#[derive(Debug, Args)]
pub(super) struct GroundArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Frame number, from 0.
    #[arg(long, value_name = "K")]
    pub frame: usize,
    /// Phrases separated by ';'.
    #[arg(long)]
    pub text: String,
    /// Boxes scored below this are left out.
    #[arg(long, default_value = "0.3", value_parser = values::share)]
    pub threshold: f32,
    /// auto, grounding-dino or yolox.
    #[arg(long, default_value = "auto", value_name = "NAME")]
    pub grounder: String,
    /// Makes masks of the boxes: auto, sam, sam-close (looks closely around each prompt), geometry (solid things in frames with depth and cameras) or builtin.
    #[arg(long, default_value = "auto", value_name = "NAME")]
    pub segmenter: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum MasksVerb {
    Import,
    Export,
}

#[derive(Debug, Args)]
pub(super) struct MasksArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// import or export.
    pub verb: MasksVerb,
    /// Folder of mask files.
    pub dir: PathBuf,
    /// davis, binary, coco or yolo.
    #[arg(long, default_value = "davis", value_parser = ["davis", "binary", "coco", "yolo"])]
    pub format: String,
    /// Export: replace earlier exports that were changed since; sources and files that OSTRA did not write are never replaced.
    #[arg(long)]
    pub overwrite: bool,
}
