mod depth_points;
mod edits;
mod folder;
mod jobs;
pub mod making;
mod masks;
mod ranges;
mod steps;
