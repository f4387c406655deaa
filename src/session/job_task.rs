//! Titles of running jobs, and tasks by which panels find them.

/// Work that panels look up while it runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JobTask {
    /// Propagating masks.
    Track,
    /// Computing cameras and depth maps.
    Reconstruct,
    /// Fusing depth maps and labelling the points.
    Fuse,
    /// Finding objects by text.
    FindByText,
    /// Finding unlabelled objects.
    Suggest,
    /// Proposing the objects of a frame.
    Propose,
    /// Measuring the traits of all labels.
    MeasureTraits,
    /// Measuring the angle between labels.
    MeasureAngles,
    /// Making the example project.
    Example,
    /// Installing, adding or checking the network of this name.
    Network(String),
}

impl JobTask {
    /// Returns the title of the job.
    #[must_use]
    pub fn title(&self) -> &str {
        match self {
            Self::Track => "Track",
            Self::Reconstruct => "Reconstruct",
            Self::Fuse => "Fuse",
            Self::FindByText => "Find by text",
            Self::Suggest => "Suggest",
            Self::Propose => "Propose",
            Self::MeasureTraits => "Measure",
            Self::MeasureAngles => "Measure angles",
            Self::Example => "Make the example",
            Self::Network(name) => name,
        }
    }
}

/// The title of a job, and the task by which panels find it.
#[derive(Debug, Clone)]
pub struct JobTitle {
    /// Title to display.
    pub text: String,
    /// Task of the job; `None` for work that no panel looks up.
    pub task: Option<JobTask>,
}

impl From<&str> for JobTitle {
    fn from(text: &str) -> Self {
        Self {
            text: text.to_owned(),
            task: None,
        }
    }
}

impl From<JobTask> for JobTitle {
    fn from(task: JobTask) -> Self {
        Self {
            text: task.title().to_owned(),
            task: Some(task),
        }
    }
}
