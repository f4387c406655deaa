use bytemuck::{Pod, Zeroable};
use wgpu::util::DeviceExt;

use super::pipelines::compiled;
use super::{Projection, ViewCamera};

/// Eye-dome lighting on the GPU: a pass over the picture and its depths. Twin: [`super::draw_cloud`].
pub(super) struct EyeDome {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    uniform: wgpu::Buffer,
}

/// What the shader knows.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct DomeUniform {
    /// 0 = off.
    strength: f32,
    /// Orthographic views: how many times the target's depth the depth buffer spans; 0 in perspective.
    span: f32,
    unused: [f32; 2],
}

impl EyeDome {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let texture = |binding, sample_type| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type,
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("eye-dome lighting"),
            entries: &[
                texture(0, wgpu::TextureSampleType::Float { filterable: false }),
                texture(1, wgpu::TextureSampleType::Depth),
                wgpu::BindGroupLayoutEntry {
                    binding: 2,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                    count: None,
                },
            ],
        });
        let uniform = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("eye-dome lighting"),
            contents: bytemuck::bytes_of(&DomeUniform::zeroed()),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        });
        let shader = wgpu::include_wgsl!("shaders/edl.wgsl");
        let pipeline = compiled(
            device,
            &[&layout],
            shader,
            (&[], wgpu::PrimitiveTopology::TriangleList),
            false,
        );
        Self {
            pipeline,
            layout,
            uniform,
        }
    }

    /// What the pass reads: a picture and its depths.
    pub(super) fn inputs(
        &self,
        device: &wgpu::Device,
        color: &wgpu::TextureView,
        depth: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("eye-dome lighting"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(color),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(depth),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: self.uniform.as_entire_binding(),
                },
            ],
        })
    }

    /// Sets strength (0 = off) and camera for the next pass.
    pub(super) fn set(&self, queue: &wgpu::Queue, strength: f32, camera: &ViewCamera) {
        let span = match camera.projection {
            Projection::Perspective => 0.0,
            Projection::Orthographic { .. } => 2.0 * ViewCamera::REACH,
        };
        let uniform = DomeUniform {
            strength,
            span,
            unused: [0.0; 2],
        };
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, inputs: &wgpu::BindGroup) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, inputs, &[]);
        pass.draw(0..3, 0..1);
    }
}
