//! Picking of points and camera frustums under the pointer, with a background thread for points.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::paint::Paint;
use super::point_lod::outside_job_pool;
use super::{Appearance, Clip, ViewCamera};
use ostra_cloud::LabelledCloud;
use ostra_frames::Frame;

/// Place in an image where a point is picked, and what decides which points are visible there.
#[derive(Debug, Clone, PartialEq)]
pub struct PickRequest {
    /// The camera of the image.
    pub camera: ViewCamera,
    /// Colours and hidden labels; decides which points are drawn.
    pub appearance: Appearance,
    /// Clip box; points outside are not picked.
    pub clip: Clip,
    /// Position in the image, in pixels.
    pub at_px: Vec2,
    /// Largest distance of the point from the position, in pixels.
    pub radius_px: f32,
}

/// Returns the index of the visible point at a pixel position.
///
/// Candidates are the drawn points within the radius. Only those with the highest opacity count,
/// so that faint points are picked only where there is nothing else. Among those at most 1 %
/// farther than the nearest, the one closest to the position wins. Hidden and clipped points are
/// ignored.
#[must_use]
pub fn pick_point(cloud: &LabelledCloud, request: &PickRequest) -> Option<usize> {
    let PickRequest {
        camera,
        appearance,
        clip,
        at_px,
        radius_px,
    } = request;
    let paint = Paint::new(cloud, appearance);
    let hits: Vec<(usize, f32, f32)> = cloud
        .positions
        .par_iter()
        .enumerate()
        .filter_map(|(index, &x)| {
            let (px, depth) = camera.project(x)?;
            let off = px.distance(*at_px);
            let is_drawn = || paint.opacity(cloud, index) > 0 && clip.contains(x);
            (off <= *radius_px && is_drawn()).then_some((index, depth, off))
        })
        .collect();
    let most = hits.iter().map(|hit| paint.opacity(cloud, hit.0)).max()?;
    let solid = || {
        hits.iter()
            .filter(|hit| paint.opacity(cloud, hit.0) == most)
    };
    let nearest = solid().map(|hit| hit.1).min_by(f32::total_cmp)?;
    solid()
        .filter(|hit| camera.farther_by(hit.1, nearest) <= 0.01)
        .min_by(|a, b| a.2.total_cmp(&b.2).then(a.0.cmp(&b.0)))
        .map(|hit| hit.0)
}

/// Returns the frame whose camera centre is closest to a pixel position, within `radius_px`.
#[must_use]
pub fn pick_frustum(
    frames: &[Frame],
    camera: &ViewCamera,
    at_px: Vec2,
    radius_px: f32,
) -> Option<usize> {
    let distance = |frame: &Frame| {
        let (_, pose) = frame.posed_camera()?;
        let centre: Vec3 = pose.centre().as_vec3();
        camera
            .project(centre)
            .map(|(px, _)| px.distance(at_px))
            .filter(|&off| off <= radius_px)
    };
    frames
        .iter()
        .enumerate()
        .filter_map(|(number, frame)| Some((number, distance(frame)?)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(number, _)| number)
}

/// A point query that runs in the background.
///
/// On large clouds a query takes longer than drawing one frame of the window.
pub struct Picking {
    found: Receiver<Option<usize>>,
}

impl Picking {
    /// Starts [`pick_point`] in the background; `wake` is called when the result is available.
    pub fn begin(
        cloud: Arc<LabelledCloud>,
        request: PickRequest,
        wake: impl FnOnce() + Send + 'static,
    ) -> Self {
        let (sender, found) = channel();
        outside_job_pool(move || {
            // Sending fails only if the result is no longer wanted.
            let _ = sender.send(pick_point(&cloud, &request));
            wake();
        });
        Self { found }
    }

    /// Returns the result of [`pick_point`], or `None` if it is not available yet.
    #[must_use]
    pub fn next(&self) -> Option<Option<usize>> {
        match self.found.try_recv() {
            Ok(found) => Some(found),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axes, Bounds, Orbit};
    use ostra_masks::{Label, LabelId};

    #[test]
    fn clipped_and_faint_points_are_not_picked() {
        let mut cloud = LabelledCloud::from_positions(vec![Vec3::ZERO, Vec3::Z]);
        cloud.labels = vec![LabelId(1), LabelId(2)];
        for id in [1, 2] {
            let label = Label {
                id: LabelId(id),
                name: id.to_string(),
                color: [9; 3],
                parent: None,
            };
            cloud.tree.set(label).unwrap();
        }
        let bounds = Bounds {
            min: Vec3::splat(-1.0),
            max: Vec3::ONE,
        };
        let mut orbit = Orbit::framing(&bounds, Vec3::Z, Vec3::NEG_Y);
        for orthographic in [false, true] {
            orbit.orthographic = orthographic;
            let camera = orbit.camera(100, 100);
            let pick = |appearance: &Appearance, clip: &Clip| {
                let request = PickRequest {
                    camera,
                    appearance: appearance.clone(),
                    clip: *clip,
                    at_px: Vec2::splat(50.0),
                    radius_px: 4.0,
                };
                pick_point(&cloud, &request)
            };
            let mut appearance = Appearance::default();
            assert_eq!(pick(&appearance, &Clip::default()), Some(0));
            let axes = Axes {
                right: Vec3::X,
                up: Vec3::Y,
                forward: Vec3::Z,
            };
            let far_half = Bounds {
                min: Vec3::new(-1.0, -1.0, 0.5),
                max: Vec3::splat(2.0),
            };
            assert_eq!(pick(&appearance, &Clip::inside(&axes, &far_half)), Some(1));
            (appearance.isolated, appearance.faint) = (Some(LabelId(2)), 0.3);
            assert_eq!(pick(&appearance, &Clip::default()), Some(1));
            appearance.hidden.insert(LabelId(2));
            assert_eq!(
                pick(&appearance, &Clip::default()),
                Some(0),
                "nothing else is there"
            );
        }
    }
}
