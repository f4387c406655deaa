//! Synthetic scenes, scores, simulated users, and the demo.

pub mod cloud_score;
pub mod demo;
pub mod evaluate;
pub mod mask_score;
pub mod simulated_click;
pub mod synthetic;

#[cfg(test)]
mod tests;
