use bytemuck::{Pod, Zeroable};

use super::planes::frustum_corners;
use ostra_frames::Frame;
use ostra_reconstruct::rgbd::{FrameLink, LinkKind};

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
        let (Some((_, pose)), Some(corners)) = (frame.posed_camera(), frustum_corners(frame, size))
        else {
            continue;
        };
        let color = if current == Some(number) {
            [255, 170, 40, 255]
        } else {
            [120, 160, 210, 255]
        };
        let centre = pose.centre().as_vec3().to_array();
        for (index, &corner) in corners.iter().enumerate() {
            for end in [centre, corner, corner, corners[(index + 1) % 4]] {
                lines.push(Line {
                    position: end,
                    color,
                });
            }
        }
    }
    lines
}

/// A line between the cameras of every two linked frames: grey for odometry, green for loops and overlap, orange where
/// shapes were fitted, red where the other links contradict it.
#[must_use]
pub fn link_lines(frames: &[Frame], links: &[FrameLink]) -> Vec<Line> {
    let centre = |frame: usize| {
        Some(
            frames
                .get(frame)?
                .posed_camera()?
                .1
                .centre()
                .as_vec3()
                .to_array(),
        )
    };
    let line = |link: &FrameLink| {
        let color = match link.kind {
            _ if !link.holds => [230, 60, 50, 255],
            LinkKind::Odometry => [140, 140, 150, 255],
            LinkKind::Loop | LinkKind::Overlap => [70, 180, 90, 255],
            LinkKind::Shape => [240, 150, 40, 255],
        };
        Some(
            [centre(link.frames[0])?, centre(link.frames[1])?]
                .map(|position| Line { position, color }),
        )
    };
    links.iter().filter_map(line).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::{FrameCamera, PictureSource};
    use ostra_geometry::{Camera, Pose};

    #[test]
    fn a_link_is_a_line_between_the_cameras_that_both_frames_have() {
        let frame = |x: Option<f64>| {
            let pose = x.map(|x| Pose {
                translation: glam::DVec3::new(-x, 0.0, 0.0),
                ..Pose::IDENTITY
            });
            let picture = PictureSource::File {
                path: "a.png".into(),
                orientation: Default::default(),
            };
            let camera = Some(FrameCamera::given(
                Camera::pinhole(4, 3, 4.0, 4.0, 2.0, 1.5),
                pose,
            ));
            Frame {
                name: "a".into(),
                width: 4,
                height: 3,
                picture,
                depth: None,
                camera,
            }
        };
        let frames = [frame(Some(1.0)), frame(None), frame(Some(3.0))];
        let link = |a, b, holds| FrameLink {
            frames: [a, b],
            kind: LinkKind::Loop,
            consistent: 0.95,
            holds,
        };
        let lines = link_lines(
            &frames,
            &[link(0, 1, true), link(0, 2, true), link(0, 2, false)],
        );
        let ends: Vec<f32> = lines.iter().map(|line| line.position[0]).collect();
        assert_eq!(
            ends,
            [1.0, 3.0, 1.0, 3.0],
            "the frame without a camera has no line"
        );
        assert!(lines[0].color[1] > lines[0].color[0] && lines[2].color[0] > lines[2].color[1]);
    }
}
