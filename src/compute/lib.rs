//! Where numbers are worked out fast: ONNX Runtime ([`nn`]) and wgpu ([`gpu`]).

pub mod gpu;
pub mod nn;
