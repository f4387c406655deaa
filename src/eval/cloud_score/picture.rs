use glam::{DVec2, Vec3};

use ostra_frames::FrameCamera;
use ostra_geometry::Camera;

/// The longer side in pixels that pictures are reduced to, if they are not smaller: points lie close enough there to hide
/// each other.
const SIDE_PX: f64 = 640.0;
/// A point is hidden by another that is nearer by more than this share of the depth.
const BEHIND: f32 = 0.02;

/// A point as a camera sees it.
#[derive(Clone, Copy)]
pub(super) struct Dot {
    pub at_px: DVec2,
    /// Along the optical axis, in cloud units.
    pub depth: f32,
    /// Place in the cloud.
    pub index: u32,
}

/// The points that lie inside a camera's picture, by pixel.
pub(super) struct Picture {
    width: usize,
    height: usize,
    /// First dot of each pixel, then the number of all.
    starts: Vec<u32>,
    pub dots: Vec<Dot>,
    /// A pixel of the camera's own picture, in pixels of this one; at most 1.
    pub own_px: f64,
}

impl Picture {
    /// Empty without a pose.
    pub fn new(points: &[Vec3], camera: &FrameCamera) -> Self {
        let own_px =
            (SIDE_PX / f64::from(camera.intrinsics.width.max(camera.intrinsics.height))).min(1.0);
        let small = shrunk(&camera.intrinsics, own_px);
        let see = |(index, point): (usize, &Vec3)| {
            let x_in_camera = camera.camera_from_world?.transform(point.as_dvec3());
            let at_px = small
                .project(x_in_camera)
                .filter(|&at_px| small.contains(at_px))?;
            Some(Dot {
                at_px,
                depth: x_in_camera.z as f32,
                index: index as u32,
            })
        };
        let dots = points.iter().enumerate().filter_map(see).collect();
        Self::of(small.width as usize, small.height as usize, own_px, dots)
    }

    fn of(width: usize, height: usize, own_px: f64, mut dots: Vec<Dot>) -> Self {
        let pixel = |dot: &Dot| dot.at_px.y as usize * width + dot.at_px.x as usize;
        dots.sort_by_key(pixel);
        let starts = (0..=width * height)
            .map(|at| dots.partition_point(|dot| pixel(dot) < at) as u32)
            .collect();
        Self {
            width,
            height,
            starts,
            dots,
            own_px,
        }
    }

    /// The dots in the pixels at most `reach` aside.
    pub fn around(&self, at_px: DVec2, reach: usize) -> impl Iterator<Item = &Dot> {
        let (x, y) = (at_px.x as usize, at_px.y as usize);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(self.width);
        (y.saturating_sub(reach)..(y + reach + 1).min(self.height)).flat_map(move |row| {
            let first = self.starts[row * self.width + columns.start] as usize;
            let last = self.starts[row * self.width + columns.end] as usize;
            &self.dots[first..last]
        })
    }

    /// Without the dots that others of it, in the pixels at most `reach` aside, hide.
    pub fn front(&self, reach: usize) -> Self {
        self.before(self, reach)
    }

    /// Without the dots that those of another, in the pixels at most `reach` aside, hide.
    pub fn before(&self, other: &Self, reach: usize) -> Self {
        self.only(|dot| {
            !other
                .around(dot.at_px, reach)
                .any(|nearer| dot.depth > nearer.depth * (1.0 + BEHIND))
        })
    }

    /// The dots for which that holds.
    pub fn only(&self, holds: impl Fn(&Dot) -> bool) -> Self {
        let dots = self.dots.iter().filter(|dot| holds(dot)).copied().collect();
        Self::of(self.width, self.height, self.own_px, dots)
    }
}

fn shrunk(camera: &Camera, ratio: f64) -> Camera {
    let side = |length: u32| ((f64::from(length) * ratio).ceil() as u32).max(1);
    Camera {
        width: side(camera.width),
        height: side(camera.height),
        focal_px: camera.focal_px * ratio,
        principal_px: camera.principal_px * ratio,
        ..*camera
    }
}
