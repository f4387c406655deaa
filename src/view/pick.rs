//! Picking of points and frustums, and of points on a thread of its own.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::arrangement::beside_jobs;
use super::paint::Paint;
use super::{Appearance, Clip, ViewCamera};
use ostra_cloud::LabelledCloud;
use ostra_frames::Frame;

/// The point seen at a pixel position: the nearest to the eye among those within `radius_px`, preferring the one that
/// lies closest to the position when several are about equally near. What is hidden or clipped is looked through, and
/// what is faint wherever there is anything else.
#[must_use]
pub fn pick_point(
    cloud: &LabelledCloud,
    camera: &ViewCamera,
    at_px: Vec2,
    radius_px: f32,
    appearance: &Appearance,
    clip: &Clip,
) -> Option<usize> {
    let paint = Paint::new(cloud, appearance);
    let hits: Vec<(usize, f32, f32)> = cloud
        .positions
        .par_iter()
        .enumerate()
        .filter_map(|(index, &x)| {
            let (px, depth) = camera.project(x)?;
            let off = px.distance(at_px);
            let is_drawn = || paint.opacity(cloud, index) > 0 && clip.contains(x);
            (off <= radius_px && is_drawn()).then_some((index, depth, off))
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

/// The number of the frame whose camera centre lies within `radius_px` of a pixel position, nearest first.
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

/// The point seen at a pixel of a view, looked for in the background: large clouds take longer than a picture of the window.
pub struct Picking {
    found: Receiver<Option<usize>>,
}

impl Picking {
    /// Begins to look for what [`pick_point`] gives; `wake` is called when it is known.
    pub fn begin(
        cloud: Arc<LabelledCloud>,
        camera: ViewCamera,
        (at_px, radius_px): (Vec2, f32),
        (appearance, clip): (Appearance, Clip),
        wake: impl FnOnce() + Send + 'static,
    ) -> Self {
        let (sender, found) = channel();
        beside_jobs(move || {
            // An error says that nobody waits any more.
            let _ = sender.send(pick_point(
                &cloud,
                &camera,
                at_px,
                radius_px,
                &appearance,
                &clip,
            ));
            wake();
        });
        Self { found }
    }

    /// The number of the point, or that there is none, once that is known.
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
    fn what_is_clipped_or_faint_is_looked_through() {
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
                pick_point(&cloud, &camera, Vec2::splat(50.0), 4.0, appearance, clip)
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
