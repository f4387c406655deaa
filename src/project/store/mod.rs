//! A project in its folder: `project.toml`, the masks, the journal of later steps, and the history.
//!
//! The state consists of two parts: `project.toml` (with `masks/`) holds the state after a numbered
//! step, and the journal holds every later step. Steps are numbered over the whole life of the
//! project. A kill between any two writes of a checkpoint therefore leaves files that still agree:
//! steps that `project.toml` already contains are skipped in the journal.

mod checkpoint;
mod contained;
mod damage;
mod depth_folder;
mod durable;
mod folder;
mod history_file;
mod journal;
mod load;
mod lock;
mod manifest;
mod mask_files;
pub(super) mod packed_runs;
mod source_paths;
mod sparse_model;
mod versions;

pub use checkpoint::{Checkpoint, HISTORY_BYTES, Written};
pub use depth_folder::{DepthFolder, DepthRunRecord, depth_map_path};
pub use durable::{replace, sync_folder};
pub use folder::{Folder, Loaded};
pub use journal::{Act, JournalRecord};
pub use load::read_frames;
pub use lock::{Lock, LockError};
pub use source_paths::joined;
pub use sparse_model::{
    ModelCameras, load_cameras, load_links, load_outcomes, load_sparse, read_sparse, save_cameras,
    save_links, save_outcomes,
};
pub use versions::{
    cloud_path, depth_versions, feature_cache_path, keep_mesh, keep_votes, mesh_path,
    mesh_votes_path, next as next_version, publish_cloud, publish_depths, sparse_path,
    version_in_force, votes_path,
};
