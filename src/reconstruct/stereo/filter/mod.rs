//! Filtering of depth maps.
//!
//! Borders of surfaces move to changes of colour. Depths that other views agree with are kept, on
//! surfaces of some size. Finally, a view takes over what several other views see in front of its
//! surfaces or where it has no depth.

mod complete;
mod consistency;
mod depth_filter;
mod snap;

pub use complete::{CompleteOptions, FilterOptions, completed};
pub use consistency::{
    ConsistentPixel, DepthAgreement, Neighbour, NeighbourSurface, PixelPoint, UNSEEN,
};
pub use depth_filter::filter;
pub use snap::{SnapOptions, snapped};
