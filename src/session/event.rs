use crate::job_task::JobTask;
use std::path::PathBuf;
use std::time::Duration;

use ostra_core::job::{JobId, ProgressReport};
use ostra_masks::LabelId;

/// What happened since the last [`crate::Session::poll`], in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// A job began.
    Started {
        /// Which.
        job: JobId,
        /// What it is, e.g. `Track`.
        title: String,
    },
    /// A job did what it was for.
    Finished {
        /// Which.
        job: JobId,
        /// What it was.
        title: String,
    },
    /// A job ended with an error; what it had finished is kept.
    Failed {
        /// Which.
        job: JobId,
        /// What it was.
        title: String,
        /// One line: what, where, what to do.
        error: String,
    },
    /// A job was stopped; what it had finished is kept.
    Stopped {
        /// Which.
        job: JobId,
        /// What it was.
        title: String,
    },
    /// A tracking run ended by itself because it was not sure; what it had finished is kept.
    Paused {
        /// Which.
        job: JobId,
        /// The frame to look at.
        frame: usize,
        /// The label it was least sure of.
        label: LabelId,
        /// One line: what, where, what to do.
        text: String,
    },
    /// A project was made or opened.
    Opened(PathBuf),
    /// A labelled PLY was opened alone.
    Inspecting(PathBuf),
    /// What was open is closed.
    Closed,
    /// The project changed.
    Changed,
    /// The labelled cloud was loaded, made anew or went away.
    CloudChanged,
    /// It is known anew how much masks contradict the cloud.
    DoubtsChanged,
    /// A network was installed or added.
    ModelsChanged,
    /// The sparse model of the cameras was loaded.
    SparseChanged,
    /// Something worth knowing, e.g. which tracker was taken.
    Notice(String),
    /// Something that the user should look at; the work went on.
    Warning(String),
}

/// A running job as window and command line show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JobView {
    /// Which.
    pub id: JobId,
    /// What it is called, for people.
    pub title: String,
    /// The task that panels find it by.
    pub task: Option<JobTask>,
    /// How far it is.
    pub report: ProgressReport,
    /// Since when it runs.
    pub elapsed: Duration,
}
