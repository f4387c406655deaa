//! Access to ONNX Runtime and to graphics cards.
//!
//! - [`nn`] finds ONNX Runtime, and installs, loads, checks and runs networks in the ONNX format.
//!   Inputs and outputs are [`nn::Tensor`]s: arrays of `f32` or `i64` in row-major order. A network
//!   runs on the processor unless another [`nn::Provider`] is chosen.
//! - [`gpu`] opens a device with wgpu, compiles WGSL programs and runs them in short pieces, so
//!   that a display on the same card stays responsive.
//!
//! Errors of both modules ([`nn::NnError`], [`gpu::GpuError`]) state what the user can do. ONNX
//! Runtime and graphics cards are looked for at run time, when they are first used; the program
//! builds without them.
//!
//! # Example
//!
//! A network whose input has a fixed size is not a substitute for one that accepts any size:
//!
//! ```rust
//! use ostra_compute::nn::{Element, Port, Signature, Tensor};
//!
//! let signature = |shape: Vec<Option<usize>>| Signature {
//!     inputs: vec![Port { name: "image".to_owned(), element: Element::F32, shape }],
//!     outputs: Vec::new(),
//! };
//! let expected = signature(vec![Some(1), Some(3), None]);
//! assert!(expected.fits(&signature(vec![Some(1), Some(3), None])).is_ok());
//! assert!(expected.fits(&signature(vec![Some(1), Some(3), Some(640)])).is_err());
//!
//! let image = Tensor::floats(&[1, 3, 2], vec![0.5; 6])?;
//! assert_eq!(image.shape(), [1, 3, 2]);
//! # Ok::<(), ostra_compute::nn::NnError>(())
//! ```

pub mod gpu;
pub mod nn;
