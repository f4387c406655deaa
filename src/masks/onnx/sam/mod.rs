//! Segment Anything: an image is embedded once, prompts are answered from the embedding.
//!
//! Kirillov et al.: "Segment Anything", ICCV 2023. `MobileSAM` (Zhang et al., 2023) is a smaller
//! network of the same kind; `EfficientSAM` (Xiong et al.: "EfficientSAM: Leveraged Masked Image
//! Pretraining for Efficient Segment Anything", CVPR 2024) takes fewer prompts. Ravi et al.: "SAM 2:
//! Segment Anything in Images and Videos", 2024, has features in three resolutions. The interfaces
//! of public files are listed in [`ostra_compute::nn::Dialect`].

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
pub use embedding::{Embedding, EmbeddingMap};
pub use frame::SamFrame;
pub use network::Sam;
pub use part::ImagePart;
pub use segment::EverythingOptions;
