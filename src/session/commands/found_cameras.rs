//! Results of structure from motion and registration as edits and records of the project.

use super::match_again::BestMatched;
use ostra_core::statistics::upper_median;
use ostra_frames::cameras::SparsePoints;
use ostra_frames::{Frame, FrameCamera};
use ostra_project::ResultEngine;
use ostra_project::{Edit, Project, ResultKind, ResultRecord};
use ostra_reconstruct::rgbd::{Calibration, FrameLink, RgbdResult};
use ostra_reconstruct::sfm::{MetricScale, ModelStart, RegistrationStatus, SfmModel, SfmResult};
use std::collections::BTreeMap;
use std::time::Duration;

/// How poses that frames already have are treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Poses {
    /// All poses are estimated again.
    FromScratch,
    /// They are kept, and the other frames are registered to them.
    Kept,
}

/// Maximum number of individual warnings about frames that were left out.
pub(super) const REPORTED: usize = 20;

/// Returns the first lines about frames left out, and one about how many more there are.
pub fn left_out(mut lines: Vec<String>, lacking: &str) -> Vec<String> {
    let more = lines.len().saturating_sub(REPORTED);
    lines.truncate(REPORTED);
    if more > 0 {
        lines.push(format!("{more} more frames have no {lacking}"));
    }
    lines
}

/// Cameras from any method.
pub struct Cameras {
    pub(super) engine: ResultEngine,
    /// Text that describes the method and its result.
    pub(super) settings: String,
    /// Cameras by frame number.
    pub(super) cameras: BTreeMap<usize, FrameCamera>,
    pub(super) sparse: SparsePoints,
    pub(super) outcomes: BTreeMap<usize, RegistrationStatus>,
    /// Models that nothing connects with this one.
    pub(super) others: Vec<OtherModel>,
    /// Links between frames, if depth was used.
    pub(super) links: Vec<FrameLink>,
    /// Calibrations of images that were found to be misaligned with their depths.
    pub(super) calibrations: Vec<Calibration>,
    /// Whether the cameras are in the coordinates of poses that were kept.
    pub(super) has_given_poses: bool,
    /// Whether lengths are metres, for cameras that are not anchored.
    pub(super) is_metric: bool,
    /// Warnings for the user.
    pub(super) warnings: Vec<String>,
    pub(super) stopped: bool,
}

/// A model that nothing connects with the one in use.
pub(super) struct OtherModel {
    /// Text that describes the method and its result.
    pub(super) settings: String,
    pub(super) model: SfmModel,
}

impl From<SfmResult> for Cameras {
    fn from(result: SfmResult) -> Self {
        let (engine, settings) = (ResultEngine::Sfm, settings(&result));
        let of_others: Vec<String> = (0..result.others.len())
            .map(|index| other_settings(&result, index))
            .collect();
        let (has_given_poses, is_metric) =
            (result.start == ModelStart::Given, result.scale.is_some());
        let SfmResult {
            cameras,
            sparse,
            outcomes,
            others,
            mut warnings,
            stopped,
            ..
        } = result;
        for (model, number) in others.iter().zip(2..) {
            let own = model.warnings.iter();
            warnings.extend(own.map(|text| format!("model {number}: {text}")));
        }
        let others = of_others
            .into_iter()
            .zip(others)
            .map(|(settings, model)| OtherModel { settings, model })
            .collect();
        let (links, calibrations) = Default::default();
        Self {
            engine,
            settings,
            cameras,
            sparse,
            outcomes,
            others,
            links,
            calibrations,
            has_given_poses,
            is_metric,
            warnings,
            stopped,
        }
    }
}

impl From<BestMatched> for Cameras {
    fn from(best: BestMatched) -> Self {
        let mut cameras = Self::from(best.result);
        if let Some(report) = best.report {
            cameras.settings += &format!("; {report}");
            for other in &mut cameras.others {
                other.settings += &format!("; {report}");
            }
        }
        cameras.warnings.extend(best.advice);
        cameras
    }
}

impl Cameras {
    /// Returns the cameras of frames that were registered by depth.
    pub(super) fn from_depth(result: RgbdResult, calibrations: Vec<Calibration>) -> Self {
        let RgbdResult {
            cameras,
            outcomes,
            links,
            stopped,
        } = result;
        let held = links.iter().filter(|link| link.holds).count();
        let vote_mismatch = links.len() - held;
        let begun = if stopped { "stopped with " } else { "" };
        let mut settings = format!(
            "{begun}{} of {} frames by depth, {held} links",
            cameras.len(),
            outcomes.len()
        );
        if vote_mismatch > 0 {
            settings += &format!(", {vote_mismatch} contradicted by the others");
        }
        calibrations
            .iter()
            .for_each(|calibration| settings += &format!("; {calibration}"));
        Self {
            engine: ResultEngine::Rgbd,
            settings,
            cameras,
            sparse: SparsePoints::default(),
            outcomes,
            others: Vec::new(),
            links,
            calibrations,
            has_given_poses: false,
            is_metric: true,
            warnings: Vec::new(),
            stopped,
        }
    }
}

pub fn edits(project: &Project, result: &Cameras, poses: Poses, record: ResultRecord) -> Vec<Edit> {
    let calibrated = calibrated(&project.frames, &result.calibrations);
    let frames = calibrated.iter().enumerate();
    let mut edits: Vec<Edit> = frames
        .clone()
        .map(|(frame, known)| Edit::SetCamera {
            frame,
            camera: camera(known, result.cameras.get(&frame), poses),
        })
        .collect();
    let numbers = result
        .calibrations
        .iter()
        .flat_map(|calibration| &calibration.frames);
    edits.extend(numbers.map(|&frame| Edit::SetDepth {
        frame,
        depth: calibrated[frame].depth.clone(),
    }));
    if matches!(poses, Poses::FromScratch) {
        edits.push(Edit::SetOrigin {
            origin: glam::DVec3::ZERO,
        });
    }
    edits.push(Edit::SetResult {
        kind: ResultKind::Cameras,
        record: Some(record),
    });
    let measured = frames
        .clone()
        .filter(|(_, frame)| frame.has_sensor_depth())
        .count();
    let made = frames.filter(|(_, frame)| frame.depth.is_some()).count() > measured;
    if measured > 0 && !made {
        edits.push(given(ResultKind::Depths, measured, ""));
    }
    edits
}

pub fn calibrated(frames: &[Frame], calibrations: &[Calibration]) -> Vec<Frame> {
    let mut frames = frames.to_vec();
    calibrations
        .iter()
        .for_each(|calibration| calibration.apply(&mut frames));
    frames
}

/// Returns the camera of a frame after the reconstruction.
///
/// If none was found and all poses are estimated again, only given intrinsics remain.
pub(super) fn camera(
    known: &Frame,
    found: Option<&FrameCamera>,
    poses: Poses,
) -> Option<FrameCamera> {
    match (found, poses) {
        (Some(found), _) => Some(*found),
        (None, Poses::Kept) => known.camera,
        (None, Poses::FromScratch) => {
            known
                .camera
                .filter(|camera| !camera.estimated)
                .map(|camera| FrameCamera {
                    camera_from_world: None,
                    ..camera
                })
        }
    }
}

pub fn record(result: &Cameras, took: Duration) -> ResultRecord {
    ResultRecord {
        engine: result.engine.clone(),
        frames: result.cameras.len(),
        seconds: took.as_secs_f64(),
        stale: false,
        settings: result.settings.clone(),
        ..ResultRecord::default()
    }
}

/// Describes the method and the model in use.
pub(super) fn settings(result: &SfmResult) -> String {
    model_settings(result, 0, &result.cameras, &result.sparse, result.scale)
}

/// Describes the method and another one of the models.
fn other_settings(result: &SfmResult, index: usize) -> String {
    let SfmModel {
        cameras,
        sparse,
        scale,
        ..
    } = &result.others[index];
    model_settings(result, index + 1, cameras, sparse, *scale)
}

fn model_settings(
    result: &SfmResult,
    index: usize,
    cameras: &BTreeMap<usize, FrameCamera>,
    sparse: &SparsePoints,
    scale: Option<MetricScale>,
) -> String {
    let [features, matcher] = result.methods;
    let of = result.outcomes.len();
    let mut text = format!(
        "{}{} of {of} frames by {features} + {matcher}, {} points",
        if result.stopped { "stopped with " } else { "" },
        cameras.len(),
        sparse.points.len()
    );
    let mut errors: Vec<f64> = sparse
        .points
        .iter()
        .filter_map(|point| point.error_px)
        .collect();
    if let Some(median) = upper_median(&mut errors) {
        text += &format!(", median error {median:.2} px");
    }
    if !result.others.is_empty() {
        let others = result.others.iter().map(|model| model.cameras.len());
        let sizes: Vec<String> = [result.cameras.len()]
            .into_iter()
            .chain(others)
            .enumerate()
            .filter(|&(other, _)| other != index)
            .map(|(_, frames)| frames.to_string())
            .collect();
        text += &format!(
            ", model {} of {} (others: {} frames)",
            index + 1,
            sizes.len() + 1,
            sizes.join(" and ")
        );
    }
    match scale {
        Some(scale) => {
            text + &format!(
                ", scale from {} depths ± {:.1} %",
                scale.samples,
                100.0 * scale.spread
            )
        }
        None => text,
    }
}

/// Returns one line per frame without a camera, up to a maximum number.
pub fn unplaced(frames: &[Frame], result: &Cameras) -> Vec<String> {
    let out = result
        .outcomes
        .iter()
        .filter(|(_, outcome)| !outcome.is_placed());
    let name = |frame: usize| frames[frame].name.as_str();
    left_out(
        out.map(|(&frame, why)| format!("{} has no camera: {}", name(frame), why.text(name)))
            .collect(),
        "camera",
    )
}

/// Returns whether a frame's pose is known.
pub(super) fn is_posed(frame: &Frame) -> bool {
    frame.posed_camera().is_some()
}

/// Returns the edit that records a result that came with the frames.
pub(super) fn given(kind: ResultKind, frames: usize, settings: &str) -> Edit {
    let settings = settings.to_owned();
    let record = ResultRecord {
        engine: ResultEngine::Given,
        frames,
        seconds: 0.0,
        stale: false,
        settings,
        version: 0,
        ..ResultRecord::default()
    };
    Edit::SetResult {
        kind,
        record: Some(record),
    }
}
