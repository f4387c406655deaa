use wgpu::util::DeviceExt;

use super::points::EyeUniform;

pub(super) const COLOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// The compiled shaders with the uniform that they share.
pub(super) struct Pipelines {
    pub points: wgpu::RenderPipeline,
    pub lines: wgpu::RenderPipeline,
    pub eye: wgpu::Buffer,
    pub bindings: wgpu::BindGroup,
}

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
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: eye.as_entire_binding() }],
        });
        let points = pipeline(device, &layout, wgpu::include_wgsl!("shaders/points.wgsl"), true);
        let lines = pipeline(device, &layout, wgpu::include_wgsl!("shaders/lines.wgsl"), false);
        Self { points, lines, eye, bindings }
    }
}

fn pipeline(
    device: &wgpu::Device,
    bindings: &wgpu::BindGroupLayout,
    shader: wgpu::ShaderModuleDescriptor<'_>,
    discs: bool,
) -> wgpu::RenderPipeline {
    let label = shader.label;
    let module = device.create_shader_module(shader);
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label,
        bind_group_layouts: &[Some(bindings)],
        immediate_size: 0,
    });
    let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4];
    let (step_mode, topology) = if discs {
        (wgpu::VertexStepMode::Instance, wgpu::PrimitiveTopology::TriangleStrip)
    } else {
        (wgpu::VertexStepMode::Vertex, wgpu::PrimitiveTopology::LineList)
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(wgpu::VertexBufferLayout { array_stride: 16, step_mode, attributes: &attributes })],
        },
        primitive: wgpu::PrimitiveState { topology, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
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
