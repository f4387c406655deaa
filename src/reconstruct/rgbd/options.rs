use serde::{Deserialize, Serialize};

use super::register::GlobalRegistration;

/// How an RGB-D recording is registered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct RgbdOptions {
    /// How fragments that nothing else ties together are laid onto each other; `None` = one way after the other.
    pub registration: Option<GlobalRegistration>,
    /// Frames that each is compared with because they look most alike.
    pub alike: usize,
    /// Seed of all samples.
    pub seed: u64,
}

impl Default for RgbdOptions {
    fn default() -> Self {
        Self {
            registration: None,
            alike: 6,
            seed: 0,
        }
    }
}
