//! Faulty trackers on the synthetic plant, with exact depth and cameras.

mod behaviour;
mod made;
mod mending;
mod straying;
