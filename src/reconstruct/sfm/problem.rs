//! What is mapped, which keypoints correspond, and the sparse models that are made of it.

use glam::{DVec2, DVec3};

use ostra_geometry::{Camera, Pose, TwoViewKind};

/// A keypoint of an image, by number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeypointId {
    /// Which image.
    pub image: u32,
    /// Which of its keypoints.
    pub index: u32,
}

/// How far a camera's intrinsics can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IntrinsicsSource {
    /// Known; they stay as they are.
    Given,
    /// The focal length is told by the picture file; all is refined.
    Exif,
    /// Nothing is known; the focal length is looked for, all is refined.
    Guessed,
}

/// A physical camera, shared by all images that it took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapCamera {
    /// Its intrinsics, or where their refinement starts.
    pub intrinsics: Camera,
    /// How far they can be trusted.
    pub source: IntrinsicsSource,
}

/// An image as the mapper sees it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapImage {
    /// Which of the cameras took it.
    pub camera: usize,
    /// Its keypoints in pixels.
    pub keypoints: Vec<DVec2>,
    /// `camera_from_world` where it is known and shall stay.
    pub given: Option<Pose>,
}

/// Two images whose matches agree with one geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct VerifiedPair {
    /// The two images, the lower number first.
    pub images: [u32; 2],
    /// Pairs of keypoints that agree.
    pub matches: Vec<[u32; 2]>,
    /// Which geometry explains them.
    pub kind: TwoViewKind,
    /// `second_from_first` with a translation of length 1, where it could be found.
    pub second_from_first: Option<Pose>,
    /// Median angle between the two rays of a match in radians.
    pub parallax: f64,
}

/// All that the mapper works on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapProblem {
    /// The cameras that took the images.
    pub cameras: Vec<MapCamera>,
    /// The images.
    pub images: Vec<MapImage>,
    /// Pairs of images that see the same.
    pub pairs: Vec<VerifiedPair>,
}

/// For every keypoint the keypoints of other images that it was matched with.
#[derive(Debug)]
pub struct Correspondences {
    /// Number of the first keypoint of each image, counted over all images.
    first: Vec<u32>,
    /// Where the links of each keypoint begin; one more at the end.
    starts: Vec<u32>,
    links: Vec<KeypointId>,
}

impl Correspondences {
    /// Gathers the matches of all pairs.
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

    /// What a keypoint was matched with, in the order of the pairs.
    #[must_use]
    pub fn of(&self, keypoint: KeypointId) -> &[KeypointId] {
        let slot = (self.first[keypoint.image as usize] + keypoint.index) as usize;
        &self.links[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }
}

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
