use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::scene::LabelledCloud;
use crate::session::{Pictures, Project};

/// What panels look at: a snapshot of the open session, borrowed for one picture of the window.
#[derive(Clone, Copy)]
pub struct Look<'a> {
    /// The open project; empty when none is open.
    pub project: &'a Project,
    /// Its folder; `None` when none is open.
    pub root: Option<&'a Path>,
    /// The labelled cloud: the project's, or the PLY that is inspected.
    pub cloud: Option<&'a Arc<LabelledCloud>>,
    /// The PLY that is inspected alone.
    pub inspected: Option<&'a Path>,
    /// Pictures and thumbnails.
    pub pictures: Option<&'a Pictures>,
    /// What is running, oldest first.
    pub jobs: &'a [JobLook],
    /// Segmenters, trackers and the rest, installed or not.
    pub engines: &'a [EngineLook],
    /// What undo would take back.
    pub undo: Option<&'a str>,
    /// What redo would do again.
    pub redo: Option<&'a str>,
    /// Projects opened before, latest first.
    pub recent: &'a [PathBuf],
}

/// A running job as the window shows it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct JobLook {
    /// What it is, e.g. `Track`.
    pub title: String,
    /// What it does now.
    pub stage: String,
    /// Units done of this stage.
    pub done: usize,
    /// Units in all; 0 = not known.
    pub total: usize,
}

/// An engine as the lists show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EngineLook {
    /// What it is for.
    pub kind: EngineKind,
    /// Its name on the command line.
    pub name: String,
    /// Whether it can be used now.
    pub installed: bool,
    /// What it is good for, or how to get it.
    pub note: String,
}

/// What an engine is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EngineKind {
    /// Turns clicks into masks.
    Segmenter,
    /// Carries masks through the sequence.
    Tracker,
}

impl Look<'_> {
    /// Whether there is a project with frames.
    #[must_use]
    pub fn has_frames(&self) -> bool {
        !self.project.frames.is_empty()
    }

    /// The engines of one kind.
    pub fn engines_of(&self, kind: EngineKind) -> impl Iterator<Item = &EngineLook> {
        self.engines.iter().filter(move |engine| engine.kind == kind)
    }

    /// Whether a job of this title runs.
    #[must_use]
    pub fn is_running(&self, title: &str) -> bool {
        self.jobs.iter().any(|job| job.title.eq_ignore_ascii_case(title))
    }
}
