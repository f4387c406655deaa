use wgpu::util::DeviceExt;

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
