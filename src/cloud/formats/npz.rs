//! NPZ: NumPy arrays in a ZIP archive.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;

use glam::IVec3;

use super::labels::path_name;
use super::vox::Places;
use crate::ply::Coloring;
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// Writes voxels as NumPy arrays in a zip: `indices` (int32, N×3: places along x, y, z), `labels` (uint16), `confidence`
/// (float32), `colors` (uint8, N×3, sRGB), `origin` (float64, 3) and `voxel_size` (float64), so that a voxel's middle is
/// `origin + (index + 0.5) · voxel_size` in world units; and of all labels `label_ids` (uint16) and `label_names` (paths).
pub(super) fn save(
    path: &Path,
    voxels: &LabelledCloud,
    voxel: f64,
    coloring: Coloring,
    progress: &Progress,
) -> Result<(), SceneError> {
    let Places { origin, indices } = Places::of(voxels, voxel)?;
    let ids: BTreeSet<LabelId> = voxels
        .tree
        .iter()
        .map(|label| label.id)
        .chain(voxels.labels.iter().copied())
        .collect();
    let names: Vec<String> = ids.iter().map(|&id| path_name(&voxels.tree, id)).collect();
    let (count, kinds) = (voxels.len(), ids.len());
    let shorts = |ids: &mut dyn Iterator<Item = LabelId>| {
        ids.flat_map(|id| id.0.to_le_bytes()).collect::<Vec<u8>>()
    };
    let places: Vec<u8> = indices
        .iter()
        .flat_map(IVec3::to_array)
        .flat_map(i32::to_le_bytes)
        .collect();
    let labels = shorts(&mut voxels.labels.iter().copied());
    let confidence: Vec<u8> = voxels
        .confidence
        .iter()
        .flat_map(|share| share.to_le_bytes())
        .collect();
    let origin: Vec<u8> = (origin + voxels.origin)
        .to_array()
        .into_iter()
        .flat_map(f64::to_le_bytes)
        .collect();
    let arrays = [
        ("indices", array("<i4", &[count, 3], &places)),
        ("labels", array("<u2", &[count], &labels)),
        ("confidence", array("<f4", &[count], &confidence)),
        (
            "colors",
            array("|u1", &[count, 3], coloring.of(voxels).as_flattened()),
        ),
        ("origin", array("<f8", &[3], &origin)),
        ("voxel_size", array("<f8", &[], &voxel.to_le_bytes())),
        (
            "label_ids",
            array("<u2", &[kinds], &shorts(&mut ids.into_iter())),
        ),
        ("label_names", texts(&names)),
    ];
    write_whole(path, |out| {
        let mut zip = Zip::default();
        for (at, (name, bytes)) in arrays.iter().enumerate() {
            progress.step(at, arrays.len())?;
            let head = zip
                .add(&format!("{name}.npy"), bytes)
                .ok_or_else(too_large)?;
            out.write_all(&head)
                .and_then(|()| out.write_all(bytes))
                .map_err(unplaced)?;
        }
        out.write_all(&zip.end()).map_err(unplaced)
    })
}

fn too_large() -> SceneError {
    SceneError::Request(
        "the voxels take more than the 4 GiB that an NPZ can hold; fuse with a larger voxel size"
            .into(),
    )
}

/// An array in NumPy's form (NEP 1, version 1.0), little-endian: `kind` as in `<f4`, the numbers of entries along each
/// axis, and the entries' bytes with the last axis running fastest.
fn array(kind: &str, shape: &[usize], entries: &[u8]) -> Vec<u8> {
    let shape: String = shape.iter().map(|along| format!("{along},")).collect();
    let mut head = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    // With the ten bytes before it and the line's end the entries begin at a multiple of 64.
    let whole = (10 + head.len() + 1).next_multiple_of(64);
    head.extend(std::iter::repeat_n(' ', whole - 10 - 1 - head.len()));
    head.push('\n');
    let mut bytes = Vec::with_capacity(whole + entries.len());
    bytes.extend_from_slice(b"\x93NUMPY\x01\x00");
    bytes.extend_from_slice(&((whole - 10) as u16).to_le_bytes());
    bytes.extend_from_slice(head.as_bytes());
    bytes.extend_from_slice(entries);
    bytes
}

/// An array of texts: all as wide as the longest, four bytes a letter, ended by zeros.
fn texts(texts: &[String]) -> Vec<u8> {
    let width = texts
        .iter()
        .map(|text| text.chars().count())
        .max()
        .unwrap_or(0)
        .max(1);
    let padded = |text: &String| {
        text.chars()
            .map(u32::from)
            .chain(std::iter::repeat(0))
            .take(width)
            .collect::<Vec<_>>()
    };
    let entries: Vec<u8> = texts
        .iter()
        .flat_map(padded)
        .flat_map(u32::to_le_bytes)
        .collect();
    array(&format!("<U{width}"), &[texts.len()], &entries)
}

/// A zip file being written, its files stored as they are (APPNOTE.TXT, PKWARE). Without times, so that equal content
/// gives equal bytes.
#[derive(Default)]
struct Zip {
    directory: Vec<u8>,
    files: u16,
    written: u32,
}

impl Zip {
    /// The bytes that stand before a file's content, which must follow at once; `None` beyond 4 GiB.
    fn add(&mut self, name: &str, content: &[u8]) -> Option<Vec<u8>> {
        let size = u32::try_from(content.len()).ok()?;
        let mut shared = Vec::new();
        // Version 2.0 needed, no flags, stored, midnight, 1 January 1980.
        [20u16, 0, 0, 0, 0x21]
            .iter()
            .for_each(|number| shared.extend(number.to_le_bytes()));
        [crc32(content), size, size]
            .iter()
            .for_each(|number| shared.extend(number.to_le_bytes()));
        shared.extend((name.len() as u16).to_le_bytes());
        shared.extend(0u16.to_le_bytes());
        let head = [b"PK\x03\x04", &shared[..], name.as_bytes()].concat();
        self.directory.extend_from_slice(b"PK\x01\x02\x14\x00");
        self.directory.extend_from_slice(&shared);
        // No comment, first disk, no attributes; then where the file begins.
        self.directory.extend_from_slice(&[0; 10]);
        self.directory.extend(self.written.to_le_bytes());
        self.directory.extend_from_slice(name.as_bytes());
        self.files += 1;
        self.written = self
            .written
            .checked_add(head.len() as u32)?
            .checked_add(size)?;
        Some(head)
    }

    /// The bytes that end the zip.
    fn end(self) -> Vec<u8> {
        let mut bytes = self.directory;
        let length = bytes.len() as u32;
        bytes.extend_from_slice(b"PK\x05\x06\0\0\0\0");
        [self.files; 2]
            .iter()
            .for_each(|number| bytes.extend(number.to_le_bytes()));
        [length, self.written]
            .iter()
            .for_each(|number| bytes.extend(number.to_le_bytes()));
        bytes.extend_from_slice(&[0; 2]);
        bytes
    }
}

/// The checksum of zip and PNG (ITU-T V.42), reflected polynomial 0xedb88320.
fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = table();
    !bytes.iter().fold(!0, |crc: u32, &byte| {
        TABLE[usize::from(crc as u8 ^ byte)] ^ (crc >> 8)
    })
}

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut crc, mut bit) = (byte as u32, 0);
        while bit < 8 {
            crc = if crc & 1 == 1 {
                0xedb8_8320 ^ (crc >> 1)
            } else {
                crc >> 1
            };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    #[test]
    fn checksum_of_the_standard() {
        assert_eq!(super::crc32(b"123456789"), 0xcbf4_3926);
    }
}
