use std::fs::File;
use std::io::{BufReader, Error, ErrorKind, Read, Result, Seek, SeekFrom, Write};
use std::path::Path;

use flate2::read::DeflateDecoder;

/// Largest file that is taken from an archive, in bytes.
const MAX_BYTES: u64 = 1 << 30;

/// Longest directory of an archive that is read, in bytes.
const MAX_DIRECTORY: u64 = 64 << 20;

/// Writes the one file called `member` in the ZIP archive `archive` to `into`, whatever else the archive holds.
///
/// # Errors
/// When the archive is damaged, has no such file, or the file is larger than 1 GiB.
pub(super) fn unzip(archive: &Path, member: &str, into: &mut impl Write) -> Result<()> {
    let mut file = BufReader::new(File::open(archive)?);
    let directory = directory(&mut file)?;
    let entry = find(&directory, member)?;
    file.seek(SeekFrom::Start(entry.offset))?;
    let mut header = [0; 30];
    file.read_exact(&mut header)?;
    let skip = i64::from(u16_at(&header, 26)?) + i64::from(u16_at(&header, 28)?);
    file.seek(SeekFrom::Current(skip))?;
    let packed = file.take(entry.packed);
    let mut unpacked: Box<dyn Read> = match entry.method {
        0 => Box::new(packed),
        8 => Box::new(DeflateDecoder::new(packed)),
        _ => return Err(damaged("its compression is not supported")),
    };
    let written = std::io::copy(&mut unpacked.by_ref().take(entry.bytes + 1), into)?;
    if written == entry.bytes {
        Ok(())
    } else {
        Err(damaged("a file in it has another length than it should"))
    }
}

struct Member {
    method: u16,
    packed: u64,
    bytes: u64,
    offset: u64,
}

/// The bytes of the list of files at the end of the archive.
fn directory(file: &mut (impl Read + Seek)) -> Result<Vec<u8>> {
    let length = file.seek(SeekFrom::End(0))?;
    let from = length.saturating_sub(22 + u64::from(u16::MAX));
    file.seek(SeekFrom::Start(from))?;
    let mut end = Vec::new();
    file.read_to_end(&mut end)?;
    let at = end
        .windows(4)
        .rposition(|bytes| bytes == b"PK\x05\x06")
        .ok_or_else(|| damaged("not a ZIP archive"))?;
    let (bytes, offset) = (
        u64::from(u32_at(&end, at + 12)?),
        u64::from(u32_at(&end, at + 16)?),
    );
    if bytes > MAX_DIRECTORY || offset + bytes > length {
        return Err(damaged("its directory is damaged"));
    }
    file.seek(SeekFrom::Start(offset))?;
    let mut directory = Vec::new();
    file.take(bytes).read_to_end(&mut directory)?;
    Ok(directory)
}

fn find(directory: &[u8], member: &str) -> Result<Member> {
    let mut at = 0;
    while directory.get(at..at + 4) == Some(b"PK\x01\x02") {
        let lengths = [28, 30, 32].map(|field| u16_at(directory, at + field).map(usize::from));
        let [name, extra, comment] = lengths;
        let (name, rest) = (name?, extra? + comment?);
        if directory.get(at + 46..at + 46 + name) == Some(member.as_bytes()) {
            let number = |field| u32_at(directory, at + field).map(u64::from);
            let (packed, bytes, offset) = (number(20)?, number(24)?, number(42)?);
            if bytes > MAX_BYTES {
                return Err(damaged("a file in it is too large"));
            }
            return Ok(Member {
                method: u16_at(directory, at + 10)?,
                packed,
                bytes,
                offset,
            });
        }
        at += 46 + name + rest;
    }
    Err(damaged(&format!("it holds no {member}")))
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16> {
    let two = bytes.get(at..at + 2).and_then(|two| two.try_into().ok());
    two.map(u16::from_le_bytes)
        .ok_or_else(|| damaged("it breaks off"))
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32> {
    let four = bytes.get(at..at + 4).and_then(|four| four.try_into().ok());
    four.map(u32::from_le_bytes)
        .ok_or_else(|| damaged("it breaks off"))
}

fn damaged(what: &str) -> Error {
    Error::new(ErrorKind::InvalidData, what.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An archive of one stored file whose directory names `bytes` bytes.
    fn archive(name: &str, content: &[u8], bytes: u32) -> Vec<u8> {
        let length = (content.len() as u32).to_le_bytes();
        let name_length = (name.len() as u16).to_le_bytes();
        let mut zip = [
            b"PK\x03\x04".as_slice(),
            &[0; 14],
            &length,
            &length,
            &name_length,
            &[0; 2],
        ]
        .concat();
        zip.extend([name.as_bytes(), content].concat());
        let start = (zip.len() as u32).to_le_bytes();
        let entry = [
            b"PK\x01\x02".as_slice(),
            &[0; 16],
            &length,
            &bytes.to_le_bytes(),
            &name_length,
            &[0; 16],
        ]
        .concat();
        let size = ((entry.len() + name.len()) as u32).to_le_bytes();
        zip.extend(
            [
                &entry,
                name.as_bytes(),
                b"PK\x05\x06",
                &[0; 8],
                &size,
                &start,
                &[0; 2],
            ]
            .concat(),
        );
        zip
    }

    #[test]
    fn only_the_named_file_is_taken_and_damage_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.zip");
        let taken = |zip: &[u8], member: &str| {
            std::fs::write(&path, zip).unwrap();
            let mut into = Vec::new();
            unzip(&path, member, &mut into).map(|()| into)
        };
        let good = archive("x/lib.so", b"content", 7);
        assert_eq!(taken(&good, "x/lib.so").unwrap(), b"content");
        assert!(taken(&good, "lib.so").is_err(), "another name");
        assert!(
            taken(&archive("x/lib.so", b"content", 6), "x/lib.so").is_err(),
            "longer than listed"
        );
        assert!(
            taken(&archive("x/lib.so", b"content", u32::MAX), "x/lib.so").is_err(),
            "too large"
        );
        for length in 0..good.len() - 2 {
            assert!(
                taken(&good[..length], "x/lib.so").is_err(),
                "cut to {length} bytes"
            );
        }
    }
}
