//! Tests of everything below the window, on real data and as a process: one module a subject.

#[cfg(test)]
#[path = "../support/mod.rs"]
mod support;

#[cfg(test)]
mod adopt;
#[cfg(test)]
mod architecture;
#[cfg(test)]
mod bedroom;
#[cfg(test)]
mod bricks;
#[cfg(test)]
mod cameras;
#[cfg(test)]
mod carry;
#[cfg(test)]
mod command_line;
#[cfg(test)]
mod constrain;
#[cfg(test)]
mod constrain_networks;
#[cfg(test)]
mod correct;
#[cfg(test)]
mod crash;
#[cfg(test)]
mod doubt;
#[cfg(test)]
mod downloads;
#[cfg(test)]
mod export_safety;
#[cfg(test)]
mod exports;
#[cfg(test)]
mod films;
#[cfg(test)]
mod floors;
#[cfg(test)]
mod flow;
#[cfg(test)]
mod following;
#[cfg(test)]
mod frames;
#[cfg(test)]
mod fuse;
#[cfg(test)]
mod image_inputs;
#[cfg(test)]
mod import_circles;
#[cfg(test)]
mod kept_features;
#[cfg(test)]
mod kills;
#[cfg(test)]
mod large_coordinates;
#[cfg(test)]
mod layouts;
#[cfg(test)]
mod long_films;
#[cfg(test)]
mod mask_inputs;
#[cfg(test)]
mod masks;
#[cfg(test)]
mod ranges;
#[cfg(test)]
mod rgbd;
#[cfg(test)]
mod scale;
#[cfg(test)]
mod segmenter;
#[cfg(test)]
mod session;
#[cfg(test)]
mod sfm;
#[cfg(test)]
mod sfm_failures;
#[cfg(test)]
mod sfm_learned;
#[cfg(test)]
mod shared;
#[cfg(test)]
mod shots;
#[cfg(test)]
mod stereo;
#[cfg(test)]
mod stereo_made;
#[cfg(test)]
mod stopping;
#[cfg(test)]
mod suggestions;
#[cfg(test)]
mod thin;
#[cfg(test)]
mod traits;
#[cfg(test)]
mod two_processes;
#[cfg(test)]
mod untrusted_projects;
#[cfg(test)]
mod video_seeking;
#[cfg(test)]
mod words;
