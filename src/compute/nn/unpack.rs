use std::fs::File;
use std::io::{Error, ErrorKind, Read, Write};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use zip::ZipArchive;

/// Maximum size of an unpacked file whose size is not known, in bytes.
const MAX_UNPACKED_BYTES: u64 = 1 << 30;

/// Writes the file called `member` of the ZIP archive to `into` and ignores other files.
///
/// # Errors
/// Fails if the archive is damaged, has no such file, or the file is larger than `limit` (1 GiB if
/// there is none).
pub(super) fn unzip(
    archive: &Path,
    member: &str,
    limit: Option<u64>,
    into: &mut impl Write,
) -> std::io::Result<()> {
    let mut archive = ZipArchive::new(File::open(archive)?)?;
    let mut file = archive.by_name(member)?;
    let size = file.size();
    if size > limit.unwrap_or(MAX_UNPACKED_BYTES) {
        return Err(damaged("a file in it is too large"));
    }
    let written = std::io::copy(&mut file.by_ref().take(size + 1), into)?;
    if written == size {
        Ok(())
    } else {
        Err(damaged("a file in it has another length than it should"))
    }
}

/// Writes the content of a file compressed by gzip to `into`.
///
/// # Errors
/// Fails if the file is damaged, or its content is larger than `limit` (1 GiB if there is none).
pub(super) fn gunzip(
    archive: &Path,
    limit: Option<u64>,
    into: &mut impl Write,
) -> std::io::Result<()> {
    let limit = limit.unwrap_or(MAX_UNPACKED_BYTES);
    let content = MultiGzDecoder::new(File::open(archive)?);
    let written = std::io::copy(&mut content.take(limit + 1), into)?;
    if written > limit {
        return Err(damaged("its content is too large"));
    }
    Ok(())
}

fn damaged(what: &str) -> Error {
    Error::new(ErrorKind::InvalidData, what.to_owned())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Cursor;

    use flate2::Compression;
    use flate2::write::GzEncoder;
    use zip::CompressionMethod;
    use zip::write::SimpleFileOptions;

    use super::*;

    /// Creates an archive of one stored file whose directory lists `listed` bytes.
    fn archive(name: &str, content: &[u8], listed: u32) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        zip.start_file(name, stored).unwrap();
        zip.write_all(content).unwrap();
        let mut bytes = zip.finish().unwrap().into_inner();
        let entry = bytes.windows(4).position(|four| four == b"PK\x01\x02");
        bytes[entry.unwrap() + 24..][..4].copy_from_slice(&listed.to_le_bytes());
        bytes
    }

    #[test]
    fn only_the_named_file_is_unpacked_and_damage_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.zip");
        let taken = |zip: &[u8], member: &str| {
            fs::write(&path, zip).unwrap();
            let mut into = Vec::new();
            unzip(&path, member, None, &mut into).map(|()| into)
        };
        let good = archive("x/lib.so", b"content", 7);
        assert_eq!(taken(&good, "x/lib.so").unwrap(), b"content");
        assert!(taken(&good, "lib.so").is_err(), "another name");
        let longer = archive("x/lib.so", b"content", 6);
        assert!(taken(&longer, "x/lib.so").is_err(), "longer than listed");
        let large = archive("x/lib.so", b"content", u32::MAX);
        assert!(taken(&large, "x/lib.so").is_err(), "too large");
        for length in 0..good.len() - 2 {
            assert!(
                taken(&good[..length], "x/lib.so").is_err(),
                "cut to {length} bytes"
            );
        }
    }
    #[test]
    fn content_of_gzip_is_unpacked_and_damage_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gz");
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(b"some content").unwrap();
        let good = encoder.finish().unwrap();
        let taken = |packed: &[u8], limit| {
            fs::write(&path, packed).unwrap();
            let mut into = Vec::new();
            gunzip(&path, limit, &mut into).map(|()| into)
        };
        assert_eq!(taken(&good, None).unwrap(), b"some content");
        assert!(taken(&good, Some(11)).is_err(), "longer than expected");
        for length in 0..good.len() {
            assert!(taken(&good[..length], None).is_err(), "cut to {length}");
        }
    }
}
