//! Writing of COLMAP models, as text and binary.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::colmap_model::{model_and_parameters, model_number};
use super::given::{stored_camera, turn_of};
use super::{SparseKeypoint, SparsePoint, SparsePoints};
use crate::{Frame, FrameError};
use ostra_core::disk;
use ostra_geometry::{Camera, GeometryError, Pose, QuarterRotation};

/// Encoding of a written COLMAP model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelEncoding {
    /// `cameras.txt`, `images.txt`, `points3D.txt`; reading the numbers gives the same bits.
    #[default]
    Text,
    /// `cameras.bin`, `images.bin`, `points3D.bin`.
    Binary,
}

/// Writes a COLMAP model into `folder`, which is created.
///
/// The model has all frames with intrinsics and a pose, equal cameras once, and the points with the
/// keypoints that see them. Cameras and keypoints are those of the images as stored (rotated back).
///
/// # Errors
///
/// [`FrameError::Io`] if a file cannot be written; [`FrameError::Geometry`] for a mirrored image.
pub fn write_colmap_model(
    folder: &Path,
    frames: &[Frame],
    sparse: &SparsePoints,
    encoding: ModelEncoding,
) -> Result<(), FrameError> {
    std::fs::create_dir_all(folder).map_err(|reason| FrameError::Io {
        path: folder.to_owned(),
        reason,
    })?;
    let model = ModelOut::new(frames, sparse).map_err(|(name, reason)| FrameError::Geometry {
        path: folder.join(name),
        reason,
    })?;
    let (ending, files) = match encoding {
        ModelEncoding::Text => (
            "txt",
            [
                camera_list(&model.cameras),
                image_list(&model.images),
                point_list(&model),
            ]
            .map(String::into_bytes),
        ),
        ModelEncoding::Binary => (
            "bin",
            [
                cameras_bytes(&model.cameras),
                images_bytes(&model.images),
                points_bytes(&model),
            ],
        ),
    };
    for (name, bytes) in ["cameras", "images", "points3D"].into_iter().zip(files) {
        let path = folder.join(format!("{name}.{ending}"));
        disk::write(&path, &bytes).map_err(|reason| FrameError::Io { path, reason })?;
    }
    Ok(())
}

/// Returns the frames under names that COLMAP's text format can hold; `None` if all names fit.
///
/// The format ends a name at its first space. White space and control characters become `_`, and a
/// name that is then taken gets a number.
#[must_use]
pub fn with_text_names(frames: &[Frame]) -> Option<Vec<Frame>> {
    let is_unsafe = |c: char| c.is_whitespace() || c.is_control();
    if !frames.iter().any(|frame| frame.name.contains(is_unsafe)) {
        return None;
    }
    let mut taken: BTreeSet<String> = frames
        .iter()
        .filter(|frame| !frame.name.contains(is_unsafe))
        .map(|frame| frame.name.clone())
        .collect();
    let rename = |frame: &Frame| {
        if !frame.name.contains(is_unsafe) {
            return frame.clone();
        }
        let plain = frame.name.replace(is_unsafe, "_");
        let (stem, ending) = plain.rsplit_once('.').unwrap_or((&plain, ""));
        let dot = if ending.is_empty() { "" } else { "." };
        let numbered = (2..).map(|number| format!("{stem}_{number}{dot}{ending}"));
        let name = std::iter::once(plain.clone())
            .chain(numbered)
            .find(|name| !taken.contains(name))
            .unwrap_or_default();
        taken.insert(name.clone());
        Frame {
            name,
            ..frame.clone()
        }
    };
    Some(frames.iter().map(rename).collect())
}

fn camera_list(cameras: &[Camera]) -> String {
    let mut text = String::from("# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    for (i, camera) in cameras.iter().enumerate() {
        let (model, parameters) = model_and_parameters(camera);
        let _ = write!(text, "{} {model} {} {}", i + 1, camera.width, camera.height);
        for parameter in parameters {
            let _ = write!(text, " {parameter}");
        }
        text.push('\n');
    }
    text
}

fn image_list(images: &[ImageOut<'_>]) -> String {
    let mut text = String::from(
        "# Image list: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then a line of POINTS2D[] as X, Y, POINT3D_ID\n",
    );
    for (i, image) in images.iter().enumerate() {
        let (q, t) = (
            image.camera_from_world.rotation,
            image.camera_from_world.translation,
        );
        let _ = write!(
            text,
            "{} {} {} {} {} {} {} {}",
            i + 1,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z
        );
        let _ = writeln!(text, " {} {}", image.camera + 1, image.name);
        let mut gap = "";
        for keypoint in &image.keypoints {
            let point = keypoint.point.map_or(-1, |point| i64::from(point) + 1);
            let _ = write!(
                text,
                "{gap}{} {} {point}",
                keypoint.at_px.x, keypoint.at_px.y
            );
            gap = " ";
        }
        text.push('\n');
    }
    text
}

fn point_list(model: &ModelOut<'_>) -> String {
    let mut text = String::from(
        "# 3D point list: POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as IMAGE_ID, POINT2D_IDX\n",
    );
    for (i, (point, track)) in model.points.iter().zip(&model.tracks).enumerate() {
        let SparsePoint {
            position: x,
            color: [r, g, b],
            error_px,
        } = point;
        let _ = write!(
            text,
            "{} {} {} {} {r} {g} {b} {}",
            i + 1,
            x.x,
            x.y,
            x.z,
            error_px.unwrap_or(-1.0)
        );
        for (image, keypoint) in track {
            let _ = write!(text, " {} {keypoint}", image + 1);
        }
        text.push('\n');
    }
    text
}

fn cameras_bytes(cameras: &[Camera]) -> Vec<u8> {
    let mut bytes = (cameras.len() as u64).to_le_bytes().to_vec();
    for (i, camera) in cameras.iter().enumerate() {
        let (model, parameters) = model_and_parameters(camera);
        bytes.extend((i as u32 + 1).to_le_bytes());
        bytes.extend(model_number(model).to_le_bytes());
        bytes.extend(u64::from(camera.width).to_le_bytes());
        bytes.extend(u64::from(camera.height).to_le_bytes());
        bytes.extend(
            parameters
                .iter()
                .flat_map(|parameter| parameter.to_le_bytes()),
        );
    }
    bytes
}

fn images_bytes(images: &[ImageOut<'_>]) -> Vec<u8> {
    let mut bytes = (images.len() as u64).to_le_bytes().to_vec();
    for (i, image) in images.iter().enumerate() {
        let (q, t) = (
            image.camera_from_world.rotation,
            image.camera_from_world.translation,
        );
        bytes.extend((i as u32 + 1).to_le_bytes());
        bytes.extend(
            [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
                .iter()
                .flat_map(|value| value.to_le_bytes()),
        );
        bytes.extend((image.camera as u32 + 1).to_le_bytes());
        bytes.extend(image.name.as_bytes());
        bytes.push(0);
        bytes.extend((image.keypoints.len() as u64).to_le_bytes());
        for keypoint in &image.keypoints {
            bytes.extend(
                [keypoint.at_px.x, keypoint.at_px.y]
                    .iter()
                    .flat_map(|value| value.to_le_bytes()),
            );
            bytes.extend(
                keypoint
                    .point
                    .map_or(u64::MAX, |point| u64::from(point) + 1)
                    .to_le_bytes(),
            );
        }
    }
    bytes
}

fn points_bytes(model: &ModelOut<'_>) -> Vec<u8> {
    let mut bytes = (model.points.len() as u64).to_le_bytes().to_vec();
    for (i, (point, track)) in model.points.iter().zip(&model.tracks).enumerate() {
        bytes.extend((i as u64 + 1).to_le_bytes());
        bytes.extend(
            point
                .position
                .to_array()
                .iter()
                .flat_map(|value| value.to_le_bytes()),
        );
        bytes.extend(point.color);
        bytes.extend(point.error_px.unwrap_or(-1.0).to_le_bytes());
        bytes.extend((track.len() as u64).to_le_bytes());
        for &(image, keypoint) in track {
            bytes.extend((image as u32 + 1).to_le_bytes());
            bytes.extend(keypoint.to_le_bytes());
        }
    }
    bytes
}

/// The written data of a frame: its camera as COLMAP knows it, for the image as stored.
pub struct ImageOut<'a> {
    pub name: &'a str,
    /// Index of its intrinsics; written numbers count from 1.
    pub camera: usize,
    pub camera_from_world: Pose,
    /// Keypoints of the image as stored.
    pub keypoints: Vec<SparseKeypoint>,
}

/// A model as both encodings write it.
///
/// Images and points are numbered from 1 in their order.
pub struct ModelOut<'a> {
    pub cameras: Vec<Camera>,
    pub images: Vec<ImageOut<'a>>,
    pub points: &'a [SparsePoint],
    /// Per point, the index of the image and that of its keypoint.
    pub tracks: Vec<Vec<(usize, u32)>>,
}

impl<'a> ModelOut<'a> {
    /// Collects all frames with intrinsics and a pose, and equal cameras once.
    ///
    /// # Errors
    ///
    /// The name of a frame whose image is mirrored, and why it cannot be written.
    pub fn new(
        frames: &'a [Frame],
        sparse: &'a SparsePoints,
    ) -> Result<Self, (&'a str, GeometryError)> {
        let mut cameras: Vec<Camera> = Vec::new();
        let mut images = Vec::new();
        let mut tracks = vec![Vec::new(); sparse.points.len()];
        for (number, frame) in frames.iter().enumerate() {
            let failed = |error| (frame.name.as_str(), error);
            let Some((camera, camera_from_world)) = stored_camera(frame).map_err(failed)? else {
                continue;
            };
            let known = cameras.iter().rposition(|&other| other == camera);
            let camera = known.unwrap_or_else(|| {
                cameras.push(camera);
                cameras.len() - 1
            });
            let back = turn_of(frame).map_err(failed)?.inverse();
            let keypoints = sparse.keypoints.get(&number).map_or(&[][..], Vec::as_slice);
            for (index, point) in keypoints
                .iter()
                .enumerate()
                .filter_map(|(index, k)| Some((index, k.point?)))
            {
                tracks[point as usize].push((images.len(), index as u32));
            }
            let keypoints = keypoints
                .iter()
                .map(|&keypoint| stored_keypoint(frame, back, keypoint))
                .collect();
            images.push(ImageOut {
                name: &frame.name,
                camera,
                camera_from_world,
                keypoints,
            });
        }
        Ok(Self {
            cameras,
            images,
            points: &sparse.points,
            tracks,
        })
    }
}

fn stored_keypoint(
    frame: &Frame,
    back: QuarterRotation,
    keypoint: SparseKeypoint,
) -> SparseKeypoint {
    SparseKeypoint {
        at_px: back.turn_px(keypoint.at_px, frame.width, frame.height),
        ..keypoint
    }
}
