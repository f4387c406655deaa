use serde::{Deserialize, Serialize};

/// How a pose is found without a guess.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GlobalRegistration {
    /// Fast Global Registration: one robust fit to all matches.
    #[default]
    Fgr,
    /// RANSAC: the best of many fits to three matches each.
    Ransac,
}

/// How two clouds are laid onto each other without a guess.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct GlobalOptions {
    /// What finds the pose.
    pub method: GlobalRegistration,
    /// Matches that must agree on a pose, 3 or more; with fewer there is none.
    pub min_agreeing: usize,
    /// Share of all matches that must agree, 0–1; chance brings about 0.01 to 0.03 of them together.
    pub min_share: f64,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for GlobalOptions {
    fn default() -> Self {
        Self {
            method: GlobalRegistration::default(),
            min_agreeing: 20,
            min_share: 0.03,
            seed: 0,
        }
    }
}

/// How a pose is refined.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RefineOptions {
    /// Edge of the coarsest voxels, world units, above 0; the start may be wrong by about this much. The finest are a
    /// quarter of it.
    pub voxel: f32,
    /// Weight of the surfaces' distance, the rest is brightness: 0–1, 1 = brightness is not looked at.
    pub lambda_geometric: f64,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            voxel: 0.05,
            lambda_geometric: 0.968,
        }
    }
}
