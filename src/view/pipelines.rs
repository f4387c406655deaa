//! The shaders of points, lines and surfaces, and the vertices and uniforms that they read.

use bytemuck::{Pod, Zeroable};
use wgpu::util::DeviceExt;

use super::frame_shapes::{Line, Planes};
use super::target::compiled;

/// The compiled shaders with the uniform that they share.
pub(super) struct Pipelines {
    pub points: wgpu::RenderPipeline,
    pub lines: wgpu::RenderPipeline,
    pub surface: wgpu::RenderPipeline,
    pub edges: wgpu::RenderPipeline,
    pub planes: Planes,
    pub growths: Growths,
    pub eye: wgpu::Buffer,
    pub bindings: wgpu::BindGroup,
}

/// What a pipeline draws and how its vertices lie in memory.
struct Shape {
    topology: wgpu::PrimitiveTopology,
    step_mode: wgpu::VertexStepMode,
    stride: usize,
    attributes: &'static [wgpu::VertexAttribute],
}

const DISCS: Shape = Shape {
    topology: wgpu::PrimitiveTopology::TriangleStrip,
    step_mode: wgpu::VertexStepMode::Instance,
    stride: size_of::<PointInstance>(),
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4, 2 => Float32],
};
const LINES: Shape = Shape {
    topology: wgpu::PrimitiveTopology::LineList,
    step_mode: wgpu::VertexStepMode::Vertex,
    stride: size_of::<Line>(),
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4],
};
const TRIANGLES: Shape = Shape {
    topology: wgpu::PrimitiveTopology::TriangleList,
    step_mode: wgpu::VertexStepMode::Vertex,
    stride: size_of::<SurfaceVertex>(),
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4, 2 => Snorm16x4],
};
const EDGES: Shape = Shape {
    topology: wgpu::PrimitiveTopology::LineList,
    ..TRIANGLES
};

impl Pipelines {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("eye"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let eye = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("eye"),
            contents: bytemuck::bytes_of(&<EyeUniform as bytemuck::Zeroable>::zeroed()),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        });
        let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("eye"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: eye.as_entire_binding(),
            }],
        });
        let growths = Growths::new(device);
        let made = |shader, shape| pipeline(device, &[&layout], shader, shape);
        let surface = || wgpu::include_wgsl!("shaders/surface.wgsl");
        Self {
            points: pipeline(
                device,
                &[&layout, &growths.layout],
                wgpu::include_wgsl!("shaders/points.wgsl"),
                &DISCS,
            ),
            lines: made(wgpu::include_wgsl!("shaders/lines.wgsl"), &LINES),
            surface: made(surface(), &TRIANGLES),
            edges: made(surface(), &EDGES),
            planes: Planes::new(device, &layout),
            growths,
            eye,
            bindings,
        }
    }
}

fn pipeline(
    device: &wgpu::Device,
    groups: &[&wgpu::BindGroupLayout],
    shader: wgpu::ShaderModuleDescriptor<'_>,
    shape: &Shape,
) -> wgpu::RenderPipeline {
    let vertices = wgpu::VertexBufferLayout {
        array_stride: shape.stride as u64,
        step_mode: shape.step_mode,
        attributes: shape.attributes,
    };
    compiled(
        device,
        groups,
        shader,
        (&[Some(vertices)], shape.topology),
        true,
    )
}

/// Levels of growth, from 1 to 32 times the radius.
const LEVELS: u32 = 41;
/// Levels between a radius and its double.
const PER_DOUBLE: f32 = 8.0;

/// How much larger discs are drawn where only a part of the points is, so that surfaces stay closed. One level is chosen
/// per draw call.
pub(super) struct Growths {
    pub layout: wgpu::BindGroupLayout,
    levels: wgpu::BindGroup,
    step: u32,
}

impl Growths {
    pub fn new(device: &wgpu::Device) -> Self {
        let step = device.limits().min_uniform_buffer_offset_alignment.max(16);
        let mut contents = vec![0.0_f32; (LEVELS * step) as usize / size_of::<f32>()];
        for (level, growth) in contents
            .chunks_mut(step as usize / size_of::<f32>())
            .enumerate()
        {
            growth[0] = (level as f32 / PER_DOUBLE).exp2();
        }
        let buffer = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("growth of discs"),
            contents: bytemuck::cast_slice(&contents),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let size = wgpu::BufferSize::new(16);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("growth of discs"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: true,
                    min_binding_size: size,
                },
                count: None,
            }],
        });
        let binding = wgpu::BufferBinding {
            buffer: &buffer,
            offset: 0,
            size,
        };
        let levels = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("growth of discs"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(binding),
            }],
        });
        Self {
            layout,
            levels,
            step,
        }
    }

    /// Binds to group 1 what `drawn` (above 0) points of `all` need: on a surface, the root of how many fewer they are.
    pub fn bind(&self, pass: &mut wgpu::RenderPass<'_>, drawn: usize, all: usize) {
        pass.set_bind_group(1, &self.levels, &[level(drawn, all) * self.step]);
    }
}

fn level(drawn: usize, all: usize) -> u32 {
    let growth = (all as f32 / drawn.max(1) as f32).sqrt();
    ((growth.log2() * PER_DOUBLE).round() as u32).min(LEVELS - 1)
}

/// One vertex on the GPU.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SurfaceVertex {
    pub position: [f32; 3],
    pub color: [u8; 4],
    /// As shares of 32767; the fourth is unused.
    pub normal: [i16; 4],
}

/// What all shaders know of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct EyeUniform {
    pub clip_from_world: [[f32; 4]; 4],
    /// Takes the inside of the clip box to the cube from -1 to 1.
    pub cube_from_world: [[f32; 4]; 4],
    /// Width and height in pixels, pixels per world unit at clip w = 1, one unused.
    pub view: [f32; 4],
    /// Smallest and largest disc radius in pixels, two unused.
    pub disc: [f32; 4],
    /// Where the camera is, and the light on a surface that is seen along itself.
    pub place: [f32; 4],
}

/// One point on the GPU; opacity 0 = not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct PointInstance {
    pub position: [f32; 3],
    pub color: [u8; 4],
    /// Of its disc where all points are drawn, in world units.
    pub radius: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_points_have_their_true_size_and_a_quarter_twice_it() {
        assert_eq!(
            [
                level(10, 10),
                level(25, 100),
                level(1, 16),
                level(1, 1_000_000)
            ],
            [0, 8, 16, LEVELS - 1]
        );
    }
}
