//! LAS and LAZ files, written through a writer that reports errors at the end.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use glam::{DVec3, Vec3};
use las::point::{Classification, Format};
use las::{Builder, Color, Point, Transform, Vector, Version, Vlr, Writer};

use super::labels::classes;
use crate::ply::SavedColors;
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// Points between two checks for cancellation.
const STRIDE: usize = 1 << 14;
/// Tree depth of instance labels: class › instance › part.
const INSTANCE_LEVEL: usize = 2;

/// Whether the points are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    Plain,
    Compressed,
}

/// Data types of extra bytes: ASPRS, "LAS Specification 1.4-R15", 2019, table 24.
const U16: u8 = 3;
const F32: u8 = 9;
/// Name, type and description of the extra bytes, in file order.
const EXTRA: [(&str, u8, &str); 6] = [
    ("label", U16, "deepest label, 0 = none"),
    ("instance", U16, "label at level 2, 0 = none"),
    ("confidence", F32, "share of the votes won"),
    ("normal_x", F32, "unit normal, 0 = unknown"),
    ("normal_y", F32, "unit normal, 0 = unknown"),
    ("normal_z", F32, "unit normal, 0 = unknown"),
];

/// Writes LAS 1.4 with point format 7.
///
/// Colours have 16 bits, the classification is that of the top-level label, and the extra bytes are
/// those listed in [`EXTRA`]. The `las` crate is used rather than the `e57` crate, because programs
/// that read E57 also read LAS and PCD. Positions keep the resolution of their 32-bit floats. The
/// time of writing is omitted, so that the same cloud gives the same bytes.
pub(super) fn save(
    path: &Path,
    cloud: &LabelledCloud,
    coloring: SavedColors,
    packing: Packing,
    progress: &Progress,
) -> Result<(), SceneError> {
    let header = header(cloud, packing)?;
    let (classes, colors) = (classes(&cloud.tree), coloring.of(cloud));
    let instances = instances(cloud);
    write_whole(path, |out| {
        let out = Patient::new(out.try_clone().map_err(unplaced)?);
        let mut writer = Writer::new(out, header).map_err(refused)?;
        for index in 0..cloud.len() {
            if index % STRIDE == 0 {
                progress.step(index, cloud.len())?;
            }
            let (at, label) = (
                cloud.positions[index].as_dvec3() + cloud.origin,
                cloud.labels[index],
            );
            let class = classes.get(&label).copied().unwrap_or(0);
            let [red, green, blue] = colors[index].map(|channel| u16::from(channel) * 257);
            let point = Point {
                x: at.x,
                y: at.y,
                z: at.z,
                return_number: 1,
                number_of_returns: 1,
                classification: Classification::new(class).map_err(refused)?,
                color: Some(Color { red, green, blue }),
                gps_time: Some(0.0),
                extra_bytes: extra_bytes(cloud, index, instances[usize::from(label.0)]),
                ..Point::default()
            };
            writer.write_point(point).map_err(refused)?;
        }
        writer
            .into_inner()
            .map_err(refused)?
            .finish()
            .map_err(unplaced)
    })
}

fn extra_bytes(cloud: &LabelledCloud, index: usize, instance: LabelId) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(20);
    bytes.extend(cloud.labels[index].0.to_le_bytes());
    bytes.extend(instance.0.to_le_bytes());
    bytes.extend(cloud.confidence[index].to_le_bytes());
    bytes.extend(
        cloud.normals[index]
            .to_array()
            .into_iter()
            .flat_map(f32::to_le_bytes),
    );
    bytes
}

/// Returns the ancestor at instance level for every label id.
///
/// Ids above the instance level map to 0.
fn instances(cloud: &LabelledCloud) -> Vec<LabelId> {
    let instance = |id| match cloud.tree.depth(id) {
        depth if depth >= INSTANCE_LEVEL => cloud.tree.at_level(id, INSTANCE_LEVEL),
        _ => LabelId::NONE,
    };
    (0..=u16::MAX).map(|id| instance(LabelId(id))).collect()
}

fn header(cloud: &LabelledCloud, packing: Packing) -> Result<las::Header, SceneError> {
    let mut format = Format::new(7).map_err(refused)?;
    format.extra_bytes = EXTRA
        .iter()
        .map(|(_, kind, _)| if *kind == U16 { 2 } else { 4 })
        .sum();
    format.is_compressed = packing == Packing::Compressed;
    let description = Vlr {
        user_id: "LASF_Spec".into(),
        record_id: 4,
        description: "extra bytes".into(),
        data: EXTRA
            .iter()
            .flat_map(|(name, kind, text)| descriptor(name, *kind, text))
            .collect(),
    };
    let mut builder = Builder::default();
    builder.version = Version::new(1, 4);
    builder.point_format = format;
    builder.transforms = transforms(&cloud.positions, cloud.origin)?;
    builder.generating_software = format!("OSTRA {}", env!("CARGO_PKG_VERSION"));
    builder.system_identifier = "OTHER".into();
    builder.has_wkt_crs = true;
    builder.vlrs = vec![description];
    builder.into_header().map_err(refused)
}

/// Returns an "extra bytes" descriptor of 192 bytes.
fn descriptor(name: &str, kind: u8, text: &str) -> Vec<u8> {
    let mut bytes = vec![0; 192];
    bytes[2] = kind;
    bytes[4..4 + name.len()].copy_from_slice(name.as_bytes());
    bytes[160..160 + text.len()].copy_from_slice(text.as_bytes());
    bytes
}

/// Returns the offset and scale of each axis.
///
/// The offset is the middle of the points. The scale is the power of ten below the resolution of
/// the coordinates, or a larger one if 32-bit integers require it.
fn transforms(positions: &[Vec3], origin: DVec3) -> Result<Vector<Transform>, SceneError> {
    if !positions.iter().all(|at| at.is_finite()) {
        return Err(SceneError::Request(
            "the cloud has points without a place, which LAS cannot hold; use PLY".into(),
        ));
    }
    let low = positions
        .iter()
        .copied()
        .fold(Vec3::INFINITY, Vec3::min)
        .as_dvec3();
    let high = positions
        .iter()
        .copied()
        .fold(Vec3::NEG_INFINITY, Vec3::max)
        .as_dvec3();
    let farthest = low
        .abs()
        .max(high.abs())
        .max_element()
        .max(f64::from(f32::MIN_POSITIVE));
    let fine = 10_f64.powf((farthest * f64::from(f32::EPSILON)).log10().floor());
    let needed = 10_f64.powf(
        ((high - low).max_element() / 2e9)
            .max(f64::MIN_POSITIVE)
            .log10()
            .ceil(),
    );
    let scale = fine.max(needed);
    let middle = (0.5 * (low + high) / scale).round() * scale;
    let transform = |offset| Transform { scale, offset };
    let DVec3 { x, y, z } = origin + middle;
    Ok(Vector {
        x: transform(x),
        y: transform(y),
        z: transform(z),
    })
}

fn refused(error: las::Error) -> SceneError {
    match error {
        las::Error::Io(source) => unplaced(source),
        other => SceneError::Request(format!(
            "the cloud cannot be written as LAS ({other}); use PLY"
        )),
    }
}

/// A file writer that defers errors until [`Patient::finish`].
///
/// The writer of the `las` crate panics if it is dropped and cannot write the end of the file.
/// After the first error nothing more is written.
struct Patient {
    out: BufWriter<File>,
    fault: Option<io::Error>,
}

impl Patient {
    fn new(out: File) -> Self {
        Self {
            out: BufWriter::with_capacity(1 << 18, out),
            fault: None,
        }
    }

    /// Flushes the file.
    ///
    /// # Errors
    ///
    /// Returns the first error of any operation on the writer.
    fn finish(mut self) -> io::Result<()> {
        self.fault.take().map_or(Ok(()), Err)?;
        self.out.flush()
    }

    /// Returns the result of `act`, or the default value after an error.
    ///
    /// `act` is not called after the first error.
    fn unless_faulty<T: Default>(
        &mut self,
        act: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
    ) -> T {
        if self.fault.is_some() {
            return T::default();
        }
        act(&mut self.out).unwrap_or_else(|fault| {
            self.fault = Some(fault);
            T::default()
        })
    }
}

impl Write for Patient {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.unless_faulty(|out| out.write_all(bytes));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.unless_faulty(BufWriter::flush);
        Ok(())
    }
}

impl Seek for Patient {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        Ok(self.unless_faulty(|out| out.seek(to)))
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn full_disk_is_reported_by_finish() {
        let Ok(full) = File::options().write(true).open("/dev/full") else {
            return;
        };
        let mut patient = Patient::new(full);
        patient.write_all(&vec![7; 1 << 20]).unwrap();
        assert!(patient.finish().is_err());
    }
}
