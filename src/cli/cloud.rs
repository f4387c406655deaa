//! Commands on the labelled cloud: fusion, conflicts, attached fragments, instances.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use serde_json::json;

use super::drive::{Driver, label_id};
use super::print::{print_json, print_text};
use super::results::act_and_print;
use super::values;
use ostra_cloud::conflicts::FrameConflict;
use ostra_cloud::instances::InstanceOptions;
use ostra_masks::LabelId;
use ostra_project::{FuseRequest, ResultKind};
use ostra_session::{AttachRequest, Command, InstancesRequest};

#[derive(Debug, Args)]
pub(super) struct FuseArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Voxel size in world units [default: from the data]
    #[arg(long, value_name = "SIZE", value_parser = values::positive)]
    pub voxel: Option<f64>,
    /// Remove labels that won a smaller share of the votes; their points stay unless unlabelled ones are dropped.
    #[arg(long, value_name = "C", value_parser = values::share)]
    pub min_confidence: Option<f32>,
    /// Drop unlabelled points.
    #[arg(long)]
    pub drop_unlabelled: bool,
    /// Label the points of this cloud instead of fusing depth maps.
    #[arg(long, value_name = "CLOUD.ply")]
    pub onto: Option<PathBuf>,
    /// Print one JSON object: the time of each step and the peak memory in bytes.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(super) struct ConflictsArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Replace the mask of this frame by the vote and make it a keyframe (repeatable).
    #[arg(long, value_name = "K")]
    pub accept: Vec<usize>,
    /// Accept the vote for this label only (repeatable).
    #[arg(long, value_name = "NAME", requires = "accept")]
    pub label: Vec<String>,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(super) struct AttachArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Largest gap between connected points, in multiples of the spacing of the labelled points.
    #[arg(long, value_name = "R", default_value_t = AttachRequest::default().radius)]
    pub radius: f64,
}

#[derive(Debug, Args)]
pub(super) struct InstancesArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Label of the class; instances become its children.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// Largest gap between connected points, in multiples of the spacing of the cloud.
    #[arg(long, value_name = "R", default_value_t = InstanceOptions::default().radius)]
    pub radius: f64,
    /// Ignore groups of fewer points.
    #[arg(long, value_name = "N", default_value_t = InstanceOptions::default().min_points)]
    pub min_points: usize,
}

/// Lists the frames whose masks disagree with the vote, or replaces the masks of some by it.
pub(super) fn conflicts(args: &ConflictsArgs) -> Result<()> {
    let is_change = !args.accept.is_empty();
    let mut driver = if is_change {
        Driver::open(&args.project)?
    } else {
        Driver::view(&args.project)?
    };
    if is_change {
        let labels: Vec<LabelId> = args
            .label
            .iter()
            .map(|name| label_id(driver.project()?, name))
            .collect::<Result<_>>()?;
        let accept = |&frame: &usize| Command::AcceptVote {
            frame,
            labels: labels.clone(),
        };
        return driver.act_and_save(args.accept.iter().map(accept));
    }
    let conflicts = driver.conflicts()?;
    ensure!(
        !conflicts.is_empty(),
        "the votes of this cloud are not known; run 'ostra fuse' with masks and cameras"
    );
    let mut ranked: Vec<_> = conflicts.iter().collect();
    ranked.sort_by(|a, b| b.1.share().total_cmp(&a.1.share()).then(a.0.cmp(b.0)));
    let frames = &driver.project()?.frames;
    if args.json {
        let row = |(&frame, conflict): (&usize, &FrameConflict)| {
            json!({ "frame": frame, "name": frames[frame].name, "share": conflict.share(), "against": conflict.against,
                "compared": conflict.compared })
        };
        print_json(&json!({ "frames": ranked.into_iter().map(row).collect::<Vec<_>>() }));
        return Ok(());
    }
    print_text("in conflict  compared px  frame\n");
    for (&frame, conflict) in ranked {
        let share = 100.0 * conflict.share();
        print_text(&format!(
            "{share:>9.2} % {:>12}  {frame} {}\n",
            conflict.compared, frames[frame].name
        ));
    }
    Ok(())
}

/// Splits a class into instances and prints the number of points of each.
pub(super) fn instances(args: &InstancesArgs) -> Result<()> {
    let mut driver = Driver::open(&args.project)?;
    let label = label_id(driver.project()?, &args.label)?;
    let before: Vec<LabelId> = driver.project()?.labels.descendants(label);
    let options = InstanceOptions {
        radius: args.radius,
        min_points: args.min_points,
        ..InstanceOptions::default()
    };
    driver.act(Command::Instances(InstancesRequest { label, options }))?;
    let (cloud, tree) = (driver.cloud()?, driver.project()?.labels.clone());
    for made in tree
        .descendants(label)
        .into_iter()
        .filter(|id| !before.contains(id))
    {
        let points = cloud.labels.iter().filter(|&&id| id == made).count();
        let name = tree.get(made).map_or("", |label| &label.name);
        print_text(&format!("{name:<24} {points:>9} points\n"));
    }
    driver.act_and_save([])
}

pub(super) fn fuse(args: FuseArgs) -> Result<()> {
    let request = FuseRequest {
        voxel: args.voxel,
        min_confidence: args.min_confidence,
        drop_unlabelled: args.drop_unlabelled,
        onto: args.onto,
    };
    act_and_print(
        Driver::open(&args.project)?,
        Command::Fuse(request),
        &[ResultKind::Cloud],
        args.json,
    )
}

/// Gives unlabelled fragments to the objects they are attached to. The session reports how many.
pub(super) fn attach(args: &AttachArgs) -> Result<()> {
    Driver::open(&args.project)?.act_and_save([Command::Attach(AttachRequest {
        radius: args.radius,
    })])
}
