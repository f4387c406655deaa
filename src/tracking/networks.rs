//! What the trackers made of networks share: running them, checking what they take, and resampling.

use ostra_compute::nn::{Network, NnError, Tensor};
use ostra_core::job::{Progress, Stopped};
use ostra_masks::MaskError;

/// A network's error as an error about masks.
#[expect(clippy::needless_pass_by_value, reason = "`map_err` hands it over")]
pub(crate) fn network_error(error: NnError) -> MaskError {
    MaskError::Network(error.to_string())
}

/// Runs a network until the user stops it; its outputs, in order.
pub(crate) fn run(
    network: &Network,
    inputs: &[(&str, &Tensor)],
    progress: &Progress,
) -> Result<Vec<Tensor>, MaskError> {
    progress.check()?;
    let outputs = network.run_while(inputs, &|| progress.check().is_ok());
    outputs
        .map_err(network_error)?
        .ok_or_else(|| Stopped.into())
}

/// Refuses a network that takes other inputs, or lacks one of the outputs.
///
/// # Errors
/// [`NnError::Mismatch`].
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

/// The error of a network that is not what is expected.
pub(crate) fn mismatch(network: &Network, what: &str) -> NnError {
    NnError::Mismatch {
        path: network.path().to_owned(),
        what: what.to_owned(),
    }
}

/// The two samples of a row or column that a new one lies between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LinearSample {
    pub first: usize,
    /// The one after it, or itself at the end.
    pub next: usize,
    /// Of the next; the first has the rest.
    pub weight: f32,
}

/// For each of `to` samples those of `from` around it, where borders lie on borders.
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

/// For each of `to` samples those of `from` around it, where the first and the last lie on the first and the last.
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

/// The odds of a probability that is kept `margin` away from 0 and 1.
pub(crate) fn odds(probability: f32, margin: f32) -> f32 {
    let bounded = probability.clamp(margin, 1.0 - margin);
    bounded / (1.0 - bounded)
}
