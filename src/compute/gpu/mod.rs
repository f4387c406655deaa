//! Computing on a graphics card: open a device, compile WGSL, buffers, dispatch in short pieces, read back.

mod buffer;
mod device;
mod error;
mod pieces;
mod program;
#[cfg(test)]
mod tests;

pub use buffer::Buffer;
pub use device::{Device, Software};
pub use error::GpuError;
pub use pieces::Pieces;
pub use program::{Binding, Bindings, Kernel, Program, Submission};
