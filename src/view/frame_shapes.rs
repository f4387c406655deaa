//! Frames in the 3-D scene: camera frustums, links between cameras and image planes.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec2;
use wgpu::util::DeviceExt;

use super::target::{Primitives, compiled};
use ostra_frames::{Frame, Image};
use ostra_reconstruct::rgbd::{FrameLink, LinkKind};

/// An image placed in the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ImagePlane {
    /// World positions of the corners: top left, top right, bottom right, bottom left.
    pub corners: [[f32; 3]; 4],
    /// The image shown on the plane.
    pub image: Arc<Image>,
}

impl ImagePlane {
    /// Places a frame's image at `depth` (world units) in front of its camera.
    ///
    /// Returns `None` if the pose is unknown.
    #[must_use]
    pub fn of_frame(frame: &Frame, depth: f32, image: Arc<Image>) -> Option<Self> {
        Some(Self {
            corners: frustum_corners(frame, depth)?,
            image,
        })
    }
}

/// Returns the corners of a frame's frustum at `depth` (world units) in front of its camera.
///
/// The order is top left, top right, bottom right, bottom left.
fn frustum_corners(frame: &Frame, depth: f32) -> Option<[[f32; 3]; 4]> {
    let (camera, pose) = frame.posed_camera()?;
    let world_from_camera = pose.inverse();
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let corner = |(x, y)| {
        let ray = camera.unproject(DVec2::new(x, y)).extend(1.0) * f64::from(depth);
        world_from_camera.transform(ray).as_vec3().to_array()
    };
    Some([(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)].map(corner))
}

/// Draws image planes; an image is uploaded once and kept while it is shown.
pub(super) struct Planes {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    kept: Vec<(Arc<Image>, wgpu::BindGroup)>,
}

/// Image planes on the GPU, ready to be drawn.
pub(super) struct Placed {
    corners: wgpu::Buffer,
    images: Vec<wgpu::BindGroup>,
}

#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct PlaneVertex {
    position: [f32; 3],
    /// Texture coordinates, 0–1 from the top left.
    at: [f32; 2],
}

impl Planes {
    /// Creates the pipeline; `eye` is the layout of the uniform that all scene shaders share.
    pub(super) fn new(device: &wgpu::Device, eye: &wgpu::BindGroupLayout) -> Self {
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let texture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: true },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let filtering = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("image plane"),
            entries: &[entry(0, texture), entry(1, filtering)],
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let vertices = wgpu::VertexBufferLayout {
            array_stride: size_of::<PlaneVertex>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x2],
        };
        let shader = wgpu::include_wgsl!("shaders/planes.wgsl");
        let pipeline = compiled(
            device,
            &[eye, &layout],
            shader,
            &Primitives {
                buffers: &[Some(vertices)],
                topology: wgpu::PrimitiveTopology::TriangleStrip,
            },
            true,
        );
        Self {
            pipeline,
            layout,
            sampler,
            kept: Vec::new(),
        }
    }

    /// Uploads planes; discards images that are on none of them.
    pub(super) fn place(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        planes: &[ImagePlane],
    ) -> Placed {
        let mut before = std::mem::take(&mut self.kept);
        for plane in planes {
            let known = before
                .iter()
                .position(|(image, _)| Arc::ptr_eq(image, &plane.image));
            let image = known.map_or_else(
                || {
                    (
                        Arc::clone(&plane.image),
                        self.image(device, queue, &plane.image),
                    )
                },
                |at| before.swap_remove(at),
            );
            self.kept.push(image);
        }
        let vertices: Vec<PlaneVertex> = planes.iter().flat_map(strip).collect();
        let corners = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("image planes"),
            contents: bytemuck::cast_slice(&vertices),
            usage: wgpu::BufferUsages::VERTEX,
        });
        Placed {
            corners,
            images: self.kept.iter().map(|(_, image)| image.clone()).collect(),
        }
    }

    /// Draws planes; the camera uniform must be bound to group 0.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, placed: &Placed) {
        pass.set_pipeline(&self.pipeline);
        pass.set_vertex_buffer(0, placed.corners.slice(..));
        for (number, image) in placed.images.iter().enumerate() {
            pass.set_bind_group(1, image, &[]);
            let first = number as u32 * 4;
            pass.draw(first..first + 4, 0..1);
        }
    }

    fn image(&self, device: &wgpu::Device, queue: &wgpu::Queue, image: &Image) -> wgpu::BindGroup {
        let pixels: Vec<[u8; 4]> = image
            .pixels
            .iter()
            .map(|&[r, g, b]| [r, g, b, 255])
            .collect();
        let texture = device.create_texture_with_data(
            queue,
            &wgpu::TextureDescriptor {
                label: Some("image plane"),
                size: wgpu::Extent3d {
                    width: image.width,
                    height: image.height,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rgba8Unorm,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
            wgpu::util::TextureDataOrder::LayerMajor,
            bytemuck::cast_slice(&pixels),
        );
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("image plane"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&view),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
            ],
        })
    }
}

/// Returns the corners in the order of a strip of two triangles.
fn strip(plane: &ImagePlane) -> [PlaneVertex; 4] {
    let [top_left, top_right, bottom_right, bottom_left] = plane.corners;
    [
        (top_left, [0.0, 0.0]),
        (top_right, [1.0, 0.0]),
        (bottom_left, [0.0, 1.0]),
        (bottom_right, [1.0, 1.0]),
    ]
    .map(|(position, at)| PlaneVertex { position, at })
}

/// One end of a line segment in GPU memory; two of these make a segment.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LineVertex {
    /// Position of the end in world space.
    pub position: [f32; 3],
    /// sRGB and opacity.
    pub color: [u8; 4],
}

/// Returns the frustums of all frames with a known pose, `size` deep in world units.
///
/// Frame `current` is drawn in the accent colour.
#[must_use]
pub fn frustum_lines(frames: &[Frame], size: f32, current: Option<usize>) -> Vec<LineVertex> {
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
                lines.push(LineVertex {
                    position: end,
                    color,
                });
            }
        }
    }
    lines
}

/// Returns a line between the cameras of each pair of linked frames.
///
/// Odometry is grey, loops and overlap are green, shape fits are orange. Links that the other links
/// contradict are red.
#[must_use]
pub fn link_lines(frames: &[Frame], links: &[FrameLink]) -> Vec<LineVertex> {
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
                .map(|position| LineVertex { position, color }),
        )
    };
    links.iter().filter_map(line).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::{FrameCamera, ImageSource};
    use ostra_geometry::{Camera, Pose};

    #[test]
    fn link_line_needs_a_pose_for_both_frames() {
        let frame = |x: Option<f64>| {
            let pose = x.map(|x| Pose {
                translation: glam::DVec3::new(-x, 0.0, 0.0),
                ..Pose::IDENTITY
            });
            let image = ImageSource::File {
                path: "a.png".into(),
                orientation: Default::default(),
            };
            let camera = Some(FrameCamera::given(
                Camera::pinhole(4, 3, [4.0, 4.0], [2.0, 1.5]),
                pose,
            ));
            Frame {
                name: "a".into(),
                width: 4,
                height: 3,
                image,
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
