//! Time, accuracy and memory of reconstructions of standard data sets, also of other programs.
//!
//! [`run_bench`] runs every set in child processes: this program, and on request others, in turns.
//! Each run starts with a new project or database in a folder of its own, so that nothing is known
//! from earlier. Errors are those of camera centres and rotations as in
//! [`crate::evaluate::score_cameras`].

mod child;
mod data_sets;
mod machine;
mod measured;
mod ostra_run;
mod python;
mod report;
mod run;
mod synthetic_set;

pub use data_sets::{DataSet, STANDARD_SETS, StandardSet};
pub use machine::Machine;
pub use measured::{BenchStage, Measured};
pub use report::{BenchProgram, BenchReport, ProgramRun, SetReport};
pub use run::{BenchOptions, run_bench};
pub use synthetic_set::SyntheticSet;
