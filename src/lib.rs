//! OSTRA turns pictures into labelled 3-D.
//!
//! `frames → prompts → masks → tracks → cameras + depths → labelled cloud → see, measure, export`
//!
//! The modules are rooms; every import points down this list (`docs/ARCHITECTURE.md`).

pub mod app;
pub mod cli;
pub mod engine;
pub mod frames;
pub mod geometry;
pub mod masks;
pub mod scene;
pub mod session;
pub mod view;
