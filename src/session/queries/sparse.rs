use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Result;
use glam::DVec2;

use super::cloud::Snapshot;
use crate::Event;
use crate::query::QueryKey;
use ostra_cloud::LabelledCloud;
use ostra_frames::cameras::SparsePoints;
use ostra_project::store::{load_links, load_outcomes, read_sparse, sparse_path};
use ostra_reconstruct::rgbd::FrameLink;
use ostra_reconstruct::sfm::RegistrationStatus;

/// The sparse reconstruction of the cameras.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SparseReconstruction {
    /// Points, and the keypoints that see them.
    pub points: SparsePoints,
    /// RegistrationStatus of each frame, by frame number.
    pub outcomes: BTreeMap<usize, RegistrationStatus>,
    /// Links between frames by depth, in ascending order of their numbers.
    pub links: Vec<FrameLink>,
    /// The points as a cloud without labels.
    pub cloud: Arc<LabelledCloud>,
    shared: BTreeMap<usize, BTreeMap<usize, usize>>,
}

impl SparseReconstruction {
    /// Creates the model from points, outcomes of the frames, and links between them.
    #[must_use]
    pub fn new(
        points: SparsePoints,
        outcomes: BTreeMap<usize, RegistrationStatus>,
        links: Vec<FrameLink>,
    ) -> Self {
        let positions = points
            .points
            .iter()
            .map(|point| point.position.as_vec3())
            .collect();
        let colors = points.points.iter().map(|point| point.color).collect();
        let cloud = Arc::new(LabelledCloud {
            colors,
            ..LabelledCloud::from_positions(positions)
        });
        let mut shared: BTreeMap<usize, BTreeMap<usize, usize>> = BTreeMap::new();
        for track in points.tracks() {
            for &(a, _) in &track {
                for &(b, _) in track.iter().filter(|&&(b, _)| b != a) {
                    *shared.entry(a).or_default().entry(b).or_default() += 1;
                }
            }
        }
        Self {
            points,
            outcomes,
            links,
            cloud,
            shared,
        }
    }

    /// Returns the frames that share points with this one, and how many, in descending order.
    #[must_use]
    pub fn neighbours(&self, frame: usize) -> Vec<(usize, usize)> {
        let shared = self.shared.get(&frame).into_iter().flatten();
        let mut ranked: Vec<(usize, usize)> =
            shared.map(|(&other, &count)| (other, count)).collect();
        ranked.sort_by_key(|&(other, count)| (std::cmp::Reverse(count), other));
        ranked
    }

    /// Returns the links of a frame, each with the frame at its other end.
    ///
    /// Links that hold and are most consistent come first.
    #[must_use]
    pub fn linked(&self, frame: usize) -> Vec<(usize, FrameLink)> {
        let own = self
            .links
            .iter()
            .filter(|link| link.frames.contains(&frame));
        let other = |link: &FrameLink| link.frames[usize::from(link.frames[0] == frame)];
        let mut linked: Vec<(usize, FrameLink)> = own.map(|link| (other(link), *link)).collect();
        linked.sort_by(|(_, a), (_, b)| {
            b.holds
                .cmp(&a.holds)
                .then(b.consistent.total_cmp(&a.consistent))
        });
        linked
    }

    /// Returns the points that two frames both see: pixel in each frame, and the point's number.
    #[must_use]
    pub fn matches(&self, first: usize, second: usize) -> Vec<(DVec2, DVec2, u32)> {
        let keypoints = |frame| self.points.keypoints.get(&frame).into_iter().flatten();
        let seen =
            |frame| keypoints(frame).filter_map(|keypoint| Some((keypoint.point?, keypoint.at_px)));
        let by_point: BTreeMap<u32, DVec2> = seen(second).collect();
        seen(first)
            .filter_map(|(point, at)| Some((at, *by_point.get(&point)?, point)))
            .collect()
    }
}

/// A version of the project's cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SparseKey {
    pub(crate) version: u64,
}

impl QueryKey for SparseKey {
    const TITLE: &'static str = "Load sparse points";
    const EVENT: Option<Event> = Some(Event::SparseChanged);
}

/// Reads the sparse reconstruction.
///
/// # Errors
///
/// Returns an error if a file is damaged.
pub(crate) fn load_sparse_model(
    snapshot: &Snapshot,
    key: &SparseKey,
) -> Result<SparseReconstruction> {
    let points = read_sparse(&snapshot.root, &snapshot.project)?;
    let folder = sparse_path(&snapshot.root, key.version);
    Ok(SparseReconstruction::new(
        points,
        load_outcomes(&folder)?,
        load_links(&folder)?,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::cameras::{SparseKeypoint, SparsePoint};

    #[test]
    fn neighbours_and_matches_come_from_tracks() {
        let point = SparsePoint {
            position: glam::DVec3::ZERO,
            color: [1, 2, 3],
            error_px: None,
        };
        let keypoint = |x: f64, point| SparseKeypoint {
            at_px: DVec2::new(x, 0.5),
            point,
        };
        let keypoints = BTreeMap::from([
            (0, vec![keypoint(1.0, Some(0)), keypoint(2.0, Some(1))]),
            (1, vec![keypoint(3.0, None), keypoint(4.0, Some(0))]),
            (5, vec![keypoint(5.0, Some(1)), keypoint(6.0, Some(0))]),
        ]);
        let model = SparseReconstruction::new(
            SparsePoints {
                points: vec![point; 2],
                keypoints,
            },
            BTreeMap::new(),
            Vec::new(),
        );
        assert_eq!(model.neighbours(0), [(5, 2), (1, 1)]);
        assert_eq!(
            model.matches(1, 5),
            [(DVec2::new(4.0, 0.5), DVec2::new(6.0, 0.5), 0)]
        );
        assert_eq!(model.cloud.colors, [[1, 2, 3]; 2]);
    }
}
