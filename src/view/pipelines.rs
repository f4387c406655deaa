use wgpu::util::DeviceExt;

use super::growths::Growths;
use super::lines::Line;
use super::planes::Planes;
use super::points::{EyeUniform, PointInstance};
use super::surface_chunks::SurfaceVertex;

pub(super) const COLOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

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

/// The functions `vertex` and `fragment` of a shader, drawing vertices as they lie in memory; with `has_depth` what is drawn
/// hides what lies behind it.
pub(super) fn compiled(
    device: &wgpu::Device,
    groups: &[&wgpu::BindGroupLayout],
    shader: wgpu::ShaderModuleDescriptor<'_>,
    (buffers, topology): (
        &[Option<wgpu::VertexBufferLayout<'_>>],
        wgpu::PrimitiveTopology,
    ),
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
            buffers,
        },
        primitive: wgpu::PrimitiveState {
            topology,
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
