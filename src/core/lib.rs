//! Building blocks that every other crate uses.
//!
//! [`job`] runs work in the background: progress, cancellation, worker pools and newest-wins slots.
//! [`disk`] writes files atomically and reads them without waiting for other processes.
//! [`programs`] starts child processes and kills them with this program. [`cache`] is a cache
//! limited in bytes. [`mod@image`] samples and shrinks images, [`statistics`] has medians and
//! quantiles, [`union_find`] has disjoint sets, and [`lists`] writes lists of names.
//!
//! Results do not depend on the number of threads. Images are stored row by row; sizes are columns
//! and rows, in pixels.
//!
//! # Example
//!
//! ```rust
//! use ostra_core::job::{Progress, Running, Stopped};
//! use ostra_core::union_find::DisjointSets;
//!
//! // A job runs on its own thread. Each step reports progress and notices a request to stop.
//! let job = Running::spawn("sum", Progress::default(), |progress| {
//!     let mut sum = 0;
//!     for number in 1..=100 {
//!         progress.step(number, 100)?;
//!         sum += number;
//!     }
//!     Ok::<usize, Stopped>(sum)
//! });
//! assert_eq!(job.join()??, 5050);
//!
//! let mut sets = DisjointSets::new(4);
//! sets.unite(1, 3);
//! assert_eq!(sets.into_roots(), [0, 1, 2, 1]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod cache;
pub mod disk;
pub mod image;
pub mod job;
pub mod lists;
pub mod programs;
pub mod statistics;
pub mod union_find;
