//! Commands on the masks of frames: prompts, traces, text prompts, clean-up, mask files.

use ostra_project::{GrounderId, SegmenterId};
use std::path::PathBuf;

use anyhow::{Result, bail, ensure};
use clap::{Args, ValueEnum};
use glam::DVec2;

use super::drive::{Driver, label_id};
use super::print::print_text;
use super::values;
use ostra_masks::{AnswerSize, Click, MaskFormat, Prompt, PxBox};
use ostra_session::{
    CleanRequest, Command, FindByTextRequest, PromptRequest, TakeRequest, TraceRequest,
};

#[derive(Debug, Args)]
pub(super) struct PromptArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Frame number, from 0.
    #[arg(long, value_name = "K")]
    pub frame: usize,
    /// Name of the label.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// Pixels inside the object.
    #[arg(long, num_args = 1.., value_name = "X,Y", value_parser = values::point)]
    pub click: Vec<DVec2>,
    /// Pixels outside the object.
    #[arg(long, num_args = 1.., value_name = "X,Y", value_parser = values::point)]
    pub not: Vec<DVec2>,
    /// Boxes around the object.
    #[arg(long = "box", num_args = 1.., value_name = "X0,Y0,X1,Y1", value_parser = values::px_box)]
    pub boxes: Vec<[DVec2; 2]>,
    /// Size of the answer to the last click: a part, the object, or a group of objects. Repeat the
    /// last prompt with another size if it took too much or too little.
    #[arg(long, default_value = "auto", value_name = "SIZE", value_parser = values::answer_size())]
    pub size: AnswerSize,
    /// Segmenter; sam-close works at full resolution around each prompt, geometry needs depth and
    /// cameras.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<SegmenterId>())]
    pub segmenter: SegmenterId,
}

#[derive(Debug, Args)]
pub(super) struct TraceArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Frame number, from 0.
    #[arg(long, value_name = "K")]
    pub frame: usize,
    /// Name of the label.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// Two or more points along the structure in order, from end to end.
    #[arg(long, required = true, num_args = 1.., value_name = "X,Y", value_parser = values::point)]
    pub point: Vec<DVec2>,
    /// Overwrite other labels.
    #[arg(long)]
    pub replace: bool,
}

#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("what").required(true).multiple(true).args(["holes_below", "islands_below"])))]
pub(super) struct CleanArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Frame number, from 0.
    #[arg(long, value_name = "K")]
    pub frame: usize,
    /// Name of the label.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// Fill holes smaller than this many pixels.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 0,
        hide_default_value = true
    )]
    pub holes_below: usize,
    /// Remove specks smaller than this many pixels; the largest part is kept.
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
    /// Project folder.
    pub project: PathBuf,
    /// Frame number, from 0.
    #[arg(long, value_name = "K")]
    pub frame: usize,
    /// Objects to find, separated by ';'.
    #[arg(long)]
    pub text: String,
    /// Minimum confidence of a box.
    #[arg(long, default_value = "0.3", value_parser = values::share)]
    pub threshold: f32,
    /// Grounder.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<GrounderId>())]
    pub grounder: GrounderId,
    /// Segmenter that makes masks of the boxes.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<SegmenterId>())]
    pub segmenter: SegmenterId,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum MasksDirection {
    Import,
    Export,
}

#[derive(Debug, Args)]
pub(super) struct MasksArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Whether to read or write mask files.
    #[arg(value_name = "DIRECTION")]
    pub direction: MasksDirection,
    /// Folder of mask files.
    pub dir: PathBuf,
    /// Format of the mask files.
    #[arg(long, default_value = MaskFormat::default().name(), value_parser = values::mask_format())]
    pub format: MaskFormat,
    /// Replace earlier exports even if they were changed since. Other files are never replaced.
    #[arg(long)]
    pub overwrite: bool,
}

pub(super) fn prompt(args: &PromptArgs) -> Result<()> {
    let driver = Driver::open(&args.project)?;
    let label = label_id(driver.project()?, &args.label)?;
    let click = |include| move |&at_px| Click { at_px, include };
    let clicks = args
        .click
        .iter()
        .map(click(true))
        .chain(args.not.iter().map(click(false)))
        .collect();
    let boxes = args
        .boxes
        .iter()
        .map(|&[min_px, max_px]| PxBox { min_px, max_px })
        .collect();
    let request = PromptRequest {
        frame: args.frame,
        label,
        prompt: Prompt {
            clicks,
            boxes,
            size: args.size,
            ..Prompt::default()
        },
        segmenter: args.segmenter,
    };
    let former = driver.project()?.prompts.get(&(args.frame, label));
    ensure!(
        request.prompt.is_empty()
            || request.prompt.has_inside()
            || !former.is_some_and(Prompt::has_inside),
        "a prompt replaces the earlier one of '{}' on frame {}, and --not alone would leave nothing; give its clicks inside again, with --click",
        args.label,
        args.frame
    );
    driver.act_and_save([Command::Prompt(request)])
}

pub(super) fn ground(args: &GroundArgs) -> Result<()> {
    let mut driver = Driver::open(&args.project)?;
    let phrases = args.text.split(';').map(|phrase| phrase.trim().to_owned());
    let phrases: Vec<String> = phrases.filter(|phrase| !phrase.is_empty()).collect();
    let (frame, threshold) = (args.frame, Some(args.threshold));
    driver.act(Command::Ground(FindByTextRequest {
        frame,
        phrases,
        threshold,
        grounder: args.grounder,
    }))?;
    let found = driver.found();
    if found.is_empty() {
        bail!(
            "'{}' was not found on frame {frame}; try a lower --threshold, another frame or another text",
            args.text
        );
    }
    for thing in &found {
        let PxBox { min_px, max_px } = thing.extent;
        let extent = format!(
            "{:.0},{:.0},{:.0},{:.0}",
            min_px.x, min_px.y, max_px.x, max_px.y
        );
        print_text(&format!(
            "{}: {:.0} %, {extent}\n",
            thing.phrase,
            100.0 * thing.score
        ));
    }
    let things = found
        .into_iter()
        .map(|thing| (thing.phrase, thing.extent))
        .collect();
    driver.act_and_save([Command::TakeFound(TakeRequest {
        frame,
        things,
        segmenter: args.segmenter,
    })])
}

pub(super) fn masks(args: MasksArgs) -> Result<()> {
    let (dir, format, overwrite) = (args.dir, args.format, args.overwrite);
    match args.direction {
        MasksDirection::Import => {
            Driver::open(&args.project)?.act_and_save([Command::ImportMasks { dir, format }])
        }
        MasksDirection::Export => {
            Driver::view(&args.project)?.act_and_save([Command::ExportMasks {
                dir,
                format,
                overwrite,
            }])
        }
    }
}

pub(super) fn trace(args: TraceArgs) -> Result<()> {
    let driver = Driver::open(&args.project)?;
    let label = label_id(driver.project()?, &args.label)?;
    let request = TraceRequest {
        frame: args.frame,
        label,
        points_px: args.point,
        replace: args.replace,
    };
    driver.act_and_save([Command::Trace(request)])
}

pub(super) fn clean(args: &CleanArgs) -> Result<()> {
    let driver = Driver::open(&args.project)?;
    let label = label_id(driver.project()?, &args.label)?;
    let (holes_below_px, islands_below_px) = (args.holes_below, args.islands_below);
    driver.act_and_save([Command::Clean(CleanRequest {
        frame: args.frame,
        label,
        holes_below_px,
        islands_below_px,
    })])
}
