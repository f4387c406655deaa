use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

use glam::DVec3;

use super::colmap_model::{intrinsics, model_name, parameter_count};
use super::lines::{invalid, pose_from_quaternion};
use super::{CameraKey, GivenCamera, GivenIntrinsics};
use crate::FrameError;
use ostra_core::disk;

/// Maximum length of an image's name in bytes.
const MAX_NAME_BYTES: u64 = 1 << 16;

/// A little-endian file, read from front to back without holding it in memory.
///
/// Every read past the end is an error that names the file.
#[derive(Debug)]
pub struct Cursor<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    /// Remaining bytes.
    left: u64,
}

impl<'a> Cursor<'a> {
    pub fn open(path: &'a Path) -> Result<Self, FrameError> {
        let io = |reason| FrameError::Io {
            path: path.to_owned(),
            reason,
        };
        let file = disk::open_regular(path).map_err(io)?;
        let left = file.metadata().map_err(io)?.len();
        Ok(Self {
            path,
            reader: BufReader::new(file),
            left,
        })
    }

    /// Reads a number of records, checked against the remaining bytes of the file.
    ///
    /// Each record has at least `bytes_each` bytes.
    pub fn count(&mut self, bytes_each: u64) -> Result<u64, FrameError> {
        let count = self.u64()?;
        if count == 0 && self.left > 0 {
            let left = self.left;
            return Err(self.error(format!(
                "has 0 records but {left} more bytes; the file is damaged, copy it again"
            )));
        }
        if count
            .checked_mul(bytes_each)
            .is_none_or(|bytes| bytes > self.left)
        {
            return Err(self.truncated());
        }
        Ok(count)
    }

    pub fn error(&self, what: impl Into<String>) -> FrameError {
        invalid(self.path, what)
    }

    fn truncated(&self) -> FrameError {
        self.error("ends too early; the file is cut off or not a COLMAP model, copy it again")
    }

    /// Counts bytes as read.
    fn take(&mut self, count: u64) -> Result<(), FrameError> {
        self.left = self
            .left
            .checked_sub(count)
            .ok_or_else(|| self.truncated())?;
        Ok(())
    }

    fn io(&self, reason: std::io::Error) -> FrameError {
        if reason.kind() == ErrorKind::UnexpectedEof {
            return self.truncated(); // the file became shorter
        }
        FrameError::Io {
            path: self.path.to_owned(),
            reason,
        }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], FrameError> {
        self.take(N as u64)?;
        let mut bytes = [0; N];
        self.reader
            .read_exact(&mut bytes)
            .map_err(|reason| self.io(reason))?;
        Ok(bytes)
    }

    pub fn u8(&mut self) -> Result<u8, FrameError> {
        Ok(self.array::<1>()?[0])
    }

    pub fn u32(&mut self) -> Result<u32, FrameError> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Result<u64, FrameError> {
        self.array().map(u64::from_le_bytes)
    }

    pub fn f64(&mut self) -> Result<f64, FrameError> {
        self.array().map(f64::from_le_bytes)
    }

    /// Reads the bytes up to a zero, and the zero.
    fn name(&mut self) -> Result<String, FrameError> {
        let mut bytes = Vec::new();
        let read = self
            .reader
            .by_ref()
            .take(MAX_NAME_BYTES.min(self.left))
            .read_until(0, &mut bytes);
        self.take(read.map_err(|reason| self.io(reason))? as u64)?;
        match bytes.pop() {
            Some(0) if bytes.is_empty() => {
                Err(self.error("holds an image without a name; the file is damaged"))
            }
            Some(0) => Ok(String::from_utf8_lossy(&bytes).into_owned()),
            _ => Err(self.truncated()),
        }
    }

    /// Skips `count` records of `bytes` each.
    pub fn skip_records(&mut self, count: u64, bytes: u64) -> Result<(), FrameError> {
        let length = count.checked_mul(bytes).ok_or_else(|| self.truncated())?;
        self.take(length)?;
        let offset = i64::try_from(length).map_err(|_| self.truncated())?;
        self.reader
            .seek_relative(offset)
            .map_err(|reason| self.io(reason))
    }
}

/// Reads `cameras.bin` and `images.bin` of a COLMAP binary model.
pub fn read(folder: &Path) -> Result<Vec<GivenCamera>, FrameError> {
    let path = folder.join("cameras.bin");
    let cameras = read_cameras(&mut Cursor::open(&path)?)?;
    let path = folder.join("images.bin");
    read_images(&mut Cursor::open(&path)?, &cameras)
}

/// Reads the cameras by number. An unusable camera is an error only if an image refers to it.
fn read_cameras(
    file: &mut Cursor<'_>,
) -> Result<BTreeMap<u32, Result<GivenIntrinsics, String>>, FrameError> {
    let mut cameras = BTreeMap::new();
    for _ in 0..file.count(24)? {
        let id = file.u32()?;
        let model = model_name(file.u32()?.cast_signed());
        let size = [file.u64()?, file.u64()?];
        let count = parameter_count(&model).map_err(|what| file.error(what))?;
        let parameters: Vec<f64> = (0..count).map(|_| file.f64()).collect::<Result<_, _>>()?;
        cameras.insert(
            id,
            intrinsics(&model, size, &parameters).map_err(|what| format!("cameras.bin: {what}")),
        );
    }
    Ok(cameras)
}

fn read_images(
    file: &mut Cursor<'_>,
    cameras: &BTreeMap<u32, Result<GivenIntrinsics, String>>,
) -> Result<Vec<GivenCamera>, FrameError> {
    let mut images = Vec::new();
    for _ in 0..file.count(73)? {
        let _id = file.u32()?;
        let mut v = [0.0f64; 7];
        for value in &mut v {
            *value = file.f64()?;
        }
        let camera = file.u32()?;
        let name = file.name()?;
        let points = file.u64()?;
        file.skip_records(points, 24)?;
        let pose = pose_from_quaternion([v[1], v[2], v[3], v[0]], DVec3::new(v[4], v[5], v[6]))
            .map_err(|error| format!("{name}: {error}"));
        let given = cameras.get(&camera).ok_or_else(|| {
            file.error(format!(
                "{name} has camera {camera}, which cameras.bin does not hold"
            ))
        })?;
        images.push(GivenCamera::with_intrinsics(
            CameraKey::Name(name),
            given,
            pose,
        ));
    }
    Ok(images)
}
