//! Picking of points and camera frustums under the pointer, with a background thread for points.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::paint::Paint;
use super::point_lod::outside_job_pool;
use super::spread_order::SpreadOrder;
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

/// Distance in pixels within which a point needs neighbours at its depth to be of a surface.
const AROUND_PX: f32 = 20.0;
/// Largest difference in depth between neighbours on a surface, as a share of the distance.
const SAME_DEPTH: f32 = 0.05;
/// Number of neighbours below which a point is lone.
const FEW: usize = 3;

/// Returns the index of the visible point at a pixel position.
///
/// Candidates are the drawn points within the radius. Only those with the highest opacity count,
/// so that faint points are picked only where there is nothing else. A lone point, without
/// neighbours at its depth, is picked only if there is no surface behind it. Among points at most
/// 1 % farther than the nearest other one, the one closest to the position wins. Hidden and clipped
/// points are ignored.
#[must_use]
pub fn pick_point(cloud: &LabelledCloud, request: &PickRequest) -> Option<usize> {
    let PickRequest {
        camera,
        appearance,
        clip,
        radius_px,
        ..
    } = request;
    let paint = Paint::new(cloud, appearance);
    let reach = radius_px.max(AROUND_PX);
    let seen: Vec<Seen> = cloud
        .positions
        .par_iter()
        .enumerate()
        .filter_map(|(index, &x)| {
            let (at_px, depth) = camera.project(x)?;
            let off_px = at_px.distance(request.at_px);
            if off_px > reach || !clip.contains(x) {
                return None;
            }
            let opacity = Some(paint.opacity(cloud, index)).filter(|&opacity| opacity > 0)?;
            Some(Seen {
                index,
                at_px,
                depth,
                off_px,
                opacity,
            })
        })
        .collect();
    let hits = || seen.iter().filter(|hit| hit.off_px <= *radius_px);
    let most = hits().map(|hit| hit.opacity).max()?;
    let mut solid: Vec<&Seen> = hits().filter(|hit| hit.opacity == most).collect();
    solid.sort_by(|a, b| a.depth.total_cmp(&b.depth).then(a.index.cmp(&b.index)));
    let is_of_surface = |hit: &&&Seen| {
        let neighbours = seen.iter().filter(|other| {
            other.at_px.distance(hit.at_px) <= AROUND_PX
                && camera.farther_by(other.depth, hit.depth).abs() <= SAME_DEPTH
        });
        neighbours.take(FEW + 1).count() > FEW
    };
    let nearest = solid.iter().find(is_of_surface).or(solid.first())?.depth;
    solid
        .iter()
        .filter(|hit| (0.0..=0.01).contains(&camera.farther_by(hit.depth, nearest)))
        .min_by(|a, b| a.off_px.total_cmp(&b.off_px).then(a.index.cmp(&b.index)))
        .map(|hit| hit.index)
}

/// A drawn point near the position.
struct Seen {
    index: usize,
    at_px: Vec2,
    depth: f32,
    /// Distance from the position.
    off_px: f32,
    opacity: u8,
}

/// Returns whether any point lies in the image of a camera, drawn or not.
///
/// Most images show a point among the first that are tried, which are spread over the cloud.
#[must_use]
pub fn is_any_in_view(positions: &[Vec3], camera: &ViewCamera) -> bool {
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let order = SpreadOrder::new(positions.len());
    (0..positions.len()).any(|place| {
        let at = camera.project(positions[order.at(place)]);
        at.is_some_and(|(px, _)| px.cmpge(Vec2::ZERO).all() && px.cmplt(size).all())
    })
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
    /// Returns a wall of points, one point in front of its middle, and a camera 4 units before it.
    fn wall_behind_a_lone_point() -> (LabelledCloud, ViewCamera) {
        let wall = (0..1600).map(|at| {
            Vec3::new(
                (at % 40) as f32 * 0.05 - 1.0,
                (at / 40) as f32 * 0.05 - 1.0,
                0.0,
            )
        });
        let positions = wall.chain([Vec3::NEG_Z]).collect();
        let bounds = Bounds {
            min: Vec3::splat(-1.0),
            max: Vec3::ONE,
        };
        let orbit = Orbit::framing(&bounds, Vec3::Z, Vec3::NEG_Y);
        (
            LabelledCloud::from_positions(positions),
            orbit.camera(400, 400),
        )
    }

    fn middle(camera: ViewCamera) -> PickRequest {
        PickRequest {
            camera,
            appearance: Appearance::default(),
            clip: Clip::default(),
            at_px: Vec2::splat(200.0),
            radius_px: 5.0,
        }
    }

    #[test]
    fn surface_is_picked_through_a_lone_point() {
        let (cloud, camera) = wall_behind_a_lone_point();
        let lone = cloud.len() - 1;
        let picked = pick_point(&cloud, &middle(camera)).unwrap();
        assert_ne!(picked, lone);
        assert!(cloud.positions[picked].length() < 0.08, "{picked}");
        let alone = LabelledCloud::from_positions(vec![cloud.positions[lone]]);
        assert_eq!(
            pick_point(&alone, &middle(camera)),
            Some(0),
            "nothing is behind it"
        );
        let mut near = cloud.positions.clone();
        near.extend((0..9).map(|at| {
            Vec3::new((at % 3) as f32 * 0.05, (at / 3) as f32 * 0.05, 0.0) + Vec3::NEG_Z
        }));
        let near = LabelledCloud::from_positions(near);
        let picked = pick_point(&near, &middle(camera)).unwrap();
        assert!(picked >= lone, "a small surface hides the wall: {picked}");
    }

    #[test]
    fn points_left_of_the_image_and_behind_the_camera_are_not_in_view() {
        let (cloud, camera) = wall_behind_a_lone_point();
        assert!(is_any_in_view(&cloud.positions, &camera));
        assert!(!is_any_in_view(&[], &camera));
        let behind = camera.unproject(Vec2::splat(200.0), -2.0);
        let lateral = camera.unproject(Vec2::new(-30.0, 200.0), 2.0);
        assert!(!is_any_in_view(&[behind, lateral], &camera));
        assert!(is_any_in_view(&[behind, lateral, Vec3::ZERO], &camera));
    }
}
