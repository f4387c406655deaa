//! Frames to cameras and depths: structure from motion ([`sfm`]), PatchMatch stereo ([`stereo`]), registration of RGB-D
//! recordings ([`rgbd`]).

pub mod rgbd;
pub mod sfm;
pub mod stereo;
