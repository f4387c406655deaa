//! Faulty trackers on the synthetic plant, with exact depth and cameras.

mod behaviour;
mod drift;
mod mending;
mod synthetic;
