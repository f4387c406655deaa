use bytemuck::{Pod, Zeroable};
use glam::{DVec2, Vec3};

use crate::frames::Frame;

/// A line in world space, ready for the GPU: two of these per segment.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Line {
    /// End of the segment in world space.
    pub position: [f32; 3],
    /// sRGB and opacity.
    pub color: [u8; 4],
}

/// The frusta of all frames with a camera, `size` deep in world units; frame `current` is drawn in the accent colour.
#[must_use]
pub fn frustum_lines(frames: &[Frame], size: f32, current: Option<usize>) -> Vec<Line> {
    let mut lines = Vec::new();
    for (number, frame) in frames.iter().enumerate() {
        let Some((camera, pose)) = frame.posed_camera() else { continue };
        let color = if current == Some(number) { [255, 170, 40, 255] } else { [120, 160, 210, 255] };
        let world_from_camera = pose.inverse();
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let corners: [Vec3; 4] = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)].map(|(x, y)| {
            let ray = camera.unproject(DVec2::new(x, y)).extend(1.0) * f64::from(size);
            world_from_camera.transform(ray).as_vec3()
        });
        let centre = pose.centre().as_vec3();
        for (index, &corner) in corners.iter().enumerate() {
            for end in [centre, corner, corner, corners[(index + 1) % 4]] {
                lines.push(Line { position: end.to_array(), color });
            }
        }
    }
    lines
}
