//! NPZ files: NumPy arrays in a ZIP archive.

use std::collections::BTreeSet;
use std::io::{Cursor, Write};
use std::path::Path;

use glam::IVec3;
use npyz::{AutoSerialize, DType, Serialize, WriteOptions, WriterBuilder};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, System, ZipWriter};

use super::labels::path_name;
use super::vox::GridIndices;
use crate::ply::SavedColors;
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// Number of arrays written by [`save`].
const ARRAYS: usize = 8;
/// Array size in bytes from which a ZIP entry uses the Zip64 form for more than 4 GiB.
///
/// The limit leaves room for the header of the array.
const LARGE_BYTES: u64 = u32::MAX as u64 - 4096;

/// Writes voxels as NumPy arrays in a ZIP archive.
///
/// The arrays per voxel are `indices` (int32, N×3, in the order x, y, z), `labels` (uint16),
/// `confidence` (float32) and `colors` (uint8, N×3, sRGB). With `origin` (float64, 3) and
/// `voxel_size` (float64), the centre of a voxel is `origin + (index + 0.5) · voxel_size` in world
/// units. `label_ids` (uint16) and `label_names` (paths) list all labels.
pub(super) fn save(
    path: &Path,
    voxels: &LabelledCloud,
    voxel: f64,
    coloring: SavedColors,
    progress: &Progress,
) -> Result<(), SceneError> {
    let GridIndices { origin, indices } = GridIndices::of(voxels, voxel)?;
    let ids: BTreeSet<LabelId> = voxels
        .tree
        .iter()
        .map(|label| label.id)
        .chain(voxels.labels.iter().copied())
        .collect();
    let names: Vec<String> = ids.iter().map(|&id| path_name(&voxels.tree, id)).collect();
    let (count, kinds) = (voxels.len() as u64, ids.len() as u64);
    let places = indices.iter().flat_map(IVec3::to_array);
    let labels = voxels.labels.iter().map(|id| id.0);
    let confidence = voxels.confidence.iter().copied();
    let colors = coloring.of(voxels);
    let colors = colors.as_flattened().iter().copied();
    let origin = (origin + voxels.origin).to_array();
    let mut npz = NpzWriter {
        zip: ZipWriter::new(Cursor::new(Vec::new())),
        arrays: 0,
        progress,
    };
    npz.add("indices", &[count, 3], places)?;
    npz.add("labels", &[count], labels)?;
    npz.add("confidence", &[count], confidence)?;
    npz.add("colors", &[count, 3], colors)?;
    npz.add("origin", &[3], origin)?;
    npz.add("voxel_size", &[], [voxel])?;
    npz.add("label_ids", &[kinds], ids.iter().map(|id| id.0))?;
    npz.add_texts("label_names", &names)?;
    let zip = npz.zip.finish().map_err(|error| unplaced(error.into()))?;
    write_whole(path, |out| out.write_all(zip.get_ref()).map_err(unplaced))
}

/// A ZIP file of arrays, built in memory.
///
/// [`ZipWriter`] would print to standard error after a disk error.
struct NpzWriter<'a> {
    zip: ZipWriter<Cursor<Vec<u8>>>,
    /// Arrays written so far.
    arrays: usize,
    progress: &'a Progress,
}

impl NpzWriter<'_> {
    /// Adds an array with dimensions `shape` in row-major order.
    fn add<T: AutoSerialize>(
        &mut self,
        name: &str,
        shape: &[u64],
        entries: impl IntoIterator<Item = T>,
    ) -> Result<(), SceneError> {
        self.write(name, shape, T::default_dtype(), entries)
    }

    /// Adds an array of strings, zero-padded to the longest one, at four bytes per character.
    fn add_texts(&mut self, name: &str, texts: &[String]) -> Result<(), SceneError> {
        let letters = texts.iter().map(|text| text.chars().count());
        let width = letters.max().unwrap_or(0).max(1);
        let kind = format!("<U{width}")
            .parse()
            .map_err(|error| unplaced(std::io::Error::other(error)))?;
        let shape = [texts.len() as u64];
        self.write(name, &shape, DType::new_scalar(kind), texts.iter().cloned())
    }

    fn write<T: Serialize>(
        &mut self,
        name: &str,
        shape: &[u64],
        kind: DType,
        entries: impl IntoIterator<Item = T>,
    ) -> Result<(), SceneError> {
        self.progress.step(self.arrays, ARRAYS)?;
        self.arrays += 1;
        let bytes = kind.num_bytes().unwrap_or(0) as u64 * shape.iter().product::<u64>();
        // Time and system are left out, so that equal content gives equal bytes.
        let stored = SimpleFileOptions::DEFAULT
            .compression_method(CompressionMethod::Stored)
            .system(System::Dos)
            .large_file(bytes > LARGE_BYTES);
        self.zip
            .start_file(format!("{name}.npy"), stored)
            .map_err(|error| unplaced(error.into()))?;
        write_array(&mut self.zip, shape, kind, entries).map_err(unplaced)
    }
}

fn write_array<T: Serialize>(
    out: impl Write,
    shape: &[u64],
    kind: DType,
    entries: impl IntoIterator<Item = T>,
) -> std::io::Result<()> {
    let array = WriteOptions::<T>::new()
        .dtype(kind)
        .shape(shape)
        .writer(out);
    let mut array = array.begin_nd()?;
    array.extend(entries)?;
    array.finish()
}
