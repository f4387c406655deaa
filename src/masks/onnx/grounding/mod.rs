//! Words for Grounding DINO: phrases become the tokens of one caption, and what the network says of each token becomes
//! boxes of phrases.
//!
//! Liu et al.: "Grounding DINO: Marrying DINO with Grounded Pre-Training for Open-Set Object Detection", ECCV 2024;
//! Devlin et al.: "BERT: Pre-training of Deep Bidirectional Transformers for Language Understanding", NAACL 2019.
//!
//! May use: the nouns of masks. Must not touch: files, engine::nn, cameras, 3-D, UI.

mod caption;
mod found;
mod tokenizer;

pub use caption::Caption;
pub use found::grounded;
pub use tokenizer::Tokenizer;
