//! The project: its data, edits and history, and the files that store it.
//!
//! A [`Project`] holds the frames, the label tree, the prompts, one mask per frame, and records of
//! the results. It changes only through [`Edit`]s. [`Project::apply`] returns the inverse of each
//! edit, and a [`History`] of [`Step`]s gives undo and redo. [`OpenProject`] combines a project
//! with its history and its folder: a step is either made in memory and on disk, or not at all. An
//! edit that changes the input of a result marks the result as stale (see
//! [`Project::consequences`]).
//!
//! The modules have these tasks:
//!
//! - [`store`] reads and writes the project's folder.
//! - [`prompt`], [`mask_edits`], [`label_edits`] and [`range`] build edits.
//! - [`suggestion`] describes unlabelled objects to work on next.
//! - [`review`] counts confirmed frames and lists those to check.
//! - [`voted_cloud`] and [`reusable_votes`] hold a cloud with the votes behind its labels.
//! - [`export_targets`] and [`export_record`] protect the user's files from exports.
//!
//! Frames are numbered from 0, and label 0 means unlabelled. Pixel coordinates have their origin at
//! the top left corner of the image. Positions are in world units relative to [`Project::origin`],
//! and confidences are between 0 and 1.
//!
//! # Example
//!
//! ```rust
//! use ostra_masks::{Label, LabelId};
//! use ostra_project::{Edit, Project};
//!
//! # fn main() -> anyhow::Result<()> {
//! let id = LabelId(1);
//! let leaf = Label {
//!     id,
//!     name: "leaf".into(),
//!     color: [0, 160, 0],
//!     parent: None,
//! };
//! let mut project = Project::default();
//! let inverse = project.apply(Edit::SetLabel {
//!     id,
//!     label: Some(leaf),
//! })?;
//! assert_eq!(project.labels.by_name("leaf").map(|label| label.id), Some(id));
//!
//! project.apply(inverse)?;
//! assert!(project.labels.by_name("leaf").is_none());
//! # Ok(())
//! # }
//! ```

mod apply;
mod coordinates;
mod edit;
mod engine_ids;
pub mod export_record;
pub mod export_targets;
mod history;
mod interpolate;
mod label_choice;
pub mod label_edits;
mod marks;
pub mod mask_edits;
mod open_project;
mod origin;
mod presence;
mod project;
pub mod prompt;
pub mod range;
mod requests;
mod results;
pub mod reusable_votes;
pub mod review;
mod split;
mod stale;
pub mod store;
pub mod suggestion;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
pub mod voted_cloud;
pub mod workflow;

pub use coordinates::scale_between;
pub use edit::Edit;
pub use engine_ids::{
    DeviceId, EngineName, FeatureId, GrounderId, MatcherId, RegistrationId, SegmenterId, TrackerId,
    UnknownEngine,
};
pub use history::{Change, History, Step};
pub use label_choice::LabelChoice;
pub use open_project::OpenProject;
pub use origin::{make_relative, origin_near};
pub use presence::Presence;
pub use project::{FrameMask, Marks, MaskOrigin, Project};
pub use requests::{
    ExportRequest, FuseRequest, PromptRequest, RangeChange, RangeRequest, ReconstructMethod,
    ReconstructRequest, ScaleEnd, ScaleRequest,
};
pub use results::{
    Coordinates, ResultEngine, ResultKind, ResultRecord, SparseModelRecord, StepSeconds,
};
