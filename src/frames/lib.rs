//! Images in order: frames, images, depth maps; opening folders, videos and RGB-D recordings; a bounded cache.

pub mod cameras;
mod complete;
mod decode;
mod depth_camera;
mod error;
mod exif;
mod film;
mod frame;
mod frame_set;
mod header;
mod image;
mod loader;
mod made_depth;
mod names;
mod open;
mod relocate;
mod store;
mod tiff_samples;

pub use depth_camera::DepthCamera;
pub use error::FrameError;
pub use exif::exif_focal_px;
pub use film::{FilmOptions, take_video_damage, write_film};
pub use frame::{DepthSource, Frame, FrameCamera, Orientation, PictureSource};
pub use frame_set::FrameSet;
pub use image::{DepthMap, Image};
pub use made_depth::MadeDepth;
pub use names::{file_of, without_ending};
pub use open::{FrameFolder, OpenRequest, Opened, natural_order, open, open_more};
pub use relocate::{check_source, missing_sources, sources, sources_mut};
pub use store::FrameStore;
