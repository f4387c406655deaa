use ostra_project::{DeviceId, FeatureId, MatcherId, RegistrationId, TrackerId};
use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, ValueEnum};
use glam::DVec2;

use super::drive::{Driver, label_id};
use super::results::act_and_print;
use super::values;
use ostra_cloud::measure::LengthUnit;
use ostra_core::lists::in_words;
use ostra_masks::Direction;
use ostra_project::{ReconstructMethod, ReconstructRequest, ResultKind, ScaleEnd, ScaleRequest};
use ostra_session::{Command, TrackSettings};

#[derive(Debug, Args)]
pub(super) struct RelocateArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Folder or video that is missing, as shown by 'ostra info'.
    pub from: PathBuf,
    /// Its new path; image sizes must be unchanged.
    pub to: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct LabelArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Name of the label.
    pub name: String,
    /// Name of the parent label.
    #[arg(long, value_name = "NAME")]
    pub parent: Option<String>,
    /// Colour of the label.
    #[arg(long, value_name = "#rrggbb", value_parser = values::color)]
    pub color: Option<[u8; 3]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum TrackDirection {
    Both,
    Forward,
    Backward,
}

#[derive(Debug, Args)]
pub(super) struct TrackArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Tracker; geometry needs depth and cameras.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<TrackerId>())]
    pub tracker: TrackerId,
    /// First frame.
    #[arg(long, value_name = "K")]
    pub from: Option<usize>,
    /// Last frame (included).
    #[arg(long, value_name = "K")]
    pub to: Option<usize>,
    /// Direction of propagation from a keyframe.
    #[arg(long, default_value = "both")]
    pub direction: TrackDirection,
    /// Only the frames between the keyframes before and after keyframe K.
    #[arg(long, value_name = "K", conflicts_with_all = ["from", "to"])]
    pub around: Option<usize>,
    /// Only this label, leaving all pixels of other labels unchanged (repeatable).
    #[arg(long, value_name = "NAME")]
    pub label: Vec<String>,
    /// Let these labels overwrite others.
    #[arg(long, requires = "label")]
    pub replace: bool,
    /// Check the masks against keyframes re-projected through depth and cameras.
    #[arg(long)]
    pub constrain: bool,
    /// Stop at the first frame on which the confidence of a label is lower.
    #[arg(long, value_name = "C", value_parser = values::share)]
    pub pause_below: Option<f32>,
    #[arg(long, help = short_side_help(), value_name = "PX", value_parser = clap::value_parser!(u32).range(64..=4096))]
    pub short_side: Option<u32>,
}

/// Returns the help of `--short-side`, with the trackers that take it.
fn short_side_help() -> String {
    let trackers = in_words(TrackerId::names_with_image_size(), "and");
    format!(
        "Shorter image side for {trackers}; larger values keep thinner structures and take longer (deaot never enlarges)"
    )
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Method {
    Auto,
    Sfm,
    Mvs,
    Rgbd,
}

#[derive(Debug, Args)]
pub(super) struct ReconstructArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Method; sfm computes cameras only.
    #[arg(long, default_value = "auto")]
    pub method: Method,
    /// Use every Nth frame.
    #[arg(long, default_value = "1", value_name = "N", value_parser = values::from_one)]
    pub every: usize,
    /// Device for stereo.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<DeviceId>())]
    pub device: DeviceId,
    /// Longest image side for features and depth maps; larger images are reduced.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(64..=8192))]
    pub max_side: Option<u32>,
    /// Use only labelled pixels, for features and for depth maps.
    #[arg(long)]
    pub only_labelled: bool,
    /// Feature detector.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<FeatureId>())]
    pub features: FeatureId,
    /// Feature matcher.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<MatcherId>())]
    pub matcher: MatcherId,
    /// Also match these two frames (repeatable).
    #[arg(long, value_name = "K,K", value_parser = values::frame_pair)]
    pub pair: Vec<[usize; 2]>,
    /// Registration of unconnected fragments of an RGB-D recording.
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = values::engine::<RegistrationId>())]
    pub registration: RegistrationId,
    /// Maximum size of the project's cache of features and matches in GiB; 0 keeps none.
    #[arg(long, default_value = "2", value_name = "GIB", value_parser = clap::value_parser!(u32).range(0..=1024))]
    pub cache_limit: u32,
    /// Print one JSON object: the time of each step and the peak memory in bytes.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(super) struct SelectModelArgs {
    /// Project folder.
    pub project: PathBuf,
    /// Number of the model. Frames outside it have no camera then; depth maps and the cloud become
    /// stale.
    #[arg(value_name = "N")]
    pub model: usize,
}

#[derive(Debug, Args)]
pub(super) struct ScaleArgs {
    /// Project folder.
    pub project: PathBuf,
    /// The known length. Cameras, depth maps, cloud and mesh are scaled together, in one step that
    /// can be undone.
    #[arg(long, value_name = "L", value_parser = values::positive)]
    pub length: f64,
    /// Unit of the length: m, cm or mm.
    #[arg(long, default_value = "m", value_parser = values::metric_unit)]
    pub unit: LengthUnit,
    /// First end of the length as seen in a frame: frame, x, y (give at least two frames).
    #[arg(long, value_name = "K,X,Y", value_parser = values::frame_point, required = true)]
    pub from: Vec<(usize, DVec2)>,
    /// Second end of the length as seen in a frame (give at least two frames).
    #[arg(long, value_name = "K,X,Y", value_parser = values::frame_point, required = true)]
    pub to: Vec<(usize, DVec2)>,
}

/// Updates the paths of frames whose files have moved.
pub(super) fn relocate(args: RelocateArgs) -> Result<()> {
    Driver::open(&args.project)?.act_and_save([Command::Relocate {
        from: args.from,
        to: args.to,
    }])
}

pub(super) fn label(args: LabelArgs) -> Result<()> {
    let command = Command::AddLabel {
        name: args.name,
        parent: args.parent,
        color: args.color,
    };
    Driver::open(&args.project)?.act_and_save([command])
}

pub(super) fn track(args: &TrackArgs) -> Result<()> {
    let direction = match args.direction {
        TrackDirection::Both => Direction::Both,
        TrackDirection::Forward => Direction::Forward,
        TrackDirection::Backward => Direction::Backward,
    };
    let driver = Driver::open(&args.project)?;
    let project = driver.project()?;
    let settings = TrackSettings {
        tracker: args.tracker,
        from: args.from,
        to: args.to,
        direction,
        constrain: args.constrain,
        labels: args
            .label
            .iter()
            .map(|name| label_id(project, name))
            .collect::<Result<_>>()?,
        replace: args.replace,
        pause_below: args.pause_below,
        short_side: args.short_side,
    };
    let settings = match args.around {
        Some(frame) => settings.around(project, frame)?,
        None => settings,
    };
    driver.act_and_save([Command::Track(settings)])
}

pub(super) fn reconstruct(args: ReconstructArgs) -> Result<()> {
    let method = match args.method {
        Method::Auto => ReconstructMethod::Auto,
        Method::Sfm => ReconstructMethod::Sfm,
        Method::Mvs => ReconstructMethod::Mvs,
        Method::Rgbd => ReconstructMethod::Rgbd,
    };
    let request = ReconstructRequest {
        method,
        every: args.every,
        device: args.device,
        features: args.features,
        matcher: args.matcher,
        registration: args.registration,
        max_side: args.max_side,
        only_labelled: args.only_labelled,
        pairs: args.pair,
        cache_limit_gib: args.cache_limit,
    };
    act_and_print(
        Driver::open(&args.project)?,
        Command::Reconstruct(request),
        &[ResultKind::Cameras, ResultKind::Depths],
        args.json,
    )
}

pub(super) fn select_model(args: &SelectModelArgs) -> Result<()> {
    let command = Command::SelectModel { model: args.model };
    Driver::open(&args.project)?.act_and_save([command])
}

pub(super) fn scale(args: ScaleArgs) -> Result<()> {
    let ends = [ScaleEnd::Seen(args.from), ScaleEnd::Seen(args.to)];
    Driver::open(&args.project)?.act_and_save([Command::Scale(ScaleRequest {
        ends,
        length: args.unit.metres(args.length),
    })])
}
