//! Render pipelines for points, lines and surfaces, with their vertex and uniform layouts.

use bytemuck::{Pod, Zeroable};
use wgpu::util::DeviceExt;

use super::frame_shapes::{LineVertex, Planes};
use super::target::{Primitives, compiled};

/// The compiled pipelines and the uniform that they share.
pub(super) struct Pipelines {
    pub points: wgpu::RenderPipeline,
    pub lines: wgpu::RenderPipeline,
    pub surface: wgpu::RenderPipeline,
    pub edges: wgpu::RenderPipeline,
    pub planes: Planes,
    pub splat_scales: Growths,
    pub eye: wgpu::Buffer,
    pub bindings: wgpu::BindGroup,
}

/// Primitive topology and vertex layout of a pipeline.
struct PrimitiveLayout {
    topology: wgpu::PrimitiveTopology,
    step_mode: wgpu::VertexStepMode,
    stride: usize,
    attributes: &'static [wgpu::VertexAttribute],
}

const DISCS: PrimitiveLayout = PrimitiveLayout {
    topology: wgpu::PrimitiveTopology::TriangleStrip,
    step_mode: wgpu::VertexStepMode::Instance,
    stride: size_of::<PointInstance>(),
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4, 2 => Float32],
};
const LINES: PrimitiveLayout = PrimitiveLayout {
    topology: wgpu::PrimitiveTopology::LineList,
    step_mode: wgpu::VertexStepMode::Vertex,
    stride: size_of::<LineVertex>(),
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4],
};
const TRIANGLES: PrimitiveLayout = PrimitiveLayout {
    topology: wgpu::PrimitiveTopology::TriangleList,
    step_mode: wgpu::VertexStepMode::Vertex,
    stride: size_of::<SurfaceVertex>(),
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4, 2 => Snorm16x4],
};
const EDGES: PrimitiveLayout = PrimitiveLayout {
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
        let splat_scales = Growths::new(device);
        let made = |shader, shape| pipeline(device, &[&layout], shader, shape);
        let surface = || wgpu::include_wgsl!("shaders/surface.wgsl");
        Self {
            points: pipeline(
                device,
                &[&layout, &splat_scales.layout],
                wgpu::include_wgsl!("shaders/points.wgsl"),
                &DISCS,
            ),
            lines: made(wgpu::include_wgsl!("shaders/lines.wgsl"), &LINES),
            surface: made(surface(), &TRIANGLES),
            edges: made(surface(), &EDGES),
            planes: Planes::new(device, &layout),
            splat_scales,
            eye,
            bindings,
        }
    }
}

fn pipeline(
    device: &wgpu::Device,
    groups: &[&wgpu::BindGroupLayout],
    shader: wgpu::ShaderModuleDescriptor<'_>,
    shape: &PrimitiveLayout,
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
        &Primitives {
            buffers: &[Some(vertices)],
            topology: shape.topology,
        },
        true,
    )
}

/// Number of disc growth levels, from 1 to 32 times the radius.
const LEVELS: u32 = 41;
/// Number of levels per doubling of the radius.
const PER_DOUBLE: f32 = 8.0;

/// Factors by which discs grow where only a part of the points is drawn.
///
/// Larger discs keep surfaces closed. One level is chosen per draw call.
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

    /// Binds the growth for `drawn` (above 0) of `all` points to group 1.
    ///
    /// On a surface the radius grows with the square root of `all / drawn`.
    pub fn bind(&self, pass: &mut wgpu::RenderPass<'_>, drawn: usize, all: usize) {
        pass.set_bind_group(1, &self.levels, &[level(drawn, all) * self.step]);
    }
}

fn level(drawn: usize, all: usize) -> u32 {
    let growth = (all as f32 / drawn.max(1) as f32).sqrt();
    ((growth.log2() * PER_DOUBLE).round() as u32).min(LEVELS - 1)
}

/// Surface vertex in GPU memory.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SurfaceVertex {
    pub position: [f32; 3],
    pub color: [u8; 4],
    /// Unit normal, scaled by 32767; the fourth component is unused.
    pub normal: [i16; 4],
}

/// Camera uniform of all shaders.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct EyeUniform {
    pub clip_from_world: [[f32; 4]; 4],
    /// Maps the inside of the clip box to the cube from -1 to 1.
    pub cube_from_world: [[f32; 4]; 4],
    /// Width and height in pixels, pixels per world unit at clip w = 1, one unused.
    pub view: [f32; 4],
    /// Minimum and maximum disc radius in pixels, two unused.
    pub disc: [f32; 4],
    /// xyz: camera position in world space; w: brightness of a surface that is seen edge-on.
    pub place: [f32; 4],
}

/// Point in GPU memory; a point with opacity 0 is not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct PointInstance {
    pub position: [f32; 3],
    pub color: [u8; 4],
    /// Disc radius in world units if all points are drawn.
    pub radius: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radius_doubles_when_a_quarter_of_the_points_is_drawn() {
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
