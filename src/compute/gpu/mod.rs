//! Compute on a graphics card: devices, WGSL programs, buffers and dispatch in short pieces.

mod buffer;
mod device;
mod program;

pub use buffer::Buffer;
pub use device::{Device, GpuError, Software};
pub use program::{Binding, Bindings, Kernel, Pieces, Program, Submission, WorkSize};
