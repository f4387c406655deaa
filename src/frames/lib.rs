//! Frames of image sequences, videos and RGB-D recordings: opening, decoding, caching and cameras.
//!
//! [`open`] turns an [`OpenRequest`] (folders, single images or videos, each with optional depth
//! images) into [`Frame`]s in project order. A frame only references its sources: the path and EXIF
//! orientation of an image file, or the path, index and time of a video frame, plus its depth and
//! camera if known. [`FrameStore`] decodes [`Image`]s and [`DepthMap`]s on demand, keeps them in a
//! cache bounded in bytes and prefetches in the background. Videos are decoded and written by the
//! system's ffmpeg. [`EstimatedDepth`] is the depth map of a reconstruction, and [`DepthCamera`] a depth
//! sensor that is not registered to the colour camera. [`FrameSet`] is a set of frame numbers. The
//! module [`cameras`] reads given cameras in many formats, matches them to frames, and writes
//! COLMAP models.
//!
//! Images are sRGB with 8 bits per channel, row by row from the top left, and always upright: EXIF
//! orientations are applied on loading, to depth and cameras as well. Depth is measured along the
//! optical axis in world units (metres); 0 is unknown. The centre of the top-left pixel is at
//! (0.5, 0.5).
//!
//! # Example
//!
//! ```rust
//! use std::cmp::Ordering;
//! use std::path::PathBuf;
//!
//! use ostra_core::job::Progress;
//! use ostra_frames::{FrameFolder, FrameSet, OpenRequest, Orientation, natural_order, open};
//!
//! // Frames are sorted in natural order.
//! assert_eq!(natural_order("img_2.png", "img_10.png"), Ordering::Less);
//!
//! // EXIF orientation 6 exchanges the sides of the stored image.
//! assert_eq!(Orientation(6).shown_size(4000, 3000), (3000, 4000));
//!
//! // Errors say what the user can do.
//! let request = OpenRequest {
//!     sources: vec![FrameFolder::from(PathBuf::from("/no/such/folder"))],
//!     ..OpenRequest::default()
//! };
//! let error = open(&request, &Progress::default()).unwrap_err();
//! assert!(error.to_string().contains("check the path"));
//!
//! let mut frames = FrameSet::default();
//! frames.insert(3, 7);
//! frames.remove(5, 5);
//! assert_eq!(frames.ranges().collect::<Vec<_>>(), [3..=4, 6..=7]);
//! ```

pub mod cameras;
mod complete;
mod decode;
mod depth_camera;
mod error;
mod estimated_depth;
mod exif;
mod frame;
mod frame_set;
mod header;
mod image;
mod loader;
mod name_parts;
mod open;
mod relocate;
mod store;
mod tiff_samples;
mod video;

pub use depth_camera::DepthCamera;
pub use error::FrameError;
pub use estimated_depth::EstimatedDepth;
pub use exif::exif_focal_px;
pub use frame::{DepthSource, Frame, FrameCamera, ImageSource, Orientation};
pub use frame_set::FrameSet;
pub use image::{DepthMap, Image};
pub use name_parts::{file_of, without_ending};
pub use open::{
    Companions, FrameFolder, IMAGE_ENDINGS, OpenRequest, Opened, natural_order, open, open_more,
};
pub use relocate::{check_source, missing_sources, sources, sources_mut};
pub use store::FrameStore;
pub use video::{TurntableOptions, take_video_damage, write_turntable};
