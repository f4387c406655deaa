//! The mapping problem: images, cameras, correspondences, and the sparse models made from them.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use ostra_geometry::{Camera, Pose, TwoViewKind};

/// A keypoint, by image and index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeypointId {
    /// Number of the image.
    pub image: u32,
    /// Index among its keypoints.
    pub index: u32,
}

/// How reliable a camera's intrinsics are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IntrinsicsPrior {
    /// Known; they stay fixed.
    Given,
    /// The focal length is from the image file's EXIF data; everything is refined.
    Exif,
    /// Nothing is known; the focal length is searched for, and everything is refined.
    Guessed,
}

/// A physical camera, shared by all images that it took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapCamera {
    /// Its intrinsics, or the initial values of their refinement.
    pub intrinsics: Camera,
    /// How reliable they are.
    pub source: IntrinsicsPrior,
}

/// An image as the mapper sees it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapImage {
    /// Index of the camera that took it.
    pub camera: usize,
    /// Its keypoints in pixels.
    pub keypoints: Vec<DVec2>,
    /// `camera_from_world` if it is known and must stay fixed.
    pub given: Option<Pose>,
}

/// Two images whose matches agree with one geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct VerifiedPair {
    /// The two images, the lower number first.
    pub images: [u32; 2],
    /// Pairs of keypoint indices that agree; copies of a pair share them.
    pub matches: Arc<[[u32; 2]]>,
    /// The kind of geometry that explains them.
    pub kind: TwoViewKind,
    /// `second_from_first` with a translation of length 1, if it could be determined.
    pub second_from_first: Option<Pose>,
    /// Median angle between the two rays of a match in radians.
    pub parallax: f64,
}

/// Input of the mapper.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapProblem {
    /// The cameras that took the images.
    pub cameras: Vec<MapCamera>,
    /// The images.
    pub images: Vec<MapImage>,
    /// Pairs of images that show the same part of the scene.
    pub pairs: Vec<VerifiedPair>,
}

/// For every keypoint, the keypoints of other images that it was matched with.
#[derive(Debug)]
pub struct Correspondences {
    /// Number of the first keypoint of each image, counted over all images.
    first: Vec<u32>,
    /// Start of the links of each keypoint; one more at the end.
    starts: Vec<u32>,
    links: Vec<KeypointId>,
}

impl Correspondences {
    /// Collects the matches of all pairs.
    #[must_use]
    pub fn new(problem: &MapProblem) -> Self {
        let mut first = vec![0];
        for image in &problem.images {
            first.push(first[first.len() - 1] + image.keypoints.len() as u32);
        }
        let mut starts = vec![0; first[first.len() - 1] as usize + 1];
        let both = || {
            problem.pairs.iter().flat_map(|pair| {
                let [a, b] = pair.images;
                pair.matches.iter().flat_map(move |&[i, j]| {
                    let (x, y) = (
                        KeypointId { image: a, index: i },
                        KeypointId { image: b, index: j },
                    );
                    [(x, y), (y, x)]
                })
            })
        };
        let slot =
            |keypoint: KeypointId| (first[keypoint.image as usize] + keypoint.index) as usize;
        for (from, _) in both() {
            starts[slot(from) + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut links = vec![KeypointId { image: 0, index: 0 }; starts[starts.len() - 1] as usize];
        let mut next = starts.clone();
        for (from, to) in both() {
            let place = &mut next[slot(from)];
            links[*place as usize] = to;
            *place += 1;
        }
        Self {
            first,
            starts,
            links,
        }
    }

    /// Returns what a keypoint was matched with, in the order of the pairs.
    #[must_use]
    pub fn of(&self, keypoint: KeypointId) -> &[KeypointId] {
        let slot = (self.first[keypoint.image as usize] + keypoint.index) as usize;
        &self.links[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }
}

/// A point of the model and the keypoints that see it.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelPoint {
    /// Position in world units.
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
    /// Creates a model in which nothing is placed.
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

    /// Returns whether an image is placed.
    #[must_use]
    pub fn is_placed(&self, image: u32) -> bool {
        self.poses[image as usize].is_some()
    }

    /// Returns the images that are placed.
    pub fn placed(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.poses.len() as u32).filter(|&image| self.is_placed(image))
    }

    /// Returns the point that a keypoint sees.
    #[must_use]
    pub fn point_of(&self, keypoint: KeypointId) -> Option<u32> {
        Some(self.point_of[keypoint.image as usize][keypoint.index as usize])
            .filter(|&point| point != NO_POINT)
    }

    /// Returns a point by number; `None` if it was removed.
    #[must_use]
    pub fn point(&self, point: u32) -> Option<&ModelPoint> {
        self.points.get(point as usize)?.as_ref()
    }

    /// Returns all points with their numbers, which never change.
    pub fn points(&self) -> impl Iterator<Item = (u32, &ModelPoint)> + '_ {
        self.points
            .iter()
            .enumerate()
            .filter_map(|(i, point)| Some((i as u32, point.as_ref()?)))
    }

    /// Returns one above the highest number of a point.
    #[must_use]
    pub fn point_slots(&self) -> u32 {
        self.points.len() as u32
    }

    /// Returns how many of an image's keypoints see a point.
    #[must_use]
    pub fn points_seen(&self, image: u32) -> usize {
        self.point_of[image as usize]
            .iter()
            .filter(|&&point| point != NO_POINT)
            .count()
    }

    /// Adds a point whose keypoints see no other point, and returns its number.
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

    /// Adds a keypoint that sees no point yet to the track of a point.
    pub fn extend(&mut self, number: u32, keypoint: KeypointId) {
        if let Some(point) = self.points[number as usize].as_mut() {
            point.track.push(keypoint);
            self.point_of[keypoint.image as usize][keypoint.index as usize] = number;
        }
    }

    /// Removes a keypoint from the track of its point.
    pub fn detach(&mut self, keypoint: KeypointId) {
        let Some(number) = self.point_of(keypoint) else {
            return;
        };
        self.point_of[keypoint.image as usize][keypoint.index as usize] = NO_POINT;
        if let Some(point) = self.points[number as usize].as_mut() {
            point.track.retain(|&other| other != keypoint);
        }
    }

    /// Removes a point and returns it.
    pub fn remove(&mut self, number: u32) -> Option<ModelPoint> {
        let point = self.points[number as usize].take()?;
        for keypoint in &point.track {
            self.point_of[keypoint.image as usize][keypoint.index as usize] = NO_POINT;
        }
        Some(point)
    }
}
