//! Rules for where exports may write.
//!
//! An export never overwrites a source, writes into a project, or replaces files that OSTRA did not
//! write.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, bail};

use crate::Project;
use crate::export_record::{
    ExportClaim, ExportFileState, ExportRecord, FileId, RECORD, Stamp, WHOLE_FOLDER, files_below,
    is_being_written, lock_folder, name_below,
};
use ostra_core::disk;

/// Tolerance for a file system clock that lags behind the system clock.
///
/// It is safe because files with the names of the export did not exist before it.
const CLOCK_LAG: Duration = Duration::from_secs(1);

/// How the user replaces exports that may hold others' work, for error messages.
const HOW: &str = "by --overwrite ('Replace changed exports' in the window)";

/// Paths that an export must not touch, and whether it may replace an earlier export.
#[derive(Debug, Clone, Default)]
pub struct ExportTargets {
    /// Path of each source, by its identity.
    sources: BTreeMap<FileId, PathBuf>,
    /// The project's folder, with links resolved.
    root: Option<PathBuf>,
    /// Whether files of an earlier export that were changed since may be replaced.
    overwrite: bool,
}

impl ExportTargets {
    /// Creates the targets for exports of a project; `root` is the project's folder.
    #[must_use]
    pub fn of(project: &Project, root: Option<&Path>, overwrite: bool) -> Self {
        let mut paths: Vec<&Path> = Vec::new();
        let mut sources = BTreeMap::new();
        for frame in &*project.frames {
            let depth = frame.depth.as_ref().and_then(|depth| depth.sensor_path());
            paths.extend([Some(frame.image.path()), depth].into_iter().flatten());
        }
        let requests = project
            .results
            .values()
            .filter_map(|record| record.request.as_ref());
        paths.extend(requests.filter_map(|request| request.onto.as_deref()));
        for path in paths {
            if let Some(id) = FileId::of(path) {
                sources.entry(id).or_insert_with(|| path.to_owned());
            }
        }
        let root = root.map(|root| root.canonicalize().unwrap_or_else(|_| root.to_owned()));
        Self {
            sources,
            root,
            overwrite,
        }
    }

    /// Checks that an export may write these files.
    ///
    /// Missing files and empty files may always be written.
    ///
    /// # Errors
    ///
    /// Returns an error if a file must not be replaced. The one-line message names the file, the
    /// reason, and what to do.
    pub fn check_files<'a>(&self, files: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        let mut taken: BTreeMap<String, &Path> = BTreeMap::new();
        let mut records: BTreeMap<PathBuf, ExportRecord> = BTreeMap::new();
        for file in files {
            // Names that differ only in case are the same file on many systems.
            if let Some(other) = taken.insert(file.to_string_lossy().to_lowercase(), file) {
                bail!(
                    "{} and {} would be the same file; choose another name for one of them",
                    other.display(),
                    file.display()
                );
            }
            let folder = folder_of(file);
            let record = records
                .entry(folder.to_owned())
                .or_insert_with(|| ExportRecord::read(folder, RECORD));
            self.check_file(file, folder, record)?;
        }
        Ok(())
    }

    fn check_file(&self, file: &Path, folder: &Path, record: &ExportRecord) -> Result<()> {
        self.check_outside(file)?;
        let Ok(found) = fs::symlink_metadata(file) else {
            return Ok(());
        };
        self.check_source(file)?;
        if !found.is_file() {
            let what = if found.is_dir() {
                "a folder"
            } else {
                "a link or a device, not a regular file"
            };
            bail!("{}: is {what}; choose another name", file.display());
        }
        match record.state_of(folder, file) {
            Some(ExportFileState::Unchanged) => Ok(()),
            Some(_) if self.overwrite => Ok(()),
            Some(ExportFileState::Changed) => {
                bail!(
                    "{}: was changed since it was exported; choose another name, or replace it {HOW}",
                    file.display()
                )
            }
            Some(ExportFileState::Interrupted)
                if name_below(folder, file).is_some_and(|name| is_being_written(folder, &name)) =>
            {
                bail!(
                    "{}: another export writes here now; start this one when that has ended",
                    file.display()
                )
            }
            Some(ExportFileState::Interrupted) => bail!(
                "{}: an interrupted export may have left it; choose another name, or replace it {HOW}",
                file.display()
            ),
            None if found.len() == 0 => Ok(()),
            None => bail!(
                "{}: exists and is not a known export of OSTRA; choose another name, or move the file away",
                file.display()
            ),
        }
    }

    /// Checks that an export may write into a folder.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder holds files that OSTRA did not export, or belongs to a
    /// project. The one-line message names the folder, the first such file, and what to do.
    pub fn check_folder(&self, folder: &Path) -> Result<()> {
        self.check_outside(folder)?;
        match fs::metadata(folder) {
            Err(_) => return Ok(()),
            Ok(found) if !found.is_dir() => {
                bail!("{}: is not a folder; choose another name", folder.display())
            }
            Ok(_) => {}
        }
        if is_being_written(folder, WHOLE_FOLDER) {
            bail!(
                "{}: another export writes here now; start this one when that has ended",
                folder.display()
            );
        }
        let record = ExportRecord::read(folder, RECORD);
        let (mut others, mut changed) = (Vec::new(), Vec::new());
        for file in files_below(folder)? {
            self.check_source(&file)?;
            match record.state_of(folder, &file) {
                Some(ExportFileState::Unchanged) => {}
                Some(known) => changed.push((file, known)),
                None => others.push(file),
            }
        }
        if let Some(first) = others.first() {
            bail!(
                "{}: holds {} that OSTRA did not export ({}); choose a new or empty folder",
                folder.display(),
                count(others.len()),
                first.display()
            );
        }
        if let Some((first, known)) = changed.first().filter(|_| !self.overwrite) {
            let what = match known {
                ExportFileState::Interrupted => "left by an interrupted export, or put there since",
                _ => "changed since the export",
            };
            bail!(
                "{}: {} {what} ({}); choose another folder, or replace them {HOW}",
                folder.display(),
                count(changed.len()),
                first.display()
            );
        }
        Ok(())
    }

    fn check_source(&self, file: &Path) -> Result<()> {
        match FileId::of(file).and_then(|id| self.sources.get(&id)) {
            Some(source) => bail!(
                "{}: is a source of the project ({}), which is never changed; choose another place",
                file.display(),
                source.display()
            ),
            None => Ok(()),
        }
    }

    fn check_outside(&self, target: &Path) -> Result<()> {
        let place = resolved(target);
        let project = self
            .root
            .clone()
            .filter(|root| place.starts_with(root))
            .or_else(|| {
                // Exports must not go into other projects either.
                place
                    .ancestors()
                    .skip(1)
                    .find(|above| above.join("project.toml").is_file())
                    .map(Path::to_owned)
            });
        match project {
            Some(root) => bail!(
                "{}: lies inside the project folder {}; choose a place outside it",
                target.display(),
                root.display()
            ),
            None => Ok(()),
        }
    }

    /// Exports files with `write`, which may skip some of them.
    ///
    /// The targets must have been checked. The files that were written are recorded as exports,
    /// even if `write` fails.
    ///
    /// # Errors
    ///
    /// Returns an error if `write` fails, a folder cannot be created, or the written files cannot
    /// be recorded.
    pub fn write_files<T>(files: &[PathBuf], write: impl FnOnce() -> Result<T>) -> Result<T> {
        let (written, ended) = write_noted(files, &[], write);
        let written = written?;
        ended.map(|_| written)
    }

    /// Exports files and whole folders with `write`.
    ///
    /// On success, files of an earlier export that remain in these folders are removed. The
    /// returned warnings say how many files were removed from which folder.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Self::write_files`].
    pub fn write_all<T>(
        files: &[PathBuf],
        folders: &[PathBuf],
        write: impl FnOnce() -> Result<T>,
    ) -> Result<(T, Vec<String>)> {
        let (written, ended) = write_noted(files, folders, write);
        let written = written?;
        let warnings = ended.unwrap_or_else(|error| {
            vec![format!("{error:#}; the exports are complete, but to replace them --overwrite will be needed")]
        });
        Ok((written, warnings))
    }
}

/// Returns the result of `write` and the warnings of [`end`].
fn write_noted<T>(
    files: &[PathBuf],
    folders: &[PathBuf],
    write: impl FnOnce() -> Result<T>,
) -> (Result<T>, Result<Vec<String>>) {
    let before = stamps(files.iter().cloned());
    let begun = match begin(files, folders) {
        Ok(begun) => begun,
        Err(error) => return (Err(error), Ok(Vec::new())),
    };
    let written = write();
    let ended = end(files, &before, begun, written.is_ok());
    (written, ended)
}

fn stamps(files: impl IntoIterator<Item = PathBuf>) -> BTreeMap<PathBuf, Stamp> {
    files
        .into_iter()
        .filter_map(|file| Stamp::of(&file).map(|stamp| (file, stamp)))
        .collect()
}

/// A folder that receives exports.
struct Begun {
    folder: PathBuf,
    claim: ExportClaim,
    /// The files in it before the export, if all of its files are exports.
    whole: Option<BTreeMap<PathBuf, Stamp>>,
}

/// Records and claims the files that are about to be written.
///
/// The record shows which files a killed export may have left. The claim keeps other exports from
/// writing them at the same time.
fn begin(files: &[PathBuf], folders: &[PathBuf]) -> Result<Vec<Begun>> {
    let mut names: BTreeMap<&Path, Vec<String>> = BTreeMap::new();
    for file in files {
        let folder = folder_of(file);
        names
            .entry(folder)
            .or_default()
            .extend(name_below(folder, file));
    }
    for folder in folders {
        names
            .entry(folder)
            .or_default()
            .push(WHOLE_FOLDER.to_owned());
    }
    let begin_folder = |(folder, names): (&Path, Vec<String>)| -> Result<Begun> {
        let is_whole = names.iter().any(|name| name == WHOLE_FOLDER);
        fs::create_dir_all(folder)
            .with_context(|| format!("{}: cannot be made; check permissions", folder.display()))?;
        let _locked = lock_folder(folder)?;
        disk::remove_leftovers(folder, is_whole);
        let claim = ExportClaim::take(folder, &names)?;
        let mut record = ExportRecord::read(folder, RECORD);
        record
            .pending
            .extend(names.into_iter().map(|name| (name, now_ns())));
        record.write(folder, RECORD)?;
        let whole = is_whole
            .then(|| files_below(folder).map(stamps))
            .transpose()?;
        Ok(Begun {
            folder: folder.to_owned(),
            claim,
            whole,
        })
    };
    names.into_iter().map(begin_folder).collect()
}

/// Records the files that differ from their state before the export.
fn end(
    files: &[PathBuf],
    before: &BTreeMap<PathBuf, Stamp>,
    begun: Vec<Begun>,
    is_complete: bool,
) -> Result<Vec<String>> {
    let mut warnings = Vec::new();
    for Begun {
        folder,
        claim,
        whole,
    } in begun
    {
        let _locked = lock_folder(&folder)?;
        // Frees the disk space that the record needs.
        drop(claim);
        disk::remove_leftovers(&folder, whole.is_some());
        let mut record = ExportRecord::read(&folder, RECORD);
        for file in files.iter().filter(|file| folder_of(file) == folder) {
            name_below(&folder, file).map(|name| record.pending.remove(&name));
            if is_written(before, file) {
                record.add(&folder, file);
            }
        }
        if let Some(before) = whole {
            record.pending.remove(WHOLE_FOLDER);
            warnings.extend(end_folder(&folder, &mut record, &before, is_complete)?);
        }
        record.write(&folder, RECORD)?;
    }
    Ok(warnings)
}

/// Records the files written into a folder that holds only exports.
///
/// If the export is complete, removes what an earlier export left there, and returns a warning
/// about it.
fn end_folder(
    folder: &Path,
    record: &mut ExportRecord,
    before: &BTreeMap<PathBuf, Stamp>,
    is_complete: bool,
) -> Result<Option<String>> {
    let (written, former): (Vec<_>, Vec<_>) = files_below(folder)?
        .into_iter()
        .partition(|file| is_written(before, file));
    let mut warning = None;
    if is_complete {
        let removed: Vec<&PathBuf> = former
            .iter()
            .filter(|file| fs::remove_file(file).is_ok())
            .collect();
        record.files.clear();
        warning = removed.first().map(|first| {
            let (count, first) = (count(removed.len()), first.display());
            format!(
                "{}: {count} of an earlier export removed ({first})",
                folder.display()
            )
        });
    }
    written.iter().for_each(|file| record.add(folder, file));
    Ok(warning)
}

fn is_written(before: &BTreeMap<PathBuf, Stamp>, file: &Path) -> bool {
    Stamp::of(file).is_some_and(|stamp| before.get(file) != Some(&stamp))
}

/// Returns the current time minus [`CLOCK_LAG`], in nanoseconds since 1970.
fn now_ns() -> u128 {
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    now.saturating_sub(CLOCK_LAG).as_nanos()
}

fn count(files: usize) -> String {
    if files == 1 {
        "1 file".into()
    } else {
        format!("{files} files")
    }
}

fn folder_of(file: &Path) -> &Path {
    file.parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

/// Returns the absolute form of a path that may not exist yet.
///
/// `..` and the links in its existing part are resolved.
fn resolved(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut place = PathBuf::new();
    for part in absolute.components() {
        match part {
            Component::ParentDir => {
                place.pop();
            }
            part => place.push(part),
        }
        if let Ok(real) = place.canonicalize() {
            place = real;
        }
    }
    place
}

#[cfg(test)]
mod tests;
