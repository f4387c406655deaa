//! The verbs of the labelled cloud: its vote, masks that the vote contradicts, adoption and instances.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use serde_json::json;

use super::drive::{Driver, label_id};
use super::print::{say, say_json};
use super::values;
use ostra_cloud::doubt::FrameDoubt;
use ostra_cloud::instances::InstanceOptions;
use ostra_masks::LabelId;
use ostra_project::FuseRequest;
use ostra_session::{AdoptRequest, Command, InstancesRequest};

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

/// Lists the frames whose masks the vote contradicts, or accepts the vote on some.
pub(super) fn doubt(args: &DoubtArgs) -> Result<()> {
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
    let doubts = driver.doubts()?;
    ensure!(
        !doubts.is_empty(),
        "it is not known which pixels voted on this cloud; fuse again with masks and cameras"
    );
    let mut ranked: Vec<_> = doubts.iter().collect();
    ranked.sort_by(|a, b| b.1.share().total_cmp(&a.1.share()).then(a.0.cmp(b.0)));
    let frames = &driver.project()?.frames;
    if args.json {
        let row = |(&frame, doubt): (&usize, &FrameDoubt)| {
            json!({ "frame": frame, "name": frames[frame].name, "share": doubt.share(), "against": doubt.against,
                "compared": doubt.compared })
        };
        say_json(&json!({ "frames": ranked.into_iter().map(row).collect::<Vec<_>>() }));
        return Ok(());
    }
    say("contradicted   of pixels  frame\n");
    for (&frame, doubt) in ranked {
        let share = 100.0 * doubt.share();
        say(&format!(
            "{share:>10.2} % {:>11}  {frame} {}\n",
            doubt.compared, frames[frame].name
        ));
    }
    Ok(())
}

/// Tells the instances of a class apart and names each with its number of points.
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
        say(&format!("{name:<24} {points:>9} points\n"));
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
    Driver::open(&args.project)?.act_and_save([Command::Fuse(request)])
}

/// Gives pieces without a label to what they hang on; the session tells how many.
pub(super) fn adopt(args: &AdoptArgs) -> Result<()> {
    Driver::open(&args.project)?.act_and_save([Command::Adopt(AdoptRequest {
        radius: args.radius,
    })])
}
