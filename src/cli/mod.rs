//! Command line of OSTRA.
//!
//! Translates arguments into `Command`s, runs them in a `Session` and reports progress and exit
//! codes.

mod args;
mod bench;
#[cfg(test)]
mod book;
mod cloud;
mod demo;
mod drive;
mod eval;
mod export;
mod info;
mod masks;
mod memory;
mod models;
mod print;
mod project;
mod range;
mod recipe;
#[cfg(test)]
mod recipe_schema;
mod results;
mod run;
mod shot;
mod sources;
mod stop;
mod values;

pub use run::main;
