//! Slow values that panels show.
//!
//! Each file has the key of a [`Query`](crate::query::Query) and the pure function that computes
//! its value.

mod angles;
mod cloud;
mod conflicts;
mod depth_points;
mod instances;
mod prompt_preview;
mod selection;
mod sparse;
mod surface;
mod survey;
mod traits;
mod vote_mismatch;

pub use angles::Angles;
pub(crate) use angles::{AnglesKey, find_angles};
pub(crate) use cloud::{CloudKey, CloudQuery, CloudState, LoadedCloud, Snapshot, load_cloud};
pub(crate) use conflicts::{Conflicts, ConflictsKey, find_conflicts};
pub use depth_points::DepthPoints;
pub(crate) use depth_points::{
    AllPointsKey, DepthFrames, DepthPixels, DepthPointsKey, FramePointsKey, label_points,
    place_all, place_frame,
};
pub use instances::ProposedInstances;
pub(crate) use instances::{InstancesKey, find_instances, propose_instances};
pub(crate) use prompt_preview::{PromptTools, preview_prompt};
pub(crate) use selection::{ChosenPoints, SelectionKey, choose_points};
pub use sparse::SparseReconstruction;
pub(crate) use sparse::{SparseKey, load_sparse_model};
pub use surface::SurfaceKind;
pub(crate) use surface::{MeshKey, SurfaceKey, load_mesh, make_surface};
pub(crate) use survey::survey_frames;
pub use survey::{FoundCameras, FoundDepth, Survey, SurveyRequest};
pub use traits::MeasureSettings;
pub(crate) use traits::{MeasuredCloud, TraitsKey, measure_traits, under};
pub(crate) use vote_mismatch::{VoteMismatchKey, find_vote_mismatch, mask_by_vote, without_depth};
