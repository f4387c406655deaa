//! XMem: masks carried through a video by three networks and a memory of what was seen: sensory (of each object, renewed
//! in every frame), working (some whole frames) and long-term (the most used of what working memory gives up).
//!
//! Cheng, Schwing: "XMem: Long-Term Video Object Segmentation with an Atkinson-Shiffrin Memory Model", ECCV 2022.
//! Numbers are those of the official code, with one exception: labels that come later have keys of their own. There
//! they share those of the first frame, which consolidation then pairs with other pictures' values.

mod fit;
mod memory;
mod networks;
mod similarity;
#[cfg(test)]
mod tests;
mod tracker;

pub use memory::XMemOptions;
pub use tracker::XMem;
