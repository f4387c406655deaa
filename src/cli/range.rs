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
pub(super) enum RangeAction {
    /// Remove the labels; trackers do not add them again.
    Delete,
    /// Let trackers add the labels again.
    Restore,
    /// Protect the pixels of the labels from changes.
    Lock,
    /// Allow changes again.
    Unlock,
    /// Keep the labels but leave them out of votes and exports.
    Hide,
    /// Show hidden labels again.
    Show,
    /// Turn the labels into the label --into.
    Merge,
    /// Turn the connected part at --at on --frame into the label --into.
    Split,
    /// Interpolate shapes between the first and the last frame.
    Interpolate,
    /// Copy the masks of --frame to every frame of the range.
    Copy,
}

#[derive(Debug, Args)]
pub(super) struct RangeArgs {
    /// Project folder.
    pub project: PathBuf,
    /// What to do with the labels.
    #[arg(value_name = "ACTION")]
    pub action: RangeAction,
    /// Labels to change (repeatable) [default: all]
    #[arg(long, value_name = "NAME", required_if_eq("action", "split"))]
    pub label: Vec<String>,
    /// First frame.
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub from: usize,
    /// Last frame, included [default: last of the project]
    #[arg(long, value_name = "K")]
    pub to: Option<usize>,
    /// Label that receives the pixels (merge, split).
    #[arg(long, value_name = "NAME", required_if_eq_any([("action", "merge"), ("action", "split")]))]
    pub into: Option<String>,
    /// Frame of --at (split) or frame to copy (copy).
    #[arg(long, value_name = "K", required_if_eq_any([("action", "split"), ("action", "copy")]))]
    pub frame: Option<usize>,
    /// Pixel of the connected part (split).
    #[arg(long, value_name = "X,Y", value_parser = values::point, required_if_eq("action", "split"))]
    pub at: Option<DVec2>,
    /// Overwrite other labels (interpolate, copy).
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
    Ok(match args.action {
        RangeAction::Delete => RangeChange::Delete,
        RangeAction::Restore => RangeChange::Restore,
        RangeAction::Lock => RangeChange::Lock,
        RangeAction::Unlock => RangeChange::Unlock,
        RangeAction::Hide => RangeChange::Hide,
        RangeAction::Show => RangeChange::Show,
        RangeAction::Merge => RangeChange::Merge { into: into()? },
        RangeAction::Split => RangeChange::Split {
            frame: frame()?,
            at_px: args.at.context("--at is missing")?,
            into: into()?,
        },
        RangeAction::Interpolate => RangeChange::Interpolate,
        RangeAction::Copy => RangeChange::Copy { frame: frame()? },
    })
}
