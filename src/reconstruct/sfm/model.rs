use glam::DVec3;

use super::{KeypointId, MapProblem};
use ostra_geometry::{Camera, Pose};

/// A point of the model and the keypoints that see it.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelPoint {
    /// In world units.
    pub position: DVec3,
    /// Keypoints that see it, in the order in which they were found.
    pub track: Vec<KeypointId>,
}

const NO_POINT: u32 = u32::MAX;

/// Cameras, poses and points as far as they are known.
#[derive(Debug, Clone)]
pub struct SparseModel {
    /// Intrinsics, by camera number.
    pub cameras: Vec<Camera>,
    /// `camera_from_world`, by image number; `None` = not placed.
    pub poses: Vec<Option<Pose>>,
    points: Vec<Option<ModelPoint>>,
    point_of: Vec<Vec<u32>>,
}

impl SparseModel {
    /// Nothing placed.
    #[must_use]
    pub fn new(problem: &MapProblem) -> Self {
        Self {
            cameras: problem
                .cameras
                .iter()
                .map(|camera| camera.intrinsics)
                .collect(),
            poses: vec![None; problem.images.len()],
            points: Vec::new(),
            point_of: problem
                .images
                .iter()
                .map(|image| vec![NO_POINT; image.keypoints.len()])
                .collect(),
        }
    }

    /// Whether an image is placed.
    #[must_use]
    pub fn is_placed(&self, image: u32) -> bool {
        self.poses[image as usize].is_some()
    }

    /// The images that are placed.
    pub fn placed(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.poses.len() as u32).filter(|&image| self.is_placed(image))
    }

    /// The point that a keypoint sees.
    #[must_use]
    pub fn point_of(&self, keypoint: KeypointId) -> Option<u32> {
        Some(self.point_of[keypoint.image as usize][keypoint.index as usize])
            .filter(|&point| point != NO_POINT)
    }

    /// A point by number; `None` where it was taken out.
    #[must_use]
    pub fn point(&self, point: u32) -> Option<&ModelPoint> {
        self.points.get(point as usize)?.as_ref()
    }

    /// All points with their numbers, which never change.
    pub fn points(&self) -> impl Iterator<Item = (u32, &ModelPoint)> + '_ {
        self.points
            .iter()
            .enumerate()
            .filter_map(|(i, point)| Some((i as u32, point.as_ref()?)))
    }

    /// One above the highest number of a point.
    #[must_use]
    pub fn point_slots(&self) -> u32 {
        self.points.len() as u32
    }

    /// How many of an image's keypoints see a point.
    #[must_use]
    pub fn points_seen(&self, image: u32) -> usize {
        self.point_of[image as usize]
            .iter()
            .filter(|&&point| point != NO_POINT)
            .count()
    }

    /// Puts in a point; none of the keypoints sees another. Gives its number.
    pub fn add(&mut self, position: DVec3, track: Vec<KeypointId>) -> u32 {
        let number = self.points.len() as u32;
        for keypoint in &track {
            self.point_of[keypoint.image as usize][keypoint.index as usize] = number;
        }
        self.points.push(Some(ModelPoint { position, track }));
        number
    }

    /// Moves a point.
    pub fn move_to(&mut self, point: u32, position: DVec3) {
        if let Some(point) = self.points[point as usize].as_mut() {
            point.position = position;
        }
    }

    /// Adds a keypoint, which sees no other, to those that see a point.
    pub fn extend(&mut self, number: u32, keypoint: KeypointId) {
        if let Some(point) = self.points[number as usize].as_mut() {
            point.track.push(keypoint);
            self.point_of[keypoint.image as usize][keypoint.index as usize] = number;
        }
    }

    /// Takes a keypoint from those that see its point.
    pub fn detach(&mut self, keypoint: KeypointId) {
        let Some(number) = self.point_of(keypoint) else {
            return;
        };
        self.point_of[keypoint.image as usize][keypoint.index as usize] = NO_POINT;
        if let Some(point) = self.points[number as usize].as_mut() {
            point.track.retain(|&other| other != keypoint);
        }
    }

    /// Takes a point out; gives what it was.
    pub fn remove(&mut self, number: u32) -> Option<ModelPoint> {
        let point = self.points[number as usize].take()?;
        for keypoint in &point.track {
            self.point_of[keypoint.image as usize][keypoint.index as usize] = NO_POINT;
        }
        Some(point)
    }
}
