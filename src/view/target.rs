use super::eye_dome::EyeDome;
use super::pipelines::{COLOR_FORMAT, DEPTH_FORMAT};

/// The textures that the 3-D view is drawn into.
pub(super) struct Target {
    pub(super) size: (u32, u32),
    /// The picture before eye-dome lighting; opacity 0 = nothing of the model.
    color: wgpu::TextureView,
    depth: wgpu::TextureView,
    /// The picture that is shown.
    pub(super) lit: wgpu::TextureView,
    /// What lighting reads.
    inputs: wgpu::BindGroup,
}

impl Target {
    pub(super) fn new(device: &wgpu::Device, dome: &EyeDome, size: (u32, u32)) -> Self {
        let texture = |format, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("scene"),
                size: wgpu::Extent3d {
                    width: size.0,
                    height: size.1,
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
            size,
            color,
            depth,
            lit: texture(COLOR_FORMAT, read | wgpu::TextureUsages::COPY_SRC),
            inputs,
        }
    }

    /// Lights what was drawn, into [`Self::lit`].
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

    /// Begins a pass over what was drawn before, or over `background` where one is given.
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
