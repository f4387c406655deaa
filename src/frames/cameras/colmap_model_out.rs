use super::attach::{stored_camera, turn_of};
use super::{SparseKeypoint, SparsePoint, SparsePoints};
use crate::Frame;
use ostra_geometry::{Camera, GeometryError, Pose, Turn};

/// What is written of a frame: its camera as COLMAP knows it, for the picture as stored.
pub struct ImageOut<'a> {
    pub name: &'a str,
    /// Index of its intrinsics; written numbers count from 1.
    pub camera: usize,
    pub camera_from_world: Pose,
    /// For the picture as stored.
    pub keypoints: Vec<SparseKeypoint>,
}

/// A model as both encodings write it. Images and points are numbered from 1 in their order.
pub struct ModelOut<'a> {
    pub cameras: Vec<Camera>,
    pub images: Vec<ImageOut<'a>>,
    pub points: &'a [SparsePoint],
    /// Per point, the index of the image and that of its keypoint.
    pub tracks: Vec<Vec<(usize, u32)>>,
}

impl<'a> ModelOut<'a> {
    /// All frames that have intrinsics and a pose; equal cameras once.
    ///
    /// # Errors
    /// The name of a frame whose picture is mirrored, and why that is none.
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

fn stored_keypoint(frame: &Frame, back: Turn, keypoint: SparseKeypoint) -> SparseKeypoint {
    SparseKeypoint {
        at_px: back.turn_px(keypoint.at_px, frame.width, frame.height),
        ..keypoint
    }
}
