//! Scores of results against ground truth.

use ostra_project::{SegmenterId, TrackerId};
use std::path::PathBuf;

use anyhow::{Result, bail, ensure};
use clap::{Args, ValueEnum};
use serde::Serialize;

use super::drive::ProgressLines;
use super::print::{print_json, print_text, warn};
use super::values;
use ostra_eval::evaluate::{
    CameraScore, CloudEvaluation, InteractOptions, InteractReport, InteractRequest, MaskScore,
    ScoreOptions, TruthViews, cloud_table, evaluate_cloud, evaluate_interaction, evaluate_masks,
    score_cameras,
};
use ostra_geometry::Alignment;

#[derive(Debug, clap::Subcommand)]
pub(super) enum EvalCommand {
    /// Score masks: region similarity J and contour accuracy F.
    Masks(EvalArgs),
    /// Score the labels and the surface of a cloud.
    Cloud(EvalArgs),
    /// Score camera positions and rotations.
    Cameras(EvalArgs),
    /// Count the clicks that a simulated user needs for a sequence.
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
    /// Ground truth.
    #[arg(long, value_name = "PATH")]
    pub truth: PathBuf,
    /// Result to score.
    #[arg(long, value_name = "PATH")]
    pub result: PathBuf,
    /// Distances in units of the cloud; labels are compared within the first one.
    #[arg(long, value_name = "D[,D…]", value_delimiter = ',', value_parser = values::positive)]
    pub within: Vec<f64>,
    /// Replace deeper labels by their ancestor at this level (1 = top).
    #[arg(long, value_name = "N", value_parser = values::from_one)]
    pub level: Option<usize>,
    /// Alignment of the cameras before they are compared.
    #[arg(long, default_value = "none")]
    pub align: Align,
    /// Align orientations as well as centres; needed where the centres lie on a line.
    #[arg(long)]
    pub turns: bool,
    /// Cameras that observe the ground truth, for --min-views and the share in depth.
    #[arg(long, value_name = "DIR", requires = "min_views")]
    pub cameras: Option<PathBuf>,
    /// Compute completeness only over ground-truth points inside at least this many frusta.
    #[arg(long, value_name = "N", requires = "cameras")]
    pub min_views: Option<usize>,
    /// Folder of frames, video or project of these cameras; its image matches decide which points
    /// each camera sees, for the share in depth.
    #[arg(long, value_name = "PATH")]
    pub frames: Option<PathBuf>,
    /// Leave out the first frame.
    #[arg(long)]
    pub skip_first: bool,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(super) struct InteractArgs {
    /// Folder of frames, video, or project (to use its depth maps and cameras).
    #[arg(long, value_name = "PATH")]
    pub frames: PathBuf,
    /// Folder of ground-truth masks.
    #[arg(long, value_name = "MASKS")]
    pub truth: PathBuf,
    /// Tracker; geometry needs depth and cameras.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<TrackerId>())]
    pub tracker: TrackerId,
    /// Segmenter; sam-close works at full resolution around each prompt, geometry needs depth and
    /// cameras.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<SegmenterId>())]
    pub segmenter: SegmenterId,
    /// Standard deviation of the click position along each axis.
    #[arg(long, default_value = "0", value_name = "PX", value_parser = values::from_zero)]
    pub jitter: f64,
    /// Seed of the click positions.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

pub(super) fn eval(command: EvalCommand) -> Result<()> {
    match command {
        EvalCommand::Masks(args) => masks(&args),
        EvalCommand::Cloud(args) => cloud(args),
        EvalCommand::Cameras(args) => cameras(&args),
        EvalCommand::Interact(args) => interact(args),
    }
}

fn masks(args: &EvalArgs) -> Result<()> {
    refuse(
        args,
        &[
            ("within", !args.within.is_empty()),
            ("align", args.align != Align::None),
            ("turns", args.turns),
            ("cameras", args.cameras.is_some()),
            ("frames", args.frames.is_some()),
        ],
    )?;
    let options = ScoreOptions {
        skip_first: args.skip_first,
        level: args.level,
    };
    let score = evaluate_masks(&args.truth, &args.result, &options)?;
    warn_all(&score.warnings);
    print(args.json, &score, &mask_table(&score))
}

fn cloud(args: EvalArgs) -> Result<()> {
    refuse(
        &args,
        &[
            ("align", args.align != Align::None),
            ("turns", args.turns),
            ("skip-first", args.skip_first),
        ],
    )?;
    ensure!(
        args.frames.is_none() || args.cameras.is_some() && !args.within.is_empty(),
        "--frames needs --cameras, --min-views and --within as well"
    );
    let cameras = args.cameras.zip(args.min_views);
    let views = cameras.map(|(cameras, min_views)| TruthViews {
        cameras,
        min_views,
        frames: args.frames,
    });
    let evaluation = CloudEvaluation {
        within: args.within,
        level: args.level,
        views,
    };
    let (score, warnings) = evaluate_cloud(&args.truth, &args.result, &evaluation)?;
    warn_all(&warnings);
    print(args.json, &score, &cloud_table(&score))
}

fn cameras(args: &EvalArgs) -> Result<()> {
    refuse(
        args,
        &[
            ("within", !args.within.is_empty()),
            ("level", args.level.is_some()),
            ("cameras", args.cameras.is_some()),
            ("frames", args.frames.is_some()),
            ("skip-first", args.skip_first),
        ],
    )?;
    ensure!(
        !args.turns || args.align != Align::None,
        "--turns needs --align se3 or --align sim3"
    );
    let alignment = match args.align {
        Align::None => Alignment::None,
        Align::Se3 => Alignment::Se3,
        Align::Sim3 => Alignment::Sim3,
    };
    let score = score_cameras(&args.truth, &args.result, alignment, args.turns)?;
    print(args.json, &score, &camera_table(&score))
}

fn interact(args: InteractArgs) -> Result<()> {
    let InteractArgs {
        frames,
        truth,
        tracker,
        segmenter,
        jitter,
        seed,
        json,
    } = args;
    let options = InteractOptions {
        jitter_px: jitter,
        seed,
        ..InteractOptions::default()
    };
    let mut lines = ProgressLines::default();
    let request = InteractRequest {
        frames,
        truth,
        tracker,
        segmenter,
        options,
    };
    let outcome = evaluate_interaction(&request, &mut |jobs| lines.update(jobs));
    lines.end();
    let (report, warnings) = outcome?;
    warn_all(&warnings);
    print(json, &report, &interact_table(&report))
}

/// Rejects options that have no effect on this score.
fn refuse(args: &EvalArgs, given: &[(&str, bool)]) -> Result<()> {
    match given.iter().find(|(_, given)| *given) {
        Some((option, _)) => {
            bail!(
                "--{option} has no effect on this score of {}; leave it out",
                args.result.display()
            )
        }
        None => Ok(()),
    }
}

fn warn_all(warnings: &[String]) {
    warnings.iter().for_each(|text| warn(text));
}

fn print(json: bool, score: &impl Serialize, table: &str) -> Result<()> {
    if json {
        print_json(&serde_json::to_string(score)?);
    } else {
        print_text(table);
    }
    Ok(())
}

fn mask_table(score: &MaskScore) -> String {
    let mut text = format!("{:<24} {:>7} {:>7} {:>7}\n", "label", "J", "F", "J&F");
    for label in &score.labels {
        let name = label.name.clone().unwrap_or_else(|| label.id.0.to_string());
        text += &format!(
            "{name:<24} {:>7.4} {:>7.4} {:>7.4}\n",
            label.j,
            label.f,
            (label.j + label.f) / 2.0
        );
    }
    text + &format!(
        "{:<24} {:>7.4} {:>7.4} {:>7.4}\n{} frames\n",
        "mean", score.j, score.f, score.jf, score.frames
    )
}

fn camera_table(score: &CameraScore) -> String {
    let error = &score.error;
    let mut text = format!("{} of {} cameras compared\n", error.count, score.truth);
    if !score.missing.is_empty() {
        text += &format!("missing: {}\n", score.missing.join(", "));
    }
    text += &format!(
        "{:<12} {:>12} {:>12} {:>12} {:>12}\n",
        "", "rmse", "mean", "median", "max"
    );
    let rows = [
        ("centre", &error.centre),
        ("rotation °", &error.rotation_deg),
        ("alone °", &error.own_rotation_deg),
    ];
    for (name, row) in rows {
        text += &format!(
            "{name:<12} {:>12.6} {:>12.6} {:>12.6} {:>12.6}\n",
            row.rmse, row.mean, row.median, row.max
        );
    }
    text + &format!(
        "centre rmse is {:.4} % of the extent {:.4}\n",
        score.centre_percent, error.extent
    )
}

fn interact_table(report: &InteractReport) -> String {
    let InteractReport {
        segmenter,
        tracker,
        frames,
        labels,
        ..
    } = report;
    let mut text = format!(
        "segmenter {segmenter}, tracker {tracker}, {frames} frames with ground truth, {labels} labels\n"
    );
    for goal in &report.reached {
        let clicks = goal
            .clicks
            .map_or_else(|| "—".to_owned(), |clicks| clicks.to_string());
        text += &format!("clicks to mean IoU {:.2} {clicks:>8}\n", goal.mean_iou);
    }
    text += &format!(
        "final mean IoU {:.4} after {} clicks ({} of them polygon corners and border drags), {} frames corrected, {:.1} s\n",
        report.mean_iou, report.clicks, report.corners, report.corrected, report.seconds
    );
    let share = |share: Option<f64>| {
        share.map_or_else(|| "—".to_owned(), |share| format!("{:.0} %", 100.0 * share))
    };
    let baseline = &report.frame_by_frame;
    text += &format!(
        "every frame on its own: {} clicks, {} frames failed\n",
        baseline.clicks, baseline.failed
    );
    text += &format!("clicks saved to mean IoU 0.90: {}\n", share(report.saved()));
    let failed = &report.failed_by_frame;
    text += &format!(
        "the {} frames on which the first tracking failed, each on its own: {} clicks\n",
        failed.frames, failed.clicks
    );
    text + &format!(
        "clicks to mean IoU 0.90 are {} of these\n",
        share(report.share_of_reclicking())
    )
}
