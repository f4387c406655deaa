//! Detection by text with Grounding DINO.
//!
//! Phrases become the tokens of one caption; the network's logits per token become boxes of
//! phrases.
//!
//! Liu et al.: "Grounding DINO: Marrying DINO with Grounded Pre-Training for Open-Set Object
//! Detection", ECCV 2024;
//! Devlin et al.: "BERT: Pre-training of Deep Bidirectional Transformers for Language
//! Understanding", NAACL 2019.

mod caption;
mod grounding_output;
mod network;
mod network_input;

#[cfg(test)]
mod tests;

pub use caption::{Caption, Tokenizer};
pub use grounding_output::GroundingOutput;
pub use network::GroundingDino;
