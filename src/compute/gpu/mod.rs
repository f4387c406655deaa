//! Computing on a graphics card: open a device, compile WGSL, buffers, dispatch in short pieces, read back.

mod buffer;
mod device;
mod program;

pub use buffer::Buffer;
pub use device::{Device, GpuError, Software};
pub use program::{Binding, Bindings, Kernel, Pieces, Program, Submission};
