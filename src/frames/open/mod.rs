//! From what the user names (folders, pictures, films, depth) to frames in project order.

mod assemble;
mod depth;
mod headers;
mod layout;
mod listing;
mod naming;
mod natural;
mod pairing;
mod request;
mod source;
mod tum;

pub use assemble::{open, open_more};
pub use natural::natural_order;
pub use request::{FrameFolder, OpenRequest, Opened};
