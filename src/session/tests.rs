mod edits;
mod folder;
mod jobs;
pub mod making;
mod masks;
mod steps;
