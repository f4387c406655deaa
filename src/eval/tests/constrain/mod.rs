//! Trackers made to err on the made plant, with exact depth and cameras.

mod behaviour;
mod made;
mod mending;
mod straying;
