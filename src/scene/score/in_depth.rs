use glam::{DVec2, Vec3};
use rayon::prelude::*;

use crate::engine::job::{Progress, Stopped};
use crate::frames::FrameCamera;
use crate::geometry::{Camera, Pose};

/// The longer side in pixels at which pictures are compared, if they are not smaller.
const SIDE_PX: u32 = 640;
/// Points this near to a truth point in a picture, in pixels, are compared with it.
const NEAR_PX: f64 = 1.0;
/// A point is hidden by another at most so many pixels aside that is nearer by more than a share of the depth.
const TRUTH_HIDES_PX: usize = 4;
const RESULT_HIDES_PX: usize = 1;
const BEHIND: f32 = 0.02;

/// A picture's points: pixel positions and depths, by pixel.
struct Picture {
    width: usize,
    height: usize,
    /// First point of each pixel, then the number of all.
    starts: Vec<u32>,
    points: Vec<(DVec2, f32)>,
}

/// For each result point that a camera sees within a pixel of a truth point that it sees, how far they are apart in
/// depth (in cloud units). Hidden points do not count. Truth points are often too few to hide each other, so what the
/// result shows in front hides them too: a point that floats before a surface is not found out by that surface.
pub(super) fn depth_differences(
    truth: &[Vec3],
    result: &[Vec3],
    cameras: &[FrameCamera],
    progress: &Progress,
) -> Result<Vec<f32>, Stopped> {
    let of_camera = |camera: &FrameCamera| {
        progress.check()?;
        let Some(pose) = &camera.camera_from_world else { return Ok(Vec::new()) };
        let small = shrunk(&camera.intrinsics);
        let seen_result = Picture::new(result, &small, pose).front(RESULT_HIDES_PX);
        let seen_truth = Picture::new(truth, &small, pose).front(TRUTH_HIDES_PX).before(&seen_result, RESULT_HIDES_PX);
        Ok(seen_result.points.iter().filter_map(|&(at_px, depth)| seen_truth.difference(at_px, depth)).collect())
    };
    let all: Vec<Vec<f32>> = cameras.par_iter().map(of_camera).collect::<Result<_, Stopped>>()?;
    Ok(all.concat())
}

fn shrunk(camera: &Camera) -> Camera {
    let ratio = (f64::from(SIDE_PX) / f64::from(camera.width.max(camera.height))).min(1.0);
    let side = |length: u32| ((f64::from(length) * ratio).ceil() as u32).max(1);
    Camera {
        width: side(camera.width),
        height: side(camera.height),
        focal_px: camera.focal_px * ratio,
        principal_px: camera.principal_px * ratio,
        ..*camera
    }
}

impl Picture {
    fn new(points: &[Vec3], camera: &Camera, pose: &Pose) -> Self {
        let see = |point: &Vec3| {
            let x_in_camera = pose.transform(point.as_dvec3());
            let at_px = camera.project(x_in_camera).filter(|&at_px| camera.contains(at_px))?;
            Some((at_px, x_in_camera.z as f32))
        };
        let seen: Vec<(DVec2, f32)> = points.iter().filter_map(see).collect();
        Self::of(camera.width as usize, camera.height as usize, seen)
    }

    fn of(width: usize, height: usize, mut points: Vec<(DVec2, f32)>) -> Self {
        let pixel = |&(at_px, _): &(DVec2, f32)| at_px.y as usize * width + at_px.x as usize;
        points.sort_by_key(pixel);
        let starts = (0..=width * height).map(|at| points.partition_point(|point| pixel(point) < at) as u32).collect();
        Self { width, height, starts, points }
    }

    /// The points in the pixels at most `reach` aside.
    fn around(&self, at_px: DVec2, reach: usize) -> impl Iterator<Item = &(DVec2, f32)> {
        let (x, y) = (at_px.x as usize, at_px.y as usize);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(self.width);
        (y.saturating_sub(reach)..(y + reach + 1).min(self.height)).flat_map(move |row| {
            let first = self.starts[row * self.width + columns.start] as usize;
            let last = self.starts[row * self.width + columns.end] as usize;
            &self.points[first..last]
        })
    }

    /// Without the points that others of it hide.
    fn front(&self, reach: usize) -> Self {
        self.before(self, reach)
    }

    /// Without the points that those of another hide.
    fn before(&self, other: &Self, reach: usize) -> Self {
        let hidden = |&&(at_px, depth): &&(DVec2, f32)| {
            other.around(at_px, reach).any(|&(_, nearer)| depth > nearer * (1.0 + BEHIND))
        };
        let seen = self.points.iter().filter(|point| !hidden(point)).copied().collect();
        Self::of(self.width, self.height, seen)
    }

    /// How far a depth is from that of the nearest point within a pixel.
    fn difference(&self, at_px: DVec2, depth: f32) -> Option<f32> {
        let near = self.around(at_px, 1).map(|&(other, there)| (other.distance(at_px), (depth - there).abs()));
        let nearest = near.filter(|&(aside, _)| aside <= NEAR_PX).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|(_, difference)| difference)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hidden_points_do_not_count() {
        let intrinsics = Camera::pinhole(1280, 960, 1000.0, 1000.0, 640.0, 480.0);
        let camera = FrameCamera::given(intrinsics, Some(Pose::default()));
        // Ten pixels of the shrunk picture apart.
        let row = |depth: f32| (0..20).map(move |i| Vec3::new((0.02 * i as f32 - 0.2) * depth, 0.0, depth));
        let truth: Vec<Vec3> = row(2.0).chain(row(3.0)).collect();
        let mut result: Vec<Vec3> = row(2.01).chain(row(3.5)).collect();
        let differences = |result: &[Vec3]| {
            let mut all = depth_differences(&truth, result, &[camera], &Progress::default()).unwrap();
            all.sort_by(f32::total_cmp);
            all
        };
        let seen = differences(&result);
        assert_eq!(seen.len(), 20, "what lies behind is hidden");
        assert!(seen.iter().all(|difference| (difference - 0.01).abs() < 1e-4), "{seen:?}");
        result.push(Vec3::new(0.0, 0.0, 1.97));
        let seen = differences(&result);
        assert!((seen[seen.len() - 1] - 0.03).abs() < 1e-4, "it stands a little before one of them: {seen:?}");
        result.push(Vec3::new(0.1, 0.0, 1.0));
        assert_eq!(differences(&result).len(), seen.len() - 1, "one of them is hidden");
    }
}
