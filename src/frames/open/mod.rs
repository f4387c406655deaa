//! Opening of sources (folders, images, videos, depth) as frames in project order.

mod assemble;
mod headers;
mod listing;
mod pairing;
mod request;
mod source;

pub use assemble::{open, open_more};
pub use listing::natural_order;
pub use request::{FrameFolder, OpenRequest, Opened};
