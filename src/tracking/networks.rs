//! Helpers shared by the network-based trackers: inference, signature checks and resampling.

use ostra_compute::nn::{Network, NnError, Tensor};
use ostra_core::job::{Progress, Stopped};
use ostra_masks::MaskError;

/// Runs a network and returns its outputs in order; stops when the user does.
pub(crate) fn run(
    network: &Network,
    inputs: &[(&str, &Tensor)],
    progress: &Progress,
) -> Result<Vec<Tensor>, MaskError> {
    progress.check()?;
    let outputs = network.run_while(inputs, &|| progress.check().is_ok());
    outputs?.ok_or_else(|| Stopped.into())
}

/// Checks that a network has exactly these inputs and at least these outputs.
///
/// # Errors
/// [`NnError::Mismatch`] if it does not.
pub(crate) fn check_signature(
    network: &Network,
    inputs: &[&str],
    outputs: &[&str],
) -> Result<(), NnError> {
    let signature = network.signature();
    let has_input = |name: &&str| signature.inputs.iter().any(|port| port.name == **name);
    let has_output = |name: &&str| signature.outputs.iter().any(|port| port.name == **name);
    let takes = signature.inputs.len() == inputs.len() && inputs.iter().all(has_input);
    if takes && outputs.iter().all(has_output) {
        return Ok(());
    }
    let mut what = format!("expected the inputs {}", inputs.join(", "));
    if !outputs.is_empty() {
        what += &format!(" and the outputs {}", outputs.join(", "));
    }
    Err(mismatch(network, &what))
}

/// Creates the error for a network that does not match what is expected.
pub(crate) fn mismatch(network: &Network, what: &str) -> NnError {
    NnError::Mismatch {
        path: network.path().to_owned(),
        what: what.to_owned(),
    }
}

/// The two source samples around a resampled one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LinearSample {
    pub first: usize,
    /// The next sample, or `first` at the end.
    pub next: usize,
    /// Weight of `next`; `first` has the rest.
    pub weight: f32,
}

/// Returns the source samples for resizing with aligned borders (half-pixel centres).
pub(crate) fn half_pixel_samples(from: usize, to: usize) -> Vec<LinearSample> {
    let one = |at: usize| {
        let place = ((at as f64 + 0.5) * from as f64 / to as f64 - 0.5).max(0.0);
        let first = (place as usize).min(from - 1);
        LinearSample {
            first,
            next: (first + 1).min(from - 1),
            weight: (place - first as f64) as f32,
        }
    };
    (0..to).map(one).collect()
}

/// Returns the source samples for resizing with aligned corner samples.
pub(crate) fn corner_aligned_samples(from: usize, to: usize) -> Vec<LinearSample> {
    let scale = if to > 1 {
        (from - 1) as f32 / (to - 1) as f32
    } else {
        0.0
    };
    let one = |at: usize| {
        let place = at as f32 * scale;
        let first = (place as usize).min(from - 1);
        LinearSample {
            first,
            next: (first + 1).min(from - 1),
            weight: place - first as f32,
        }
    };
    (0..to).map(one).collect()
}

/// Returns the odds of a probability after clamping it `margin` away from 0 and 1.
pub(crate) fn odds(probability: f32, margin: f32) -> f32 {
    let bounded = probability.clamp(margin, 1.0 - margin);
    bounded / (1.0 - bounded)
}
