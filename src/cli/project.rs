use anyhow::{Context, Result};

use super::args::{
    AdoptArgs, FuseArgs, LabelArgs, Method, ReconstructArgs, RelocateArgs, ScaleArgs, TrackArgs,
    Way,
};
use super::drive::Driver;
use ostra_masks::{Direction, LabelId};
use ostra_project::{
    FuseRequest, Project, ReconstructMethod, ReconstructRequest, ScaleEnd, ScaleRequest,
};
use ostra_session::{AdoptRequest, Command, TrackSettings};

/// Gives pieces without a label to what they hang on; the session tells how many.
pub(super) fn adopt(args: &AdoptArgs) -> Result<()> {
    Driver::open(&args.project)?.act_and_save([Command::Adopt(AdoptRequest {
        radius: args.radius,
    })])
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

/// The label of this name.
pub(super) fn label_id(project: &Project, name: &str) -> Result<LabelId> {
    let known = &project.labels;
    let label = known.by_name(name).with_context(|| {
        let names: Vec<&str> = known.iter().map(|label| label.name.as_str()).collect();
        format!(
            "there is no label '{name}' (there is: {}); make it with 'ostra label'",
            names.join(", ")
        )
    })?;
    Ok(label.id)
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

pub(super) fn fuse(args: FuseArgs) -> Result<()> {
    let request = FuseRequest {
        voxel: args.voxel,
        min_confidence: args.min_confidence,
        drop_unlabelled: args.drop_unlabelled,
        onto: args.onto,
    };
    Driver::open(&args.project)?.act_and_save([Command::Fuse(request)])
}
