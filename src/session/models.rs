use crate::job_task::{JobTask, JobTitle};
use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::jobs::Job;
use crate::requests::{ModelRequest, ModelTask};
use crate::{Command, Event, JobCompletion, JobKind, Session};
use ostra_compute::nn::{
    Added, Catalogue, CheckedFile, Fetched, ModelStatus, Verification, add, check, install, list,
    models_folder,
};
use ostra_core::job::JobId;
use ostra_core::job::{Progress, Stopped};

/// Returns every known network, and whether it is installed.
///
/// # Errors
///
/// Returns an error if the system has no data folder.
pub fn list_models() -> Result<Vec<ModelStatus>> {
    Ok(list(&Catalogue::bundled()?, &models_folder()?))
}

/// Copies a network (or ONNX Runtime) from files to the data folder, after checking it.
///
/// # Errors
///
/// Returns an error if the name is unknown, or a file is not the expected one or cannot be copied.
pub fn add_model(name: &str, files: &[PathBuf]) -> Result<Vec<Added>> {
    Ok(add(&Catalogue::bundled()?, &models_folder()?, name, files)?)
}

/// Loads an installed network and returns its inputs and outputs.
///
/// # Errors
///
/// Returns an error if it is not installed, cannot be loaded or has another interface.
pub fn check_model(name: &str) -> Result<Vec<CheckedFile>> {
    Ok(check(&Catalogue::bundled()?, &models_folder()?, name)?)
}

/// Downloads a network (or ONNX Runtime) to the data folder and checks it.
///
/// `told` receives the progress and returns whether to continue. An interrupted download is
/// resumed.
///
/// # Errors
///
/// Returns an error if the name is unknown, it has no download address, a download fails, or a file
/// is not the expected one.
pub fn install_model(
    name: &str,
    reported: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<Vec<Added>> {
    Ok(install(
        &Catalogue::bundled()?,
        &models_folder()?,
        name,
        reported,
    )?)
}

impl Session {
    /// Starts a job that changes a network, next to all other jobs.
    ///
    /// Files that could not be checked are reported as warnings.
    pub(crate) fn change_model(&mut self, request: &ModelRequest) -> Result<JobId> {
        let title = request.title();
        let is_same = |job: &Job<Self>| matches!(&job.command, Some(Command::Model(other)) if other.is_same_work(request));
        ensure!(
            !self.jobs.iter().any(is_same),
            "'{title}' is still running; wait for it or stop it"
        );
        let request = request.clone();
        let title = JobTitle {
            text: title,
            task: Some(JobTask::Network(request.name.clone())),
        };
        Ok(self.start(title, JobKind::Short, move |context| {
            let warnings = done(&request, &context.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.warn_all(warnings);
                session.events.push(Event::ModelsChanged);
                Ok(())
            }) as JobCompletion)
        }))
    }
}

/// Executes the request, and returns the files that could not be checked, with the reason.
fn done(request: &ModelRequest, progress: &Progress) -> Result<Vec<String>> {
    let name = &request.name;
    let added = match &request.task {
        ModelTask::Install => install_model(name, &mut |now| reported(now, progress).is_ok())?,
        ModelTask::Add(files) => add_model(name, files)?,
        ModelTask::Check => {
            check_model(name)?;
            Vec::new()
        }
    };
    let unchecked = |added: Added| match added.proof {
        Verification::None(why) => {
            Some(format!("{}: added unchecked: {why}", added.path.display()))
        }
        Verification::Fits | Verification::Loads | Verification::Known => None,
    };
    Ok(added.into_iter().filter_map(unchecked).collect())
}

/// Reports how many megabytes of a download have arrived.
fn reported(now: Fetched<'_>, progress: &Progress) -> Result<(), Stopped> {
    let megabytes = |bytes: u64| usize::try_from(bytes / 1_000_000).unwrap_or(usize::MAX);
    let there = megabytes(now.bytes);
    match now.of {
        Some(all) => {
            progress.stage(&format!("{}, MB", now.what))?;
            progress.step(there, megabytes(all).max(1))
        }
        None => progress.stage(&format!("{}, {there} MB", now.what)),
    }
}
