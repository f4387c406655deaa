use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result};
use rayon::prelude::*;
use tiff::encoder::{TiffEncoder, colortype::Gray32Float};

use super::undistorted::left_out;
use ostra_core::disk::AtomicFile;
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, FrameError, FrameStore};
use ostra_project::Project;

/// Writes the depth of every frame that has any as a 32-bit float TIFF in world units, 0 = unknown. Depths that cannot be
/// read are left out; a warning names them.
pub fn write(
    folder: &Path,
    project: &Project,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Vec<String>> {
    progress.stage("write depths")?;
    let done = AtomicUsize::new(0);
    let stems = super::masks::stems(project)?;
    let written = project.frames.par_iter().zip(&stems).map(|(frame, stem)| {
        progress.step(done.fetch_add(1, Ordering::Relaxed), project.frames.len())?;
        match store.depth(frame) {
            Ok(Some(depth)) => {
                write_tiff(&folder.join(format!("{stem}.tiff")), &depth).map(|()| (true, None))
            }
            Ok(None) => Ok((false, None)),
            Err(error) => Ok((false, Some(error))),
        }
    });
    let (written, unreadable): (Vec<bool>, Vec<Option<FrameError>>) =
        written.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    Ok(
        left_out(folder, "depth", unreadable, written.contains(&true))?
            .into_iter()
            .collect(),
    )
}

fn write_tiff(path: &Path, depth: &DepthMap) -> Result<()> {
    super::make_folder_of(path)?;
    let failed = || {
        format!(
            "{}: cannot be written; check permissions and free space",
            path.display()
        )
    };
    let mut file = AtomicFile::create(path).with_context(failed)?;
    let mut out = BufWriter::new(file.as_file());
    let mut encoder = TiffEncoder::new(&mut out).with_context(failed)?;
    encoder
        .write_image::<Gray32Float>(depth.width, depth.height, &depth.depths)
        .with_context(failed)?;
    out.flush().with_context(failed)?;
    drop(out);
    file.commit().with_context(failed)
}
