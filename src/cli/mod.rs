//! The command line: words → `Command`s, a Session driven to rest, progress lines, exit codes.

mod args;
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
mod run;
mod shot;
mod sources;
mod stop;
mod values;

pub use run::main;
