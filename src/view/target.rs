//! Render targets of the 3-D view, pipeline creation and the eye-dome lighting pass.

use bytemuck::{Pod, Zeroable};
use wgpu::util::DeviceExt;

use super::{Projection, ViewCamera};

/// A device and its queue.
pub(super) struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
}

/// The textures of the 3-D view.
pub(super) struct Target {
    /// Width in pixels.
    width: u32,
    /// Height in pixels.
    height: u32,
    /// The image before eye-dome lighting; opacity 0 means that the model is not drawn there.
    color: wgpu::TextureView,
    depth: wgpu::TextureView,
    /// The image that is shown.
    pub(super) lit: wgpu::TextureView,
    /// Inputs of the lighting pass.
    inputs: wgpu::BindGroup,
}

impl Target {
    /// Creates the textures for a camera's images, at least 1 × 1 pixel.
    pub(super) fn new(device: &wgpu::Device, dome: &EyeDome, camera: &ViewCamera) -> Self {
        let (width, height) = size_of_image(camera);
        let texture = |format, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("scene"),
                size: wgpu::Extent3d {
                    width,
                    height,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let read = wgpu::TextureUsages::TEXTURE_BINDING;
        let (color, depth) = (texture(COLOR_FORMAT, read), texture(DEPTH_FORMAT, read));
        let inputs = dome.inputs(device, &color, &depth);
        Self {
            width,
            height,
            color,
            depth,
            lit: texture(COLOR_FORMAT, read | wgpu::TextureUsages::COPY_SRC),
            inputs,
        }
    }

    /// Returns whether the textures have the size of a camera's images.
    pub(super) fn fits(&self, camera: &ViewCamera) -> bool {
        (self.width, self.height) == size_of_image(camera)
    }

    /// Runs the lighting pass into [`Self::lit`].
    pub(super) fn light(&self, encoder: &mut wgpu::CommandEncoder, dome: &EyeDome) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("eye-dome lighting"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.lit,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        dome.draw(&mut pass, &self.inputs);
    }

    /// Starts a pass that draws over `background`, or over the earlier content if it is `None`.
    pub(super) fn begin<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        background: Option<[u8; 3]>,
    ) -> wgpu::RenderPass<'e> {
        let load = background.map_or(wgpu::LoadOp::Load, |rgb| {
            let [r, g, b] = rgb.map(|channel| f64::from(channel) / 255.0);
            wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 0.0 })
        });
        let depth_load = if background.is_some() {
            wgpu::LoadOp::Clear(0.0)
        } else {
            wgpu::LoadOp::Load
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("scene"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load,
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations {
                    load: depth_load,
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}

/// Returns the width and height of a camera's images, in pixels, at least 1.
fn size_of_image(camera: &ViewCamera) -> (u32, u32) {
    (camera.width.max(1), camera.height.max(1))
}

/// Eye-dome lighting on the GPU: a pass over the image and its depths.
///
/// CPU twin: [`super::draw_cloud`].
pub(super) struct EyeDome {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    uniform: wgpu::Buffer,
}

/// Uniform of the lighting shader.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct DomeUniform {
    /// 0 means off.
    strength: f32,
    /// Orthographic views: extent of the depth buffer in multiples of the target's depth.
    ///
    /// 0 in perspective.
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
            &Primitives {
                buffers: &[],
                topology: wgpu::PrimitiveTopology::TriangleList,
            },
            false,
        );
        Self {
            pipeline,
            layout,
            uniform,
        }
    }

    /// Binds the image and its depths for the pass.
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

    /// Sets strength (0 means off) and camera for the next pass.
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

const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// The primitives that a pipeline draws.
pub(super) struct Primitives<'a> {
    /// Layouts of the vertex buffers.
    pub(super) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub(super) topology: wgpu::PrimitiveTopology,
}

/// Compiles a pipeline from the functions `vertex` and `fragment` of a shader.
///
/// `has_depth` enables the depth test, so that nearer primitives occlude farther ones.
pub(super) fn compiled(
    device: &wgpu::Device,
    groups: &[&wgpu::BindGroupLayout],
    shader: wgpu::ShaderModuleDescriptor<'_>,
    primitives: &Primitives<'_>,
    has_depth: bool,
) -> wgpu::RenderPipeline {
    let label = shader.label;
    let module = device.create_shader_module(shader);
    let groups: Vec<Option<&wgpu::BindGroupLayout>> =
        groups.iter().map(|&group| Some(group)).collect();
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label,
        bind_group_layouts: &groups,
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: primitives.buffers,
        },
        primitive: wgpu::PrimitiveState {
            topology: primitives.topology,
            ..Default::default()
        },
        depth_stencil: has_depth.then(|| wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(COLOR_FORMAT.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

const COLOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
