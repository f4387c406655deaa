//! Stereo of a slanted textured wall, whose depth is known exactly.

mod completing;
mod flat;
mod fusing;
mod gaps;
mod lens;
mod pairs;
mod resuming;
mod searching;
mod snapping;
mod views;
mod wall;
