//! What became of the views that were to get depth.

use serde::{Deserialize, Serialize};

/// Outcome for a view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewOutcome {
    /// It has depth.
    Done {
        /// Number of pixels with a depth that other views confirm.
        pixels: usize,
        /// The views that it was compared with, best first.
        sources: Vec<usize>,
    },
    /// Its camera or pose is unknown: reconstruct cameras first or provide them.
    NoCamera,
    /// It shares too few points, seen under a useful angle, with any other view.
    NothingShared {
        /// Number of sparse points that it sees.
        points: usize,
    },
    /// All its pixels are equal, so nothing can be compared.
    Constant,
    /// Its image cannot be read.
    Unreadable {
        /// Message of the read error.
        why: String,
    },
}

impl std::fmt::Display for ViewOutcome {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Done { pixels, sources } => write!(
                out,
                "{pixels} pixels with depth from {} views",
                sources.len()
            ),
            Self::NoCamera => write!(
                out,
                "it has no camera; reconstruct cameras first or give them"
            ),
            Self::NothingShared { points } => write!(
                out,
                "it shares too little with the other views ({points} points seen); take images in between"
            ),
            Self::Constant => write!(
                out,
                "all its pixels are alike; leave it out or take it again"
            ),
            Self::Unreadable { why } => write!(out, "{why}"),
        }
    }
}
