//! Opening of sources (folders, images, videos, depth) as frames in project order.

mod assemble;
mod companions;
mod headers;
mod listing;
mod pairing;
mod request;
mod source;

pub use assemble::{open, open_more};
pub use companions::Companions;
pub use listing::{IMAGE_ENDINGS, natural_order};
pub use request::{FrameFolder, OpenRequest, Opened};
