use std::sync::Arc;

use glam::DVec3;

use crate::{Edit, Project};
use ostra_frames::Frame;
use ostra_frames::cameras::SparsePoints;

/// Distance from zero beyond which cameras get an origin of their own.
///
/// The spacing of 32-bit floats is 0.06 mm just below it, and 0.5 m at the northings of UTM.
const FAR: f64 = 1000.0;
/// Step of which the origin is a multiple, so that it is short to write and exact in every format.
const STEP: f64 = 100.0;

/// Returns the origin that keeps positions near these frames' cameras exact in 32 bits.
///
/// Returns zero if the cameras are near zero already, or so far apart that no origin is near all of
/// them.
#[must_use]
pub fn origin_near(frames: &[Frame]) -> DVec3 {
    let centres: Vec<DVec3> = frames
        .iter()
        .filter_map(|frame| Some(frame.posed_camera()?.1.centre()))
        .collect();
    let farthest = |from: DVec3| {
        centres
            .iter()
            .map(|&at| (at - from).abs().max_element())
            .fold(0.0, f64::max)
    };
    if centres.is_empty() || farthest(DVec3::ZERO) < FAR {
        return DVec3::ZERO;
    }
    let mean = centres.iter().sum::<DVec3>() / centres.len() as f64;
    // Adding zero turns -0 into 0.
    let origin = (mean / STEP).round() * STEP + DVec3::ZERO;
    if farthest(origin) < farthest(DVec3::ZERO) / 4.0 {
        origin
    } else {
        DVec3::ZERO
    }
}

/// Makes the frames' poses relative to `origin`.
pub fn make_relative(frames: &mut [Frame], origin: DVec3) {
    if origin == DVec3::ZERO {
        return;
    }
    let cameras = frames.iter_mut().filter_map(|frame| frame.camera.as_mut());
    for pose in cameras.filter_map(|camera| camera.camera_from_world.as_mut()) {
        *pose = pose.relative_to(origin);
    }
}

impl Project {
    /// Returns the frames with poses in the coordinates in which they were given.
    ///
    /// Other programs expect these coordinates.
    #[must_use]
    pub fn global_frames(&self) -> Arc<Vec<Frame>> {
        let mut frames = Arc::clone(&self.frames);
        if self.origin != DVec3::ZERO {
            let moved: &mut Vec<Frame> = Arc::make_mut(&mut frames);
            make_relative(moved, -self.origin);
        }
        frames
    }

    /// Returns sparse points of this project in the coordinates in which its cameras were given.
    #[must_use]
    pub fn global_points(&self, mut sparse: SparsePoints) -> SparsePoints {
        sparse
            .points
            .iter_mut()
            .for_each(|point| point.position += self.origin);
        sparse
    }

    /// Returns the edits that give a project an origin near its cameras if it needs one.
    ///
    /// Projects of earlier versions have no origin and keep all coordinates as they were given.
    /// Results made with the cameras stay valid, except for a cloud, whose coordinates differ.
    pub fn move_origin_near_cameras(&self) -> Vec<Edit> {
        let origin = if self.origin == DVec3::ZERO {
            origin_near(&self.frames)
        } else {
            DVec3::ZERO
        };
        if origin == DVec3::ZERO {
            return Vec::new();
        }
        let mut frames = self.frames.to_vec();
        make_relative(&mut frames, origin);
        let cameras = frames
            .iter()
            .enumerate()
            .map(|(frame, moved)| Edit::SetCamera {
                frame,
                camera: moved.camera,
            });
        let fresh = self
            .masks
            .iter()
            .filter(|(_, mask)| !mask.stale)
            .map(|(&frame, _)| frame)
            .collect();
        let results = self
            .results
            .iter()
            .filter(|(kind, _)| **kind != crate::ResultKind::Cloud);
        let kept = results.map(|(&kind, record)| Edit::SetResult {
            kind,
            record: Some(record.clone()),
        });
        let stays = Edit::SetStale {
            frames: fresh,
            stale: false,
        };
        std::iter::once(Edit::SetOrigin { origin })
            .chain(cameras)
            .chain([stays])
            .chain(kept)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::{FrameCamera, ImageSource, Orientation};
    use ostra_geometry::{Camera, Pose};

    fn frames(centres: &[DVec3]) -> Vec<Frame> {
        let intrinsics = Camera::pinhole(64, 48, [60.0, 60.0], [32.0, 24.0]);
        let frame = |(number, &centre): (usize, &DVec3)| Frame {
            name: format!("{number}.png"),
            image: ImageSource::File {
                path: "a.png".into(),
                orientation: Orientation::default(),
            },
            width: 64,
            height: 48,
            depth: None,
            camera: Some(FrameCamera::given(
                intrinsics,
                Some(Pose::IDENTITY.relative_to(-centre)),
            )),
        };
        centres.iter().enumerate().map(frame).collect()
    }

    #[test]
    fn only_far_cameras_get_an_origin() {
        let near = [DVec3::ZERO, DVec3::new(40.0, -900.0, 3.0)];
        assert_eq!(origin_near(&frames(&near)), DVec3::ZERO);
        assert_eq!(origin_near(&[]), DVec3::ZERO);
        let utm = DVec3::new(500_012.0, 5_400_031.5, 312.0);
        assert_eq!(
            origin_near(&frames(&[utm, utm + DVec3::X])),
            DVec3::new(500_000.0, 5_400_000.0, 300.0)
        );
        let wide = [DVec3::new(-2000.0, 0.0, 0.0), DVec3::new(2100.0, 0.0, 0.0)];
        assert_eq!(
            origin_near(&frames(&wide)),
            DVec3::ZERO,
            "no origin is much nearer to both"
        );
    }

    #[test]
    fn project_without_an_origin_gets_one_and_undo_is_exact() {
        let utm = DVec3::new(500_012.25, 5_400_031.5, 312.0);
        let mut project = Project {
            frames: Arc::new(frames(&[utm])),
            ..Project::default()
        };
        let before = project.clone();
        let edits = project.move_origin_near_cameras();
        let mut back: Vec<Edit> = edits
            .into_iter()
            .map(|edit| project.apply(edit).unwrap())
            .collect();
        let centre = project.frames[0].posed_camera().unwrap().1.centre();
        assert!(centre.abs_diff_eq(DVec3::new(12.25, 31.5, 12.0), 1e-6));
        assert!(
            project.global_frames()[0]
                .posed_camera()
                .unwrap()
                .1
                .centre()
                .abs_diff_eq(utm, 1e-6)
        );
        assert!(project.move_origin_near_cameras().is_empty());
        back.reverse();
        back.into_iter()
            .for_each(|edit| drop(project.apply(edit).unwrap()));
        assert!(project == before);
    }
}
