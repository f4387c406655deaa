//! Stereo of a slanted textured wall, whose depth is known exactly.

mod fusing;
mod searching;
mod views;
mod wall;
