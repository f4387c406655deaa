use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, ValueEnum};
use glam::DVec2;

use super::drive::{Driver, label_id};
use super::values;
use ostra_cloud::measure::LengthUnit;
use ostra_masks::Direction;
use ostra_project::{ReconstructMethod, ReconstructRequest, ScaleEnd, ScaleRequest};
use ostra_session::{Command, TrackSettings};

#[derive(Debug, Args)]
pub(super) struct RelocateArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// Folder or video that is gone, as 'ostra info' names it.
    pub from: PathBuf,
    /// Where it is now; images must have the sizes that the frames had.
    pub to: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct LabelArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// The label's name.
    pub name: String,
    /// Name of the label above it.
    #[arg(long, value_name = "NAME")]
    pub parent: Option<String>,
    /// Its colour.
    #[arg(long, value_name = "#rrggbb", value_parser = values::color)]
    pub color: Option<[u8; 3]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Way {
    Both,
    Forward,
    Backward,
}

#[derive(Debug, Args)]
pub(super) struct TrackArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// auto, xmem, deaot, geometry or flow.
    #[arg(long, default_value = "auto", value_name = "NAME")]
    pub tracker: String,
    /// First frame.
    #[arg(long, value_name = "K")]
    pub from: Option<usize>,
    /// Last frame (included).
    #[arg(long, value_name = "K")]
    pub to: Option<usize>,
    /// Which way masks go from an anchor.
    #[arg(long, default_value = "both")]
    pub direction: Way,
    /// Frames between the anchors next to anchor K, both excluded.
    #[arg(long, value_name = "K", conflicts_with_all = ["from", "to"])]
    pub around: Option<usize>,
    /// Only these labels; every pixel of another label stays as it is.
    #[arg(long, value_name = "NAME")]
    pub label: Vec<String>,
    /// Write these labels over others too.
    #[arg(long, requires = "label")]
    pub replace: bool,
    /// Hold the masks against the anchors' masks carried through geometry.
    #[arg(long)]
    pub constrain: bool,
    /// End at the first frame on which a label is less sure than this.
    #[arg(long, value_name = "C", value_parser = values::share)]
    pub pause_below: Option<f32>,
    /// Shorter side of the pictures that xmem and deaot see; more shows thinner things and takes longer (deaot never
    /// enlarges).
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(64..=4096))]
    pub short_side: Option<u32>,
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
    /// The project's folder.
    pub project: PathBuf,
    /// sfm: only cameras.
    #[arg(long, default_value = "auto")]
    pub method: Method,
    /// Reconstruct from every n-th frame.
    #[arg(long, default_value = "1", value_name = "N", value_parser = values::from_one)]
    pub every: usize,
    /// Where kernels run.
    #[arg(long, default_value = "auto", value_parser = ["auto", "cpu", "gpu"])]
    pub device: String,
    /// Longer sides are worked on at this size.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(64..=8192))]
    pub max_side: Option<u32>,
    /// Only where masks have a label.
    #[arg(long)]
    pub only_labelled: bool,
    /// Feature detector.
    #[arg(long, default_value = "auto", value_parser = ["auto", "sift", "xfeat", "superpoint"])]
    pub features: String,
    /// Feature matcher.
    #[arg(long, default_value = "auto", value_parser = ["auto", "nearest", "lighterglue", "superglue"])]
    pub matcher: String,
    /// Match these two frames besides those that are chosen.
    #[arg(long, value_name = "K,K", value_parser = values::frame_pair)]
    pub pair: Vec<[usize; 2]>,
    /// How pieces of an RGB-D recording that nothing else ties together are joined.
    #[arg(long, default_value = "auto", value_parser = ["auto", "fgr", "ransac"])]
    pub registration: String,
}

#[derive(Debug, Args)]
pub(super) struct ScaleArgs {
    /// The project's folder.
    pub project: PathBuf,
    /// The known length. Everything that the project has made is scaled with it, in one step that can be undone.
    #[arg(long, value_name = "L", value_parser = values::positive)]
    pub length: f64,
    /// What the length is given in: m, cm or mm.
    #[arg(long, default_value = "m", value_parser = values::metric_unit)]
    pub unit: LengthUnit,
    /// Where a frame sees the one end: frame, x, y; for two frames or more.
    #[arg(long, value_name = "K,X,Y", value_parser = values::sighting, required = true)]
    pub from: Vec<(usize, DVec2)>,
    /// Where a frame sees the other end.
    #[arg(long, value_name = "K,X,Y", value_parser = values::sighting, required = true)]
    pub to: Vec<(usize, DVec2)>,
}

/// Points frames to where their files were moved.
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

pub(super) fn track(args: TrackArgs) -> Result<()> {
    let direction = match args.direction {
        Way::Both => Direction::Both,
        Way::Forward => Direction::Forward,
        Way::Backward => Direction::Backward,
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
    };
    Driver::open(&args.project)?.act_and_save([Command::Reconstruct(request)])
}

pub(super) fn scale(args: ScaleArgs) -> Result<()> {
    let ends = [ScaleEnd::Seen(args.from), ScaleEnd::Seen(args.to)];
    Driver::open(&args.project)?.act_and_save([Command::Scale(ScaleRequest {
        ends,
        length: args.unit.metres(args.length),
    })])
}
