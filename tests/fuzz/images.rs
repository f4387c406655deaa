//! Fuzz targets for images and depth maps.

use std::path::Path;

use ostra_core::job::Progress;
use ostra_frames::{EstimatedDepth, FrameFolder, FrameStore, OpenRequest, exif_focal_px, open};

use crate::harness::{Seed, fuzz};
use crate::seeds;

/// Opens the folder as frames and reads all data of the first ones.
fn open_all(folder: &Path, depth: Option<&Path>) {
    let sources = vec![FrameFolder {
        frames: folder.to_owned(),
        depth: depth.map(Path::to_owned),
    }];
    let Ok(opened) = open(
        &OpenRequest {
            sources,
            ..OpenRequest::default()
        },
        &Progress::default(),
    ) else {
        return;
    };
    let store = FrameStore::new(64 << 20);
    for frame in opened.frames.iter().take(2) {
        let _ = store.image(frame).map(|image| {
            assert_eq!(
                image.pixels.len(),
                image.width as usize * image.height as usize
            );
        });
        let _ = store.depth(frame);
        let _ = store.thumbnail(frame, 16);
        let _ = exif_focal_px(frame);
    }
}

#[test]
fn images() {
    fuzz!("images", 20_000, seeds::images(), |folder, _| open_all(
        folder, None
    ));
}

#[test]
fn depth_maps() {
    let color = tempfile::tempdir().unwrap();
    std::fs::write(color.path().join("0.png"), seeds::color_png()).unwrap();
    fuzz!("depth maps", 10_000, seeds::depths(), |folder, _| open_all(
        color.path(),
        Some(folder)
    ));
}

#[test]
fn stereo_depth_maps() {
    let seed = Seed::new("0.tiff", seeds::estimated_depth());
    fuzz!("stereo depth maps", 10_000, [seed], |folder, seed| {
        let _ = EstimatedDepth::read(&folder.join(&seed.path));
    });
}
