use std::ops::Range;
use std::time::{Duration, Instant};

use super::buffer::Buffer;
use super::device::{Device, GpuError};

/// How a program uses a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Binding {
    /// `var<uniform>`.
    Uniform,
    /// `var<storage, read>`.
    Read,
    /// `var<storage, read_write>`.
    ReadWrite,
}

/// Compiled WGSL whose entry points share the buffers `@group(0) @binding(0)` and on.
#[derive(Debug)]
pub struct Program {
    label: &'static str,
    module: wgpu::ShaderModule,
    buffers: wgpu::BindGroupLayout,
    layout: wgpu::PipelineLayout,
}

/// One entry point of a program, ready to run.
#[derive(Debug)]
pub struct Kernel {
    pipeline: wgpu::ComputePipeline,
}

/// The buffers that a kernel works on.
#[derive(Debug)]
pub struct Bindings {
    group: wgpu::BindGroup,
}

/// Work submitted to the device.
#[derive(Debug)]
pub struct Submission(wgpu::SubmissionIndex);

impl Device {
    /// Compiles WGSL.
    ///
    /// # Errors
    /// Returns the compiler's error.
    pub fn program(
        &self,
        label: &'static str,
        wgsl: &str,
        bindings: &[Binding],
    ) -> Result<Program, GpuError> {
        let source = wgpu::ShaderSource::Wgsl(wgsl.into());
        let module = self
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source,
            });
        let entries: Vec<_> = (0..)
            .zip(bindings)
            .map(|(binding, kind)| entry(binding, *kind))
            .collect();
        let buffers = self
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries: &entries,
            });
        let layout = self
            .device
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: &[Some(&buffers)],
                immediate_size: 0,
            });
        self.check()?;
        Ok(Program {
            label,
            module,
            buffers,
            layout,
        })
    }

    /// Prepares an entry point of a program.
    ///
    /// # Errors
    /// Returns the driver's error.
    pub fn kernel(&self, program: &Program, entry_point: &str) -> Result<Kernel, GpuError> {
        let pipeline = self
            .device
            .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(program.label),
                layout: Some(&program.layout),
                module: &program.module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            });
        self.check()?;
        Ok(Kernel { pipeline })
    }

    /// Binds buffers in the order of the program's bindings.
    ///
    /// # Errors
    /// Returns the driver's error.
    pub fn bind(&self, program: &Program, buffers: &[&Buffer]) -> Result<Bindings, GpuError> {
        let resources = buffers
            .iter()
            .map(|buffer| buffer.buffer.as_entire_binding());
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(program.label),
            layout: &program.buffers,
            entries: &entries,
        });
        self.check()?;
        Ok(Bindings { group })
    }

    /// Submits `groups` workgroups (columns, rows) without waiting for them.
    ///
    /// # Errors
    /// Returns the driver's error.
    pub fn submit(
        &self,
        kernel: &Kernel,
        bindings: &Bindings,
        groups: [u32; 2],
    ) -> Result<Submission, GpuError> {
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&kernel.pipeline);
            pass.set_bind_group(0, &bindings.group, &[]);
            pass.dispatch_workgroups(groups[0], groups[1], 1);
        }
        let submission = self.queue.submit([encoder.finish()]);
        self.check()?;
        Ok(Submission(submission))
    }

    /// Waits until a submission and all earlier ones have finished.
    ///
    /// # Errors
    /// Returns the driver's error, or [`GpuError::NoAnswer`] after two minutes.
    pub fn wait(&self, submission: Submission) -> Result<(), GpuError> {
        self.wait_for(submission.0)
    }
}

fn entry(binding: u32, kind: Binding) -> wgpu::BindGroupLayoutEntry {
    let ty = match kind {
        Binding::Uniform => wgpu::BufferBindingType::Uniform,
        Binding::Read => wgpu::BufferBindingType::Storage { read_only: true },
        Binding::ReadWrite => wgpu::BufferBindingType::Storage { read_only: false },
    };
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }
}

/// Target duration of a piece.
///
/// At this duration, a display on the same card stays responsive, no driver considers it hung, and
/// a stop takes effect at once.
const AIM: Duration = Duration::from_millis(20);

/// Size of the work that [`Pieces`] divides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WorkSize {
    /// Number of items in a row.
    pub width: u32,
    /// Number of rows.
    pub rows: u32,
    /// Pieces have a multiple of this many rows; at least 1.
    pub grain: u32,
}

/// Divides long work into pieces whose size adapts to the duration of earlier pieces.
#[derive(Debug)]
pub struct Pieces {
    items: u64,
}

impl Default for Pieces {
    /// Starts with small pieces.
    fn default() -> Self {
        Self { items: 1 << 12 }
    }
}

impl Pieces {
    /// Runs work piece by piece, and waits for the end.
    ///
    /// `submit` submits a range of rows; `check` is called before each piece.
    ///
    /// # Errors
    /// Returns the errors of `submit` and `check`, or the driver's error.
    pub fn run<E: From<GpuError>>(
        &mut self,
        device: &Device,
        size: WorkSize,
        mut submit: impl FnMut(Range<u32>) -> Result<Submission, GpuError>,
        mut check: impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let WorkSize { width, rows, grain } = size;
        let mut first = 0;
        let mut last_wait = Instant::now();
        let mut under_way: Option<Submission> = None;
        while first < rows {
            check()?;
            let count = (self.items / u64::from(width.max(1))).clamp(1, u64::from(rows)) as u32;
            let end = first
                .saturating_add(count.next_multiple_of(grain))
                .min(rows);
            let submission = submit(first..end)?;
            // One piece is queued while another is running, so that the device is never idle.
            if let Some(before) = under_way.replace(submission) {
                device.wait(before)?;
                self.adapt(last_wait.elapsed());
                last_wait = Instant::now();
            }
            first = end;
        }
        under_way.map_or(Ok(()), |last| device.wait(last))?;
        Ok(())
    }

    fn adapt(&mut self, took: Duration) {
        if took < AIM / 2 {
            self.items = (self.items * 2).min(1 << 24);
        } else if took > AIM * 2 {
            self.items = (self.items / 2).max(1 << 8);
        }
    }
}
