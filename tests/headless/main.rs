//! Tests of everything below the window, most of them through the program as a process.

#[cfg(test)]
#[path = "../support/crash_child.rs"]
mod crash_child;
#[cfg(test)]
#[path = "../support/kill_jobs.rs"]
mod kill_jobs;
#[cfg(test)]
#[path = "../support/program.rs"]
mod program;
#[cfg(test)]
#[path = "../support/project.rs"]
mod project;
#[cfg(test)]
#[path = "../support/session.rs"]
mod session;

#[cfg(test)]
mod architecture;
#[cfg(test)]
mod attach;
#[cfg(test)]
mod auto_segmenter;
#[cfg(test)]
mod bench;
#[cfg(test)]
mod book;
#[cfg(test)]
mod clicks;
#[cfg(test)]
mod command_line;
#[cfg(test)]
mod conflicts;
#[cfg(test)]
mod constrain_networks;
#[cfg(test)]
mod correct;
#[cfg(test)]
mod crash;
#[cfg(test)]
mod downloads;
#[cfg(test)]
mod error_texts;
#[cfg(test)]
mod export_safety;
#[cfg(test)]
mod exports;
#[cfg(test)]
mod fake_sites;
#[cfg(test)]
mod frames;
#[cfg(test)]
mod image_inputs;
#[cfg(test)]
mod import_circles;
#[cfg(test)]
mod instances;
#[cfg(test)]
mod kept_features;
#[cfg(test)]
mod kills;
#[cfg(test)]
mod large_coordinates;
#[cfg(test)]
mod layouts;
#[cfg(test)]
mod learned_matches;
#[cfg(test)]
mod mask_inputs;
#[cfg(test)]
mod networks;
#[cfg(test)]
mod parallel_downloads;
#[cfg(test)]
mod ranges;
#[cfg(test)]
mod recording;
#[cfg(test)]
mod repeated;
#[cfg(test)]
mod review;
#[cfg(test)]
mod scale;
#[cfg(test)]
mod several_models;
#[cfg(test)]
mod shots;
#[cfg(test)]
mod stopping;
#[cfg(test)]
mod suggestions;
#[cfg(test)]
mod thin;
#[cfg(test)]
mod two_processes;
#[cfg(test)]
mod type_names;
#[cfg(test)]
mod unfinished;
#[cfg(test)]
mod untrusted_projects;
#[cfg(test)]
mod wording;
