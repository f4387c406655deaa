use crate::job_task::{JobTask, JobTitle};
use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::jobs::Job;
use crate::network_test::{NetworkTest, test_network};
use crate::requests::{ModelRequest, ModelTask};
use crate::{Command, Event, JobCompletion, JobKind, Session};
use ostra_compute::nn::{
    Added, Catalogue, CheckedFile, Fetched, InstallOptions, ListedAddress, ModelStatus, Runtime,
    Verification, add, addresses, check, install, list, models_folder, record_test, remove,
};
use ostra_core::job::JobId;
use ostra_core::job::{Progress, Stopped};

/// Returns every known network, and whether it is installed.
///
/// # Errors
///
/// Returns an error if the system has no data folder.
pub fn list_models() -> Result<Vec<ModelStatus>> {
    Ok(list(&Catalogue::load()?, &models_folder()?))
}

/// Returns the files to download for a network, or for all that can be downloaded.
///
/// # Errors
///
/// Returns an error if the name is unknown, or the network has no download address.
pub fn list_addresses(name: Option<&str>) -> Result<Vec<ListedAddress>> {
    Ok(addresses(&Catalogue::load()?, name)?)
}

/// Copies a network (or ONNX Runtime) from files to the data folder, after checking it.
///
/// # Errors
///
/// Returns an error if the name is unknown, or a file is not the expected one or cannot be copied.
pub fn add_model(name: &str, files: &[PathBuf]) -> Result<Vec<Added>> {
    Ok(add(&Catalogue::load()?, &models_folder()?, name, files)?)
}

/// Loads an installed network and returns its inputs and outputs.
///
/// # Errors
///
/// Returns an error if it is not installed, cannot be loaded or has another interface.
pub fn check_model(name: &str) -> Result<Vec<CheckedFile>> {
    Ok(check(&Catalogue::load()?, &models_folder()?, name)?)
}

/// Deletes the files of a network and returns them.
///
/// # Errors
///
/// Returns an error if the name is unknown, nothing is installed, or a file cannot be deleted.
pub fn remove_model(name: &str) -> Result<Vec<PathBuf>> {
    Ok(remove(&Catalogue::load()?, &models_folder()?, name)?)
}

/// Downloads a network (or ONNX Runtime) to the data folder and checks it.
///
/// `reported` receives the progress and returns whether to continue. An interrupted download is
/// resumed.
///
/// # Errors
///
/// Returns an error if the name is unknown, it has no download address, a download fails, or a file
/// is not the expected one.
pub fn install_model(
    name: &str,
    options: &InstallOptions,
    reported: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<Vec<Added>> {
    Ok(install(
        &Catalogue::load()?,
        &models_folder()?,
        name,
        options,
        reported,
    )?)
}

/// Asks an installed network questions with known answers, and remembers the result.
///
/// A network whose answers are wrong is not used.
///
/// # Errors
///
/// Returns an error if the network is unknown or not installed, or the test is stopped.
pub fn test_model(name: &str, progress: &Progress) -> Result<NetworkTest> {
    let (catalogue, folder) = (Catalogue::load()?, models_folder()?);
    let entry = catalogue.entry(name)?;
    if entry.is_library() {
        check(&catalogue, &folder, name)?;
        return Ok(NetworkTest::Passed("it loads".to_owned()));
    }
    if entry.installed(&folder).is_none() {
        check(&catalogue, &folder, name)?;
    }
    if let Err(error) = Runtime::find() {
        return Ok(NetworkTest::Untested(error.to_string()));
    }
    let is_usable = |other: &str| {
        let other = catalogue.entry(other);
        other.is_ok_and(|other| other.is_usable(&folder))
    };
    let outcome = test_network(&folder, name, &is_usable, progress)?;
    if let Some(result) = outcome.result() {
        record_test(&catalogue, &folder, name, &result)?;
    }
    Ok(outcome)
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

/// Executes the request, and returns what the user has to know: files that could not be checked,
/// with the reason, and a failed test.
fn done(request: &ModelRequest, progress: &Progress) -> Result<Vec<String>> {
    let name = &request.name;
    let added = match &request.task {
        ModelTask::Install(wanted) => {
            let options = InstallOptions {
                variant: wanted.variant.clone(),
                from: None,
                accept_licence: wanted.accept_licence,
            };
            install_model(name, &options, &mut |now| reported(now, progress).is_ok())?
        }
        ModelTask::Add(files) => add_model(name, files)?,
        ModelTask::Check => {
            check_model(name)?;
            Vec::new()
        }
        ModelTask::Remove => {
            remove_model(name)?;
            return Ok(Vec::new());
        }
    };
    let unchecked = |added: Added| match added.proof {
        Verification::None(why) => {
            Some(format!("{}: added unchecked: {why}", added.path.display()))
        }
        Verification::Fits | Verification::Loads | Verification::Known => None,
    };
    let mut warnings: Vec<String> = added.into_iter().filter_map(unchecked).collect();
    progress.stage(&format!("Test {name}"))?;
    match test_model(name, progress)? {
        NetworkTest::Failed(what) => warnings.push(failed_test_text(name, &what)),
        NetworkTest::NotRun(why) => warnings.push(not_run_text(name, &why)),
        NetworkTest::Passed(_) | NetworkTest::Untested(_) => {}
    }
    Ok(warnings)
}

/// Returns what a failed test means.
#[must_use]
pub fn failed_test_text(name: &str, what: &str) -> String {
    format!(
        "`{name}` failed its test ({what}) and is not used; remove it with `ostra models remove {name}`"
    )
}

/// Returns what it means that a network did not run in its test.
#[must_use]
pub fn not_run_text(name: &str, why: &str) -> String {
    format!(
        "`{name}` could not be tested, as it did not run ({why}); test it again with `ostra models test {name}`"
    )
}

/// Reports how many megabytes of a download have arrived.
fn reported(now: Fetched<'_>, progress: &Progress) -> Result<(), Stopped> {
    let megabytes = |bytes: u64| usize::try_from(bytes / 1_000_000).unwrap_or(usize::MAX);
    let (what, there) = (now.what, megabytes(now.bytes));
    match now.of {
        Some(all) => {
            progress.stage(&format!("Download {what}"))?;
            progress.step(there, megabytes(all).max(1))
        }
        None => progress.stage(&format!("Download {what}, {there} MB")),
    }
}
