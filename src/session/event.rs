use crate::job_task::JobTask;
use std::path::PathBuf;
use std::time::Duration;

use ostra_core::job::{JobId, Overview, ProgressReport};
use ostra_masks::LabelId;

/// Something that happened since the last [`crate::Session::poll`]; events are in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// A job started.
    Started {
        /// Id of the job.
        job: JobId,
        /// Title, e.g. `Track`.
        title: String,
    },
    /// A job finished successfully.
    Finished {
        /// Id of the job.
        job: JobId,
        /// Title of the job.
        title: String,
    },
    /// A job failed; its results so far are kept.
    Failed {
        /// Id of the job.
        job: JobId,
        /// Title of the job.
        title: String,
        /// Error message in one line: what failed, where, and what to do.
        error: String,
    },
    /// A job was stopped; its results so far are kept.
    Stopped {
        /// Id of the job.
        job: JobId,
        /// Title of the job.
        title: String,
    },
    /// A tracking run paused itself because of low confidence; its results so far are kept.
    Paused {
        /// Id of the job.
        job: JobId,
        /// Frame at which the run paused.
        frame: usize,
        /// Label with the lowest confidence.
        label: LabelId,
        /// Message in one line: what happened, where, and what to do.
        text: String,
    },
    /// A project was created or opened.
    Opened(PathBuf),
    /// A labelled PLY was opened without a project.
    Inspecting(PathBuf),
    /// The open project or PLY was closed.
    Closed,
    /// The project changed.
    Changed,
    /// A prompt changed no pixel, so that no step was made.
    Unchanged {
        /// Frame number.
        frame: usize,
        /// Label that was prompted.
        label: LabelId,
        /// Message in one line: why, and what to do.
        text: String,
    },
    /// The labelled cloud was loaded, made or removed.
    CloudChanged,
    /// The conflicts of masks with the cloud were computed.
    ConflictsChanged,
    /// A network was installed or added.
    ModelsChanged,
    /// The sparse model of the cameras was loaded.
    SparseChanged,
    /// An export was written.
    Exported(Vec<ExportedItem>),
    /// Information for the user, e.g. which tracker was selected.
    Notice(String),
    /// A problem that the user should check; the work went on.
    Warning(String),
}

/// A file or folder that an export wrote.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportedItem {
    /// The file or folder.
    pub path: PathBuf,
    /// Number of files in a folder; `None` for a file.
    pub files: Option<usize>,
    /// Size in bytes, for a folder of all its files.
    pub bytes: u64,
}

/// A running job, as window and command line show it.
#[derive(Debug, Clone, PartialEq)]
pub struct JobView {
    /// Id of the job.
    pub id: JobId,
    /// Title to display.
    pub title: String,
    /// Task by which panels find the job.
    pub task: Option<JobTask>,
    /// Progress of the current stage.
    pub report: ProgressReport,
    /// Progress over all stages.
    pub overview: Overview,
    /// Time since its start.
    pub elapsed: Duration,
}
