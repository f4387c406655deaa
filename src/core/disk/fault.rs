use std::io::{Error, ErrorKind};

/// Describes an error of reading a file and its remedy, to be shown after the file's path.
#[must_use]
pub fn read_fault(error: &Error) -> String {
    fault_of_full_disk(error).unwrap_or_else(|| {
        format!("cannot be read ({error}); check that it exists and may be read")
    })
}

/// Describes an error of writing a file and its remedy, to be shown after the file's path.
#[must_use]
pub fn write_fault(error: &Error) -> String {
    fault_of_full_disk(error).unwrap_or_else(|| {
        format!("cannot be written ({error}); check that its folder exists and may be written")
    })
}

/// Describes an error of reading or writing a file, to be shown after the file's path.
#[must_use]
pub fn fault(error: &Error) -> String {
    fault_of_full_disk(error).unwrap_or_else(|| {
        format!("cannot be read or written ({error}); check that it exists and its permissions")
    })
}

/// Describes errors that only writing can have.
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

/// Removes the name of a temporary file, which `tempfile` adds, from an error.
///
/// The name means nothing to the user.
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
    fn full_disk_is_not_reported_as_a_missing_file() {
        let full = Error::from(ErrorKind::StorageFull);
        for message in [read_fault(&full), write_fault(&full), fault(&full)] {
            assert!(
                message.starts_with("cannot be written (") && message.contains("free some space"),
                "{message}"
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
