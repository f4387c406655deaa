//! Segment Anything: an image is embedded once, prompts are answered from the embedding.
//!
//! Kirillov et al.: "Segment Anything", ICCV 2023. `MobileSAM` (Zhang et al., 2023) has the same
//! interface; `EfficientSAM` (Xiong et al.: "EfficientSAM: Leveraged Masked Image Pretraining for
//! Efficient Segment Anything", CVPR 2024) has another one.

mod close_ups;
mod decoder;
mod embedding;
mod frame;
mod mask_logits;
mod network;
mod objects;
mod part;
mod segment;
#[cfg(test)]
mod tests;

pub use close_ups::CloseUps;
pub use embedding::Embedding;
pub use frame::SamFrame;
pub use network::Sam;
pub use part::ImagePart;
pub use segment::EverythingOptions;
