//! Getting the files of a network: by a download, or from a folder of downloaded files.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use super::digests::sha256;
use super::download::{DownloadRequest, fetch};
use super::error::NnError;
use super::mirror::mirrored;
use super::network_file::{FileAddress, NetworkFile};
use super::records::EntryRecord;
use super::unpack::{gunzip, unzip};

/// Progress of a download.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fetched<'a> {
    /// Name of the file and its licence.
    pub what: &'a str,
    /// Number of bytes present.
    pub bytes: u64,
    /// Total number of bytes, if known.
    pub of: Option<u64>,
}

/// Maximum size of a file whose length is not known, in bytes.
const MAX_BYTES: u64 = 4 << 30;

/// How the files of one network are obtained.
pub(super) struct Supply<'a> {
    /// Name of the network.
    pub network: &'a str,
    /// Licence, shown during a download.
    pub licence: &'a str,
    /// Folder for unfinished downloads of the network.
    pub downloads: &'a Path,
    /// Folder with files that were downloaded by other means; nothing is downloaded then.
    pub from: Option<&'a Path>,
    /// What is remembered about the network.
    pub record: &'a EntryRecord,
}

/// Digest of a file for which none was known before.
pub(super) struct FirstDigest {
    pub url: String,
    pub sha256: String,
}

/// What a downloaded file should be.
struct Expected<'a> {
    bytes: Option<u64>,
    sha256: Option<&'a str>,
}

impl Supply<'_> {
    /// Gets a file into the folder of downloads, under its name in the catalogue.
    ///
    /// The addresses are tried in their order; the next is tried if a server does not answer. A file
    /// with another digest is an error. A file that is already there is only verified.
    ///
    /// Returns the path, and the digest if the catalogue has none.
    pub fn obtain(
        &self,
        file: &NetworkFile,
        progress: &mut dyn FnMut(Fetched<'_>) -> bool,
    ) -> Result<(PathBuf, Option<FirstDigest>), NnError> {
        let into = self.downloads.join(&file.name);
        if let Some(expected) = file.sha256.as_deref().filter(|_| into.is_file()) {
            if digest(&into)? == expected {
                return Ok((into, None));
            }
            remove(&into)?;
        }
        let mut unreachable = Vec::new();
        for address in &file.addresses {
            match self.obtain_from(address, file, &into, progress) {
                Ok(first) => return Ok((into, first)),
                Err(
                    error @ NnError::Fetch {
                        is_stopped: false, ..
                    },
                ) => unreachable.push(error),
                Err(error) => return Err(error),
            }
        }
        Err(unreachable.pop().unwrap_or_else(|| {
            NnError::Request(format!("{}: has no address to be fetched from", file.name))
        }))
    }

    fn obtain_from(
        &self,
        address: &FileAddress,
        file: &NetworkFile,
        into: &Path,
        progress: &mut dyn FnMut(Fetched<'_>) -> bool,
    ) -> Result<Option<FirstDigest>, NnError> {
        let of_file = Expected {
            bytes: file.bytes,
            sha256: file.sha256.as_deref(),
        };
        if !address.is_packed() {
            let given = self.bring(address, &of_file, file, into, progress)?;
            return self.verify(address, &of_file, into, given.as_deref());
        }
        let of_archive = Expected {
            bytes: address.bytes,
            sha256: address.sha256.as_deref(),
        };
        // Members of the same archive share its download.
        let archive = self
            .downloads
            .join(format!("archive-{}", address.file_name()));
        let mut first = None;
        if !archive.is_file() {
            let given = self.bring(address, &of_archive, file, &archive, progress)?;
            first = self.verify(address, &of_archive, &archive, given.as_deref())?;
        } else if let Some(expected) = of_archive.sha256
            && digest(&archive)? != expected
        {
            remove(&archive)?;
            return self.obtain_from(address, file, into, progress);
        }
        unpack(address, &archive, file.bytes, into)?;
        if let Some(expected) = of_file.sha256 {
            let found = digest(into)?;
            if found != expected {
                remove(into)?;
                return Err(wrong_download(address, expected, found));
            }
        }
        Ok(first)
    }

    /// Downloads a file, or copies it from the folder; returns the path of the original.
    fn bring(
        &self,
        address: &FileAddress,
        expected: &Expected<'_>,
        file: &NetworkFile,
        into: &Path,
        progress: &mut dyn FnMut(Fetched<'_>) -> bool,
    ) -> Result<Option<PathBuf>, NnError> {
        if into.is_file() {
            return Ok(None);
        }
        if let Some(folder) = self.from {
            let found = self.found_in(folder, address, file)?;
            fs::copy(&found, into).map_err(|reason| NnError::Io {
                path: found.clone(),
                reason,
            })?;
            return Ok(Some(found));
        }
        let what = format!("{} ({})", file.name, self.licence);
        let limit = expected.bytes.unwrap_or(MAX_BYTES);
        let url = mirrored(&address.url)?;
        // A member of an archive without a digest may have one.
        let has_known_digest = self.expected_digest(address, expected).is_some()
            || (address.is_packed() && file.sha256.is_some());
        let request = DownloadRequest {
            url: &url,
            into,
            limit,
            has_known_digest,
        };
        fetch(&request, &mut |bytes| {
            progress(Fetched {
                what: &what,
                bytes,
                of: expected.bytes,
            })
        })?;
        Ok(None)
    }

    /// Returns the file of an address in a folder of downloaded files.
    ///
    /// It is found by its place on the server (as `wget --force-directories` saves it), by the last
    /// part of its address, or by its name in the catalogue.
    fn found_in(
        &self,
        folder: &Path,
        address: &FileAddress,
        file: &NetworkFile,
    ) -> Result<PathBuf, NnError> {
        let on_server = address.url.trim_start_matches("https://");
        let mut names = vec![on_server, address.file_name()];
        if !address.is_packed() {
            names.push(&file.name);
        }
        let found = names
            .iter()
            .map(|name| folder.join(name))
            .find(|path| path.is_file());
        found.ok_or_else(|| {
            NnError::Request(format!(
                "{}: has no `{}`; download {} into it (`ostra models addresses {}` lists all files)",
                folder.display(),
                address.file_name(),
                address.url,
                self.network
            ))
        })
    }

    /// Returns the digest of the catalogue, or that of the first download.
    fn expected_digest<'b>(
        &'b self,
        address: &FileAddress,
        expected: &Expected<'b>,
    ) -> Option<&'b str> {
        let recorded = self.record.first_downloads.get(&address.url);
        expected.sha256.or(recorded.map(String::as_str))
    }

    /// Compares a digest; a download with another digest is deleted.
    ///
    /// `given` is the file of which `path` is a copy.
    fn verify(
        &self,
        address: &FileAddress,
        expected: &Expected<'_>,
        path: &Path,
        given: Option<&Path>,
    ) -> Result<Option<FirstDigest>, NnError> {
        let found = digest(path)?;
        let Some(expected) = self.expected_digest(address, expected) else {
            let url = address.url.clone();
            return Ok(Some(FirstDigest { url, sha256: found }));
        };
        if found == expected {
            return Ok(None);
        }
        remove(path)?;
        Err(match given {
            Some(given) => NnError::Digest {
                path: given.to_owned(),
                expected: expected.to_owned(),
                found,
            },
            None => wrong_download(address, expected, found),
        })
    }
}

fn unpack(
    address: &FileAddress,
    archive: &Path,
    limit: Option<u64>,
    into: &Path,
) -> Result<(), NnError> {
    let mut file = File::create(into).map_err(|reason| NnError::Io {
        path: into.to_owned(),
        reason,
    })?;
    let unpacked = match &address.member {
        Some(member) => unzip(archive, member, limit, &mut file),
        None => gunzip(archive, limit, &mut file),
    };
    unpacked.map_err(|error| {
        // Nothing half-unpacked is taken for a complete file by the next call.
        let _ = fs::remove_file(into);
        let _ = fs::remove_file(archive);
        if matches!(
            error.kind(),
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded
        ) {
            return NnError::Io {
                path: into.to_owned(),
                reason: error,
            };
        }
        NnError::Request(format!(
            "{}: cannot be unpacked ({error}); it was deleted and nothing was installed; try again",
            address.url
        ))
    })
}

fn wrong_download(address: &FileAddress, expected: &str, found: String) -> NnError {
    NnError::WrongDownload {
        url: address.url.clone(),
        expected: expected.to_owned(),
        found,
    }
}

fn digest(path: &Path) -> Result<String, NnError> {
    sha256(path).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })
}

fn remove(path: &Path) -> Result<(), NnError> {
    fs::remove_file(path).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })
}
