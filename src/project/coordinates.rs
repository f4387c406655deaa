use crate::ResultEngine;
use glam::DVec3;

use crate::{Coordinates, Project, ResultKind, ResultRecord};
use ostra_cloud::measure::LengthUnit;
use ostra_frames::{DepthSource, Frame};

impl Project {
    /// Returns the coordinates of the cameras.
    #[must_use]
    pub fn coordinates(&self) -> Coordinates {
        let record = self.results.get(&ResultKind::Cameras);
        let is_metric = || {
            self.frames.iter().any(Frame::has_sensor_depth)
                || record.is_none_or(|record| !is_free(record))
        };
        record
            .and_then(|record| record.coordinates)
            .unwrap_or_else(|| Coordinates::chosen_with(Coordinates::OF_GIVEN_CAMERAS, is_metric()))
    }

    /// Returns the coordinates of the labelled cloud and its surface.
    ///
    /// Without a cloud, these are the coordinates of the cameras. Returns `None` if they are
    /// unknown, because the cloud was made by an older version and may be older than the scale.
    #[must_use]
    pub fn cloud_coordinates(&self) -> Option<Coordinates> {
        let record = self.results.get(&ResultKind::Cloud);
        match record {
            Some(ResultRecord {
                coordinates: Some(coordinates),
                ..
            }) => Some(*coordinates),
            Some(ResultRecord {
                coordinates: None,
                stale: true,
                ..
            }) if self.has_chosen_scale() => None,
            _ => Some(self.coordinates()),
        }
    }

    /// Returns the unit of lengths in the labelled cloud and its surface.
    #[must_use]
    pub fn cloud_unit(&self) -> LengthUnit {
        self.cloud_coordinates()
            .map_or(LengthUnit::World, |coordinates| coordinates.unit)
    }

    /// Returns the unit of a frame's depths.
    ///
    /// The unit is unknown ([`LengthUnit::World`]) if stereo made the depths with other cameras.
    #[must_use]
    pub fn depth_unit(&self, frame: usize) -> LengthUnit {
        let is_stale = || {
            self.results
                .get(&ResultKind::Depths)
                .is_some_and(|record| record.stale)
        };
        match self.frames.get(frame).map(|frame| &frame.depth) {
            Some(Some(DepthSource::Sensor { .. })) => LengthUnit::Metre,
            Some(Some(DepthSource::Estimated { .. })) if is_stale() => LengthUnit::World,
            _ => self.coordinates().unit,
        }
    }

    /// Returns whether lengths count as metres only because the cameras were given.
    ///
    /// Nothing confirms the unit: no frame has sensor depth, and the scale was never set.
    #[must_use]
    pub fn is_unit_assumed(&self) -> bool {
        !self.results.contains_key(&ResultKind::Cameras)
            && self
                .frames
                .iter()
                .any(|frame| frame.posed_camera().is_some())
            && !self.frames.iter().any(Frame::has_sensor_depth)
    }

    /// Returns whether the scale of the cameras is or was arbitrary.
    fn has_chosen_scale(&self) -> bool {
        self.results
            .get(&ResultKind::Cameras)
            .is_some_and(|record| {
                record.engine == ResultEngine::Sfm
                    || record.scaled.is_some()
                    || record.settings.contains("scaled by")
            })
    }
}

/// Returns whether a camera record has an arbitrary scale.
///
/// This is for records of older versions, which hold no unit.
fn is_free(record: &ResultRecord) -> bool {
    record.engine == ResultEngine::Sfm && !record.settings.contains("scaled by")
}

/// Returns the factor by which all lengths were multiplied from `before` to `now`.
///
/// Returns `None` if nothing was scaled or the cameras changed in another way.
#[must_use]
pub fn scale_between(before: &[Frame], now: &[Frame]) -> Option<f64> {
    let pose = |frame: &Frame| frame.posed_camera().map(|(_, pose)| *pose);
    let same_poses = before.len() == now.len()
        && before
            .iter()
            .zip(now)
            .all(|(a, b)| pose(a).map(|pose| pose.rotation) == pose(b).map(|pose| pose.rotation));
    if !same_poses {
        return None;
    }
    let translations: Vec<(DVec3, DVec3)> = before
        .iter()
        .zip(now)
        .filter_map(|(a, b)| Some((pose(a)?.translation, pose(b)?.translation)))
        .collect();
    let (a, b) = translations
        .iter()
        .max_by(|(a, _), (b, _)| a.length_squared().total_cmp(&b.length_squared()))?;
    let (factor, slack) = (b.length() / a.length(), 1e-9 * b.length());
    let is_scaled = translations
        .iter()
        .all(|(a, b)| (factor * *a).distance(*b) <= slack);
    (is_scaled && factor.is_finite() && factor > 0.0 && (factor - 1.0).abs() > 1e-12)
        .then_some(factor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{camera, frame, record};

    fn frames(shifts: &[f64], factor: f64) -> Vec<Frame> {
        let one = |&shift: &f64| {
            let mut camera = camera(shift);
            camera.camera_from_world.as_mut().unwrap().translation *= factor;
            Frame {
                camera: Some(camera),
                ..frame("a.png")
            }
        };
        shifts.iter().map(one).collect()
    }

    #[test]
    fn scaling_is_distinguished_from_other_camera_changes() {
        let before = frames(&[0.0, 1.0, 2.0], 1.0);
        let factor = scale_between(&before, &frames(&[0.0, 1.0, 2.0], 0.25)).unwrap();
        assert!((factor - 0.25).abs() < 1e-12);
        assert_eq!(scale_between(&before, &before), None);
        assert_eq!(
            scale_between(&before, &frames(&[0.0, 1.0, 2.1], 0.25)),
            None,
            "a camera moved"
        );
        assert_eq!(scale_between(&before, &before[..2]), None);
        let mut lost = frames(&[0.0, 1.0, 2.0], 0.25);
        lost[1].camera = None;
        assert_eq!(scale_between(&before, &lost), None);
    }

    #[test]
    fn cloud_keeps_its_unit_when_cameras_change() {
        let mut project = Project::default();
        assert_eq!(project.cloud_unit(), LengthUnit::Metre, "given cameras");
        let with = |coordinates| ResultRecord {
            coordinates,
            ..record("sfm")
        };
        let metric = Some(Coordinates::chosen_with(3, true));
        project.results.insert(ResultKind::Cloud, with(metric));
        project.results.insert(
            ResultKind::Cameras,
            with(Some(Coordinates::chosen_with(4, false))),
        );
        assert_eq!(
            (project.cloud_unit(), project.coordinates().unit),
            (LengthUnit::Metre, LengthUnit::World)
        );
    }

    #[test]
    fn records_without_a_unit_are_never_metric_when_the_scale_may_be_newer() {
        let mut project = Project::default();
        let sfm = ResultRecord {
            settings: "5 of 5 frames".into(),
            ..record("sfm")
        };
        let scaled = ResultRecord {
            settings: "5 of 5 frames, scaled by 2.000000".into(),
            ..record("sfm")
        };
        project.results.insert(ResultKind::Cloud, record("fuse"));
        project.results.insert(ResultKind::Cameras, sfm);
        assert_eq!(project.cloud_unit(), LengthUnit::World);
        project.results.insert(ResultKind::Cameras, scaled);
        assert_eq!(
            project.cloud_unit(),
            LengthUnit::Metre,
            "fused after the scale was set"
        );
        project.results.get_mut(&ResultKind::Cloud).unwrap().stale = true;
        assert_eq!(
            (project.cloud_unit(), project.cloud_coordinates()),
            (LengthUnit::World, None)
        );
    }
}
