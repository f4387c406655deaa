use serde::{Deserialize, Serialize};

/// Which pieces without a label are adopted by what they hang on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AdoptRequest {
    /// Points at most this many spacings (median distances between labelled neighbours) apart hang together, 1.5–20.
    pub radius: f64,
}

impl Default for AdoptRequest {
    fn default() -> Self {
        Self { radius: 3.0 }
    }
}
