use std::sync::Arc;

use ostra_compute::gpu::{Binding, Device, GpuError, Kernel, Program};

/// The parts of the program; WGSL accepts them in any order.
const PATCHMATCH: &str = concat!(
    include_str!("shaders/patchmatch/data.wgsl"),
    include_str!("shaders/patchmatch/random.wgsl"),
    include_str!("shaders/patchmatch/planes.wgsl"),
    include_str!("shaders/patchmatch/costs.wgsl"),
    include_str!("shaders/patchmatch/gather.wgsl"),
    include_str!("shaders/patchmatch/views.wgsl"),
    include_str!("shaders/patchmatch/contest.wgsl"),
    include_str!("shaders/patchmatch/entry.wgsl"),
);

/// The compiled passes and their device.
#[derive(Debug)]
pub struct Kernels {
    /// The device.
    pub device: Arc<Device>,
    /// The program of `score` and `sweep`.
    pub patchmatch: Program,
    /// Computes the costs of a field's hypotheses.
    pub score: Kernel,
    /// Runs an iteration over one colour.
    pub sweep: Kernel,
    /// The program of `enlarge`.
    pub enlargement: Program,
    /// Makes a finer field from a coarser one.
    pub enlarge: Kernel,
}

impl Kernels {
    /// Compiles all programs.
    ///
    /// # Errors
    /// [`GpuError`] if the device does not accept them.
    pub fn new(device: Arc<Device>) -> Result<Self, GpuError> {
        let mut bindings = [Binding::Read; 10];
        (bindings[0], bindings[1], bindings[9]) =
            (Binding::Uniform, Binding::Uniform, Binding::ReadWrite);
        let patchmatch = device.program("patchmatch", PATCHMATCH, &bindings)?;
        let enlargement = device.program(
            "enlarge",
            include_str!("shaders/enlarge.wgsl"),
            &[Binding::Uniform, Binding::Read, Binding::ReadWrite],
        )?;
        Ok(Self {
            score: device.kernel(&patchmatch, "score")?,
            sweep: device.kernel(&patchmatch, "sweep")?,
            enlarge: device.kernel(&enlargement, "enlarge")?,
            patchmatch,
            enlargement,
            device,
        })
    }
}
