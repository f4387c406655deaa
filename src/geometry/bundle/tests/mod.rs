//! Tests of `geometry/bundle`.

mod behaviour;
mod jacobians;
mod recovery;
mod scene;
mod solving;
