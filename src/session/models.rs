use crate::job_task::{JobTask, JobTitle};
use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::jobs::Job;
use crate::requests::{ModelRequest, ModelTask};
use crate::{Command, Event, JobCompletion, JobKind, Session};
use ostra_compute::nn::{
    Added, Catalogue, CheckedFile, Fetched, Proof, Row, add, check, install, list, models_folder,
};
use ostra_core::job::JobId;
use ostra_core::job::{Progress, Stopped};

/// Every network that is known, and whether it is installed.
///
/// # Errors
/// When the system has no data folder.
pub fn list_models() -> Result<Vec<Row>> {
    Ok(list(&Catalogue::bundled()?, &models_folder()?))
}

/// Takes a network (or ONNX Runtime) from files into our data folder, after checking it.
///
/// # Errors
/// When the name is unknown, a file is not what it should be, or cannot be copied.
pub fn add_model(name: &str, files: &[PathBuf]) -> Result<Vec<Added>> {
    Ok(add(&Catalogue::bundled()?, &models_folder()?, name, files)?)
}

/// Loads an installed network and tells what it takes and gives.
///
/// # Errors
/// When it is not installed, does not load or has another interface.
pub fn check_model(name: &str) -> Result<Vec<CheckedFile>> {
    Ok(check(&Catalogue::bundled()?, &models_folder()?, name)?)
}

/// Gets a network (or ONNX Runtime) from the net into our data folder and checks it; `told` hears how far it is and whether
/// to go on. What a broken download left is continued.
///
/// # Errors
/// When the name is unknown, it has no address, a download fails, or a file is not what it should be.
pub fn install_model(name: &str, told: &mut dyn FnMut(Fetched<'_>) -> bool) -> Result<Vec<Added>> {
    Ok(install(
        &Catalogue::bundled()?,
        &models_folder()?,
        name,
        told,
    )?)
}

impl Session {
    /// Does what is wanted of a network, beside all other jobs; files that could not be checked are told as warnings.
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

/// Does it; returns what could not be checked, and why.
fn done(request: &ModelRequest, progress: &Progress) -> Result<Vec<String>> {
    let name = &request.name;
    let added = match &request.task {
        ModelTask::Install => install_model(name, &mut |now| told(now, progress).is_ok())?,
        ModelTask::Add(files) => add_model(name, files)?,
        ModelTask::Check => {
            check_model(name)?;
            Vec::new()
        }
    };
    let unchecked = |added: Added| match added.proof {
        Proof::None(why) => Some(format!("{}: added unchecked: {why}", added.path.display())),
        Proof::Fits | Proof::Loads | Proof::Known => None,
    };
    Ok(added.into_iter().filter_map(unchecked).collect())
}

/// Tells how many megabytes of a download are there.
fn told(now: Fetched<'_>, progress: &Progress) -> Result<(), Stopped> {
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
