use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;

use glam::IVec3;

use super::names::path_name;
use super::npy::{array, texts};
use super::places::Places;
use super::zip::Zip;
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
