use serde::{Deserialize, Serialize};

use ostra_cloud::instances::InstanceOptions;
use ostra_masks::LabelId;

/// Which label is told apart into instances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct InstancesRequest {
    /// The class; the instances become labels below it.
    pub label: LabelId,
    /// When points are one instance.
    #[serde(default)]
    pub options: InstanceOptions,
}
