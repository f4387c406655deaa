use std::fs::{self, File, FileType, Metadata};
use std::io::{BufRead, Error, ErrorKind, Read, Result};
use std::path::Path;

/// The byte-order mark of UTF-8, which Windows editors and some exporters put at the start of text.
const UTF8_MARK: &[u8] = b"\xef\xbb\xbf";
/// Maximum size of a text file: a COLMAP model of 100,000 images takes a tenth of it.
const MAX_TEXT_BYTES: u64 = 8 << 30;

/// Opens a regular file for reading.
///
/// Named pipes, devices, sockets and folders are rejected before they are opened, because opening
/// or reading one of them may block forever or never end.
///
/// # Errors
/// Fails if nothing is at `path`, it may not be read, or it is not a regular file.
pub fn open_regular(path: &Path) -> Result<File> {
    let kind = fs::metadata(path)?.file_type();
    if !kind.is_file() {
        let what = format!("it is {}, not a regular file", name_of(kind));
        return Err(Error::new(ErrorKind::InvalidInput, what));
    }
    File::open(path)
}

/// Reads a whole regular file.
///
/// # Errors
/// Same as [`open_regular`], and if reading fails.
pub fn read_regular(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_regular(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a whole regular file of at most `max_bytes`.
///
/// Larger files are rejected without reading them.
///
/// # Errors
/// Same as [`read_regular`]; [`ErrorKind::FileTooLarge`].
pub fn read_regular_up_to(path: &Path, max_bytes: u64) -> Result<Vec<u8>> {
    let file = open_regular(path)?;
    let length = file.metadata()?.len();
    if length > max_bytes {
        let what =
            format!("it has {length} bytes, more than the {max_bytes} that are possible here");
        return Err(Error::new(ErrorKind::FileTooLarge, what));
    }
    let mut bytes = Vec::new();
    file.take(max_bytes).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a text file.
///
/// A byte-order mark at its start is skipped; UTF-16, which PowerShell writes, is decoded.
///
/// # Errors
/// Same as [`open_regular`]; [`ErrorKind::InvalidData`] for bytes that are not text,
/// [`ErrorKind::FileTooLarge`].
pub fn read_text(path: &Path) -> Result<String> {
    read_text_up_to(path, MAX_TEXT_BYTES)
}

/// Reads a text file of at most `max_bytes` as [`read_text`] does.
///
/// Larger files are rejected without reading them.
///
/// # Errors
/// Same as [`read_text`].
pub fn read_text_up_to(path: &Path, max_bytes: u64) -> Result<String> {
    decode_text(read_regular_up_to(path, max_bytes)?)
}

/// Decodes the bytes of a file to text, as [`read_text`] does.
///
/// # Errors
/// [`ErrorKind::InvalidData`] for bytes that are not text.
pub fn decode_text(mut bytes: Vec<u8>) -> Result<String> {
    let not_text = |what: &str| Error::new(ErrorKind::InvalidData, what.to_owned());
    let utf16 = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let (pairs, rest) = bytes[2..].as_chunks::<2>();
        let units: Vec<u16> = pairs.iter().map(|&pair| unit(pair)).collect();
        let text = String::from_utf16(&units).ok().filter(|_| rest.is_empty());
        text.ok_or_else(|| not_text("it begins like UTF-16 text but is not; save it as UTF-8"))
    };
    match bytes.as_slice() {
        [0xff, 0xfe, ..] => return utf16(&bytes, u16::from_le_bytes),
        [0xfe, 0xff, ..] => return utf16(&bytes, u16::from_be_bytes),
        _ if bytes.starts_with(UTF8_MARK) => drop(bytes.drain(..UTF8_MARK.len())),
        _ => {}
    }
    String::from_utf8(bytes).map_err(|_| not_text("it is not UTF-8 text"))
}

/// Skips a byte-order mark at the start of `reader`, for files that are not read as a whole.
///
/// # Errors
/// Fails if reading fails.
pub fn skip_mark(reader: &mut impl BufRead) -> Result<()> {
    if reader.fill_buf()?.starts_with(UTF8_MARK) {
        reader.consume(UTF8_MARK.len());
    }
    Ok(())
}

#[cfg(unix)]
fn name_of(kind: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match kind {
        _ if kind.is_dir() => "a folder",
        _ if kind.is_fifo() => "a named pipe",
        _ if kind.is_socket() => "a socket",
        _ if kind.is_block_device() || kind.is_char_device() => "a device",
        _ => "something else",
    }
}

#[cfg(not(unix))]
fn name_of(kind: FileType) -> &'static str {
    if kind.is_dir() {
        "a folder"
    } else {
        "something else"
    }
}

/// Names of folders that other software puts next to the user's files, in lower case.
///
/// They come from operating systems, network storage and photo programs.
const SYSTEM_FOLDERS: [&str; 16] = [
    "@eadir",
    "@tmp",
    "@recycle",
    "@recently-snapshot",
    "@sharebin",
    "@synoeastream",
    "#recycle",
    "#snapshot",
    "lost+found",
    "__macosx",
    "$recycle.bin",
    "recycler",
    "system volume information",
    "thumbs.db",
    "network trash folder",
    "temporary items",
];

/// Prefixes of files that network storage creates next to an image, in lower case.
const THUMBNAIL_STARTS: [&str; 4] = [
    "synophoto_thumb",
    "synophoto_film",
    "synofile_thumb",
    "synovideo_",
];

/// Returns whether a file or folder of this name belongs to the system or to network storage.
#[must_use]
pub fn is_system_file(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    SYSTEM_FOLDERS.contains(&name.as_str())
        || THUMBNAIL_STARTS.iter().any(|start| name.starts_with(start))
}

/// Returns whether an open file is still the one at `path`.
///
/// Another process may have removed or replaced it since.
#[must_use]
pub fn is_still_at(file: &File, path: &Path) -> bool {
    fs::symlink_metadata(path)
        .and_then(|now| Ok(is_same_file(&now, &file.metadata()?)))
        .unwrap_or(false)
}

#[cfg(unix)]
pub(super) fn is_same_file(a: &Metadata, b: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
pub(super) fn is_same_file(a: &Metadata, b: &Metadata) -> bool {
    a.len() == b.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_with_any_byte_order_mark_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let units = |order: fn(u16) -> [u8; 2]| {
            "\u{feff}é 1\r\n"
                .encode_utf16()
                .flat_map(order)
                .collect::<Vec<u8>>()
        };
        for bytes in [
            "é 1\r\n".as_bytes().to_vec(),
            "\u{feff}é 1\r\n".as_bytes().to_vec(),
            units(u16::to_le_bytes),
            units(u16::to_be_bytes),
        ] {
            fs::write(&path, &bytes).unwrap();
            assert_eq!(read_text(&path).unwrap(), "é 1\r\n", "{bytes:?}");
        }
        fs::write(&path, "").unwrap();
        assert_eq!(read_text(&path).unwrap(), "");
        for bytes in [&[0xff, 0xfe, 0][..], &[0xff, 0xfe, 0, 0xd8], &[b'a', 0xff]] {
            fs::write(&path, bytes).unwrap();
            assert_eq!(
                read_text(&path).unwrap_err().kind(),
                ErrorKind::InvalidData,
                "{bytes:?}"
            );
        }
    }

    #[test]
    fn text_files_can_be_limited_in_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "12345").unwrap();
        assert_eq!(read_text_up_to(&path, 5).unwrap(), "12345");
        let error = read_text_up_to(&path, 4).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        assert!(error.to_string().contains("5 bytes"), "{error}");
        let sparse = fs::File::create(&path).unwrap();
        sparse.set_len(MAX_TEXT_BYTES + 1).unwrap();
        assert_eq!(
            read_text(&path).unwrap_err().kind(),
            ErrorKind::FileTooLarge
        );
    }

    #[test]
    fn byte_order_mark_is_skipped_once() {
        let mut reader = "\u{feff}\u{feff}ply".as_bytes();
        skip_mark(&mut reader).unwrap();
        assert_eq!(reader, "\u{feff}ply".as_bytes());
        let mut reader = &b"ply"[..];
        skip_mark(&mut reader).unwrap();
        assert_eq!(reader, b"ply");
    }

    #[test]
    fn folders_and_missing_files_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        assert!(
            open_regular(folder.path())
                .unwrap_err()
                .to_string()
                .contains("a folder")
        );
        assert_eq!(
            open_regular(&folder.path().join("none"))
                .unwrap_err()
                .kind(),
            ErrorKind::NotFound
        );
    }

    #[cfg(unix)]
    #[test]
    fn pipes_sockets_and_devices_are_rejected_without_waiting() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, socket, link) = (
            folder.path().join("pipe"),
            folder.path().join("socket"),
            folder.path().join("link"),
        );
        assert!(
            std::process::Command::new("mkfifo")
                .arg(&pipe)
                .status()
                .unwrap()
                .success()
        );
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        std::os::unix::fs::symlink(&pipe, &link).unwrap();
        for (path, name) in [
            (pipe.as_path(), "a named pipe"),
            (&link, "a named pipe"),
            (&socket, "a socket"),
            (Path::new("/dev/zero"), "a device"),
        ] {
            assert!(open_regular(path).unwrap_err().to_string().contains(name));
            assert!(read_text(path).is_err() && read_regular(path).is_err());
        }
    }
}
