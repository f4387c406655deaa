use std::io::{Error, ErrorKind};

/// What happened to a file that was read, and what to do, to be said after its path.
#[must_use]
pub fn read_fault(error: &Error) -> String {
    fault_of_full_disk(error).unwrap_or_else(|| {
        format!("cannot be read ({error}); check that it exists and may be read")
    })
}

/// The same for a file that was written.
#[must_use]
pub fn write_fault(error: &Error) -> String {
    fault_of_full_disk(error).unwrap_or_else(|| {
        format!("cannot be written ({error}); check that its folder exists and may be written")
    })
}

/// The same where both may be.
#[must_use]
pub fn fault(error: &Error) -> String {
    fault_of_full_disk(error).unwrap_or_else(|| {
        format!("cannot be read or written ({error}); check that it exists and its permissions")
    })
}

/// A fault that only writing has.
fn fault_of_full_disk(error: &Error) -> Option<String> {
    let remedy = match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            "free some space there, or choose another place"
        }
        ErrorKind::FileTooLarge => {
            "the file is larger than the system allows; choose another disk or raise the limit"
        }
        ErrorKind::ReadOnlyFilesystem => "choose a place that may be written",
        _ => return None,
    };
    Some(format!("cannot be written ({error}); {remedy}"))
}

/// The error without the name of a temporary file, which `tempfile` adds: it is of no use to anybody.
pub(super) fn without_path(error: Error) -> Error {
    let text = error.to_string();
    match text.rfind(" at path \"") {
        Some(end) => Error::new(error.kind(), text[..end].to_owned()),
        None => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_not_taken_for_a_missing_file() {
        let full = Error::from(ErrorKind::StorageFull);
        for said in [read_fault(&full), write_fault(&full), fault(&full)] {
            assert!(
                said.starts_with("cannot be written (") && said.contains("free some space"),
                "{said}"
            );
        }
        let missing = Error::from(ErrorKind::NotFound);
        assert!(read_fault(&missing).contains("check that it exists"));
        assert!(write_fault(&missing).starts_with("cannot be written ("));
    }

    #[test]
    fn temporary_names_are_left_out() {
        let missing = tempfile::tempdir().unwrap().path().join("gone");
        let error = tempfile::Builder::new().tempfile_in(missing).unwrap_err();
        assert!(error.to_string().contains("gone"));
        let plain = without_path(error);
        assert!(
            plain.kind() == ErrorKind::NotFound && !plain.to_string().contains("gone"),
            "{plain}"
        );
    }
}
