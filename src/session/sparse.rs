use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec2;

use super::jobs::{Kind, Landing};
use super::store::{load_outcomes, load_sparse, sparse_path, version_in_force};
use super::{Event, ResultKind, Session};
use crate::frames::cameras::SparsePoints;
use crate::scene::LabelledCloud;
use crate::scene::sfm::Outcome;

/// What the cameras were found with.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SparseModel {
    /// Points, and the keypoints that see them.
    pub points: SparsePoints,
    /// By frame number, what became of it.
    pub outcomes: BTreeMap<usize, Outcome>,
    /// The points as a cloud without labels.
    pub cloud: Arc<LabelledCloud>,
    shared: BTreeMap<usize, BTreeMap<usize, usize>>,
}

impl SparseModel {
    /// From points and what became of the frames.
    #[must_use]
    pub fn new(points: SparsePoints, outcomes: BTreeMap<usize, Outcome>) -> Self {
        let positions = points.points.iter().map(|point| point.position.as_vec3()).collect();
        let colors = points.points.iter().map(|point| point.color).collect();
        let cloud = Arc::new(LabelledCloud { colors, ..LabelledCloud::from_positions(positions) });
        let mut shared: BTreeMap<usize, BTreeMap<usize, usize>> = BTreeMap::new();
        for track in points.tracks() {
            for &(a, _) in &track {
                for &(b, _) in track.iter().filter(|&&(b, _)| b != a) {
                    *shared.entry(a).or_default().entry(b).or_default() += 1;
                }
            }
        }
        Self { points, outcomes, cloud, shared }
    }

    /// The frames that see points of this one, with how many; the one with most first.
    #[must_use]
    pub fn neighbours(&self, frame: usize) -> Vec<(usize, usize)> {
        let shared = self.shared.get(&frame).into_iter().flatten();
        let mut ranked: Vec<(usize, usize)> = shared.map(|(&other, &count)| (other, count)).collect();
        ranked.sort_by_key(|&(other, count)| (std::cmp::Reverse(count), other));
        ranked
    }

    /// Where two frames see the same point: pixel in the one, pixel in the other, and the point's number.
    #[must_use]
    pub fn matches(&self, first: usize, second: usize) -> Vec<(DVec2, DVec2, u32)> {
        let keypoints = |frame| self.points.keypoints.get(&frame).into_iter().flatten();
        let seen = |frame| keypoints(frame).filter_map(|keypoint| Some((keypoint.point?, keypoint.at_px)));
        let by_point: BTreeMap<u32, DVec2> = seen(second).collect();
        seen(first).filter_map(|(point, at)| Some((at, *by_point.get(&point)?, point))).collect()
    }
}

/// The sparse model that was loaded last.
#[derive(Default)]
pub(super) struct SparseSlot {
    loaded: Option<(u64, Arc<SparseModel>)>,
    /// Somebody asked for the project's model since it was last loaded.
    wanted: Cell<bool>,
    /// The version that is being loaded.
    tried: Option<u64>,
}

impl Session {
    /// The sparse model of the project's cameras where they were found by structure from motion. It is loaded by a job
    /// when it is first asked for: `None` until [`Event::SparseChanged`].
    #[must_use]
    pub fn sparse(&self) -> Option<&Arc<SparseModel>> {
        let version = self.project().and_then(|project| version_in_force(project, ResultKind::Cameras))?;
        let loaded = self.sparse.loaded.as_ref().filter(|(loaded, _)| *loaded == version);
        if loaded.is_none() {
            self.sparse.wanted.set(true);
        }
        loaded.map(|(_, model)| model)
    }

    /// Starts to load the model that was asked for.
    pub(super) fn load_wanted_sparse(&mut self) {
        let Some(project) = self.project().cloned() else { return };
        let version = version_in_force(&project, ResultKind::Cameras);
        if !self.sparse.wanted.take() || version.is_none() || self.sparse.tried == version {
            return;
        }
        self.sparse.tried = version;
        let (Some(version), Some(root)) = (version, self.root().map(Path::to_owned)) else { return };
        self.start("Load sparse points", Kind::Background, move |_| {
            let points = load_sparse(&root, &project);
            let outcomes = load_outcomes(&sparse_path(&root, version))?;
            let model = Arc::new(SparseModel::new(points, outcomes));
            Ok(Box::new(move |session: &mut Self| {
                session.sparse.loaded = Some((version, model));
                session.sparse.tried = None;
                session.events.push(Event::SparseChanged);
                Ok(())
            }) as Landing)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::cameras::{SparseKeypoint, SparsePoint};

    #[test]
    fn neighbours_and_matches_come_from_tracks() {
        let point = SparsePoint { position: glam::DVec3::ZERO, color: [1, 2, 3], error_px: None };
        let keypoint = |x: f64, point| SparseKeypoint { at_px: DVec2::new(x, 0.5), point };
        let keypoints = BTreeMap::from([
            (0, vec![keypoint(1.0, Some(0)), keypoint(2.0, Some(1))]),
            (1, vec![keypoint(3.0, None), keypoint(4.0, Some(0))]),
            (5, vec![keypoint(5.0, Some(1)), keypoint(6.0, Some(0))]),
        ]);
        let model = SparseModel::new(SparsePoints { points: vec![point; 2], keypoints }, BTreeMap::new());
        assert_eq!(model.neighbours(0), [(5, 2), (1, 1)]);
        assert_eq!(model.matches(1, 5), [(DVec2::new(4.0, 0.5), DVec2::new(6.0, 0.5), 0)]);
        assert_eq!(model.cloud.colors, [[1, 2, 3]; 2]);
    }
}
