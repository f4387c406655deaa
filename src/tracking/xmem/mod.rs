//! The XMem tracker: three networks and a memory of three levels.
//!
//! Sensory memory belongs to each object and is updated in every frame. Working memory holds some
//! whole frames. Long-term memory holds the most used elements that leave working memory.
//!
//! Cheng, Schwing: "XMem: Long-Term Video Object Segmentation with an Atkinson-Shiffrin Memory
//! Model", ECCV 2022. The results equal those of the official code, with one exception: labels that
//! appear later have keys of their own. In the official code they share the keys of the first
//! frame, which consolidation then pairs with values of other images.

mod fit;
mod memory;
mod networks;
mod similarity;
#[cfg(test)]
mod tests;
mod tracker;

pub use memory::XMemOptions;
pub use tracker::XMem;
