use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use super::colmap_model::{intrinsics, model_name, parameter_count};
use super::lines::{invalid, pose_from_quaternion, read_bytes};
use super::{CameraKey, GivenCamera, GivenIntrinsics};
use crate::frames::FrameError;

/// A little-endian file read from front to back; every read past the end is an error that names the file.
#[derive(Debug)]
pub struct Cursor<'a> {
    path: &'a Path,
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    pub fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, rest: bytes }
    }

    pub fn error(&self, what: impl Into<String>) -> FrameError {
        invalid(self.path, what)
    }

    fn truncated(&self) -> FrameError {
        self.error("ends too early; the file is cut off or no COLMAP model, copy it again")
    }

    /// The next `count` bytes.
    pub fn skip(&mut self, count: u64) -> Result<&'a [u8], FrameError> {
        let taken = usize::try_from(count).ok().and_then(|count| self.rest.split_at_checked(count));
        let (taken, rest) = taken.ok_or_else(|| self.truncated())?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], FrameError> {
        let (taken, rest) = self.rest.split_first_chunk().ok_or_else(|| self.truncated())?;
        self.rest = rest;
        Ok(*taken)
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

    /// Bytes up to a zero, which is taken too.
    fn name(&mut self) -> Result<String, FrameError> {
        let end = self.rest.iter().position(|&byte| byte == 0).ok_or_else(|| self.truncated())?;
        let name = String::from_utf8_lossy(&self.rest[..end]).into_owned();
        self.rest = &self.rest[end + 1..];
        Ok(name)
    }

    /// Skips `count` records of `bytes` each.
    pub fn skip_records(&mut self, count: u64, bytes: u64) -> Result<(), FrameError> {
        let length = count.checked_mul(bytes).ok_or_else(|| self.truncated())?;
        self.skip(length).map(|_| ())
    }
}

/// Reads `cameras.bin` and `images.bin` of a COLMAP binary model.
pub fn read(folder: &Path) -> Result<Vec<GivenCamera>, FrameError> {
    let path = folder.join("cameras.bin");
    let cameras = read_cameras(&mut Cursor::new(&path, &read_bytes(&path)?))?;
    let path = folder.join("images.bin");
    read_images(&mut Cursor::new(&path, &read_bytes(&path)?), &cameras)
}

/// Cameras by number. One that cannot be used is an error only where an image has it.
fn read_cameras(file: &mut Cursor<'_>) -> Result<BTreeMap<u32, Result<GivenIntrinsics, String>>, FrameError> {
    let mut cameras = BTreeMap::new();
    for _ in 0..file.u64()? {
        let id = file.u32()?;
        let model = model_name(file.u32()?.cast_signed());
        let size = [file.u64()?, file.u64()?];
        let count = parameter_count(&model).map_err(|what| file.error(what))?;
        let parameters: Vec<f64> = (0..count).map(|_| file.f64()).collect::<Result<_, _>>()?;
        cameras.insert(id, intrinsics(&model, size, &parameters).map_err(|what| format!("cameras.bin: {what}")));
    }
    Ok(cameras)
}

fn read_images(
    file: &mut Cursor<'_>,
    cameras: &BTreeMap<u32, Result<GivenIntrinsics, String>>,
) -> Result<Vec<GivenCamera>, FrameError> {
    let mut images = Vec::new();
    for _ in 0..file.u64()? {
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
        let given = cameras
            .get(&camera)
            .ok_or_else(|| file.error(format!("{name} has camera {camera}, which cameras.bin does not hold")))?;
        images.push(GivenCamera::with_intrinsics(CameraKey::Name(name), given, pose));
    }
    Ok(images)
}
