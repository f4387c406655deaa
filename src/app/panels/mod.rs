//! Panels around the picture: one file each, one function per section.

mod cloud_labels;
mod filmstrip;
mod fuse;
mod heat;
mod jobs;
mod label_edit;
mod labels;
mod reconstruct;
mod results;
mod scene_bar;
mod scene_canvas;
mod scene_pane;
mod segmenter;
mod status;
mod suggestions;
mod timeline;
mod track;
mod welcome;

pub(super) use cloud_labels::{PointCounts, cloud_labels_ui};
pub(super) use filmstrip::filmstrip_ui;
pub(super) use fuse::fuse_ui;
pub(super) use heat::{HEAT_HEIGHT, heat_ui};
pub(super) use jobs::jobs_ui;
pub(super) use label_edit::LabelEditing;
pub(super) use labels::{add_label, labels_ui, listed};
pub(super) use reconstruct::reconstruct_ui;
pub(super) use results::results_ui;
pub(super) use scene_pane::ScenePane;
pub(super) use segmenter::segmenter_ui;
pub(super) use status::status_ui;
pub(super) use suggestions::{is_explained, suggestions_ui};
pub(super) use timeline::timeline_ui;
pub(super) use track::track_ui;
pub(super) use welcome::welcome_ui;
