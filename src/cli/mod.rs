//! The command line: words → `Command`s, a Session driven to rest, progress lines, exit codes.

mod args;
mod demo;
mod doubt;
mod drive;
mod eval;
mod eval_args;
mod export;
mod info;
mod instances;
mod mask_args;
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
