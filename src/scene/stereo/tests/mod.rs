//! Stereo of a slanted textured wall, whose depth is known exactly.

mod fusing;
mod gaps;
mod pairs;
mod resuming;
mod searching;
mod snapping;
mod views;
mod wall;
