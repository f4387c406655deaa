use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use glam::DVec2;

use super::drive::{Driver, label_id};
use super::values;
use ostra_masks::LabelId;
use ostra_project::Project;
use ostra_session::{Command, RangeChange, RangeRequest};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum RangeVerb {
    /// Take them off; no tracker brings them back.
    Delete,
    /// Let trackers find them again.
    Restore,
    /// Keep their pixels as they are.
    Lock,
    /// Take the lock away.
    Unlock,
    /// Keep them, but neither vote nor export.
    Hide,
    /// Show them again.
    Show,
    /// Give their pixels to the label --into.
    Merge,
    /// Give the piece at --at on --frame to the label --into.
    Split,
    /// Put shapes between those of the first and last frame.
    Interpolate,
    /// Put the masks of --frame onto the range.
    Copy,
}

#[derive(Debug, Args)]
pub(super) struct RangeArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// What to do.
    pub verb: RangeVerb,
    /// Which labels; all when none is named.
    #[arg(long, value_name = "NAME", required_if_eq("verb", "split"))]
    pub label: Vec<String>,
    /// First frame.
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub from: usize,
    /// Last frame (included); the last one when left out.
    #[arg(long, value_name = "K")]
    pub to: Option<usize>,
    /// The label that gets the pixels (merge, split).
    #[arg(long, value_name = "NAME", required_if_eq_any([("verb", "merge"), ("verb", "split")]))]
    pub into: Option<String>,
    /// The frame pointed at (split) or copied (copy).
    #[arg(long, value_name = "K", required_if_eq_any([("verb", "split"), ("verb", "copy")]))]
    pub frame: Option<usize>,
    /// A pixel of the piece (split).
    #[arg(long, value_name = "X,Y", value_parser = values::point, required_if_eq("verb", "split"))]
    pub at: Option<DVec2>,
    /// Write over other labels too (interpolate, copy).
    #[arg(long)]
    pub replace: bool,
}

pub(super) fn range(args: &RangeArgs) -> Result<()> {
    let driver = Driver::open(&args.project)?;
    let project = driver.project()?;
    let request = RangeRequest {
        labels: args
            .label
            .iter()
            .map(|name| label_id(project, name))
            .collect::<Result<_>>()?,
        from: args.from,
        to: args.to.unwrap_or(project.frames.len().saturating_sub(1)),
        change: change(args, project)?,
        replace: args.replace,
    };
    driver.act_and_save([Command::Range(request)])
}

fn change(args: &RangeArgs, project: &Project) -> Result<RangeChange> {
    let into = || -> Result<LabelId> {
        label_id(project, args.into.as_deref().context("--into is missing")?)
    };
    let frame = || args.frame.context("--frame is missing");
    Ok(match args.verb {
        RangeVerb::Delete => RangeChange::Delete,
        RangeVerb::Restore => RangeChange::Restore,
        RangeVerb::Lock => RangeChange::Lock,
        RangeVerb::Unlock => RangeChange::Unlock,
        RangeVerb::Hide => RangeChange::Hide,
        RangeVerb::Show => RangeChange::Show,
        RangeVerb::Merge => RangeChange::Merge { into: into()? },
        RangeVerb::Split => RangeChange::Split {
            frame: frame()?,
            at_px: args.at.context("--at is missing")?,
            into: into()?,
        },
        RangeVerb::Interpolate => RangeChange::Interpolate,
        RangeVerb::Copy => RangeChange::Copy { frame: frame()? },
    })
}
