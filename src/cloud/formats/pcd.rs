use std::io::{BufWriter, Write};
use std::path::Path;

use crate::ply::{SavedColors, comments_of};
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;

/// Points between two checks for cancellation.
const STRIDE: usize = 1 << 16;

/// Writes a binary PCD 0.7 file.
///
/// The fields are `x y z normal_x normal_y normal_z` (float), `rgb` (0x00RRGGBB in 32 bits),
/// `label` (32 bits, as the Point Cloud Library reads it) and `confidence` (float). Comments hold
/// the label tree, as in a PLY file.
pub(super) fn save(
    path: &Path,
    cloud: &LabelledCloud,
    coloring: SavedColors,
    progress: &Progress,
) -> Result<(), SceneError> {
    let colors = coloring.of(cloud);
    write_whole(path, |out| {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        out.write_all(head(cloud).as_bytes()).map_err(unplaced)?;
        for (index, &[red, green, blue]) in colors.iter().enumerate() {
            if index % STRIDE == 0 {
                progress.step(index, cloud.len())?;
            }
            let mut record = Vec::with_capacity(36);
            let place = cloud.positions[index]
                .to_array()
                .into_iter()
                .chain(cloud.normals[index].to_array());
            record.extend(place.flat_map(f32::to_le_bytes));
            record.extend([blue, green, red, 0]);
            record.extend(u32::from(cloud.labels[index].0).to_le_bytes());
            record.extend(cloud.confidence[index].to_le_bytes());
            out.write_all(&record).map_err(unplaced)?;
        }
        out.flush().map_err(unplaced)
    })
}

fn head(cloud: &LabelledCloud) -> String {
    let comments: String = comments_of(&cloud.tree)
        .iter()
        .map(|comment| format!("# {comment}\n"))
        .collect();
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n{comments}VERSION 0.7\n\
         FIELDS x y z normal_x normal_y normal_z rgb label confidence\nSIZE 4 4 4 4 4 4 4 4 4\n\
         TYPE F F F F F F U U F\nCOUNT 1 1 1 1 1 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n\
         POINTS {count}\nDATA binary\n",
        count = cloud.len()
    )
}
