//! Tests that real folders of images and depth open.

use std::path::PathBuf;

use ostra_core::job::Progress;
use ostra_frames::{FrameFolder, FrameStore, OpenRequest, Opened, open};

use crate::data::data_dir;

fn request(frames: impl Into<PathBuf>, depth: Option<PathBuf>) -> OpenRequest {
    OpenRequest {
        sources: vec![FrameFolder {
            frames: frames.into(),
            depth,
        }],
        ..OpenRequest::default()
    }
}

fn opened(request: &OpenRequest) -> Opened {
    open(request, &Progress::default()).unwrap()
}

fn names(opened: &Opened) -> Vec<&str> {
    opened
        .frames
        .iter()
        .map(|frame| frame.name.as_str())
        .collect()
}

fn a_real_rgbd_folder_opens_with_depth_in_metres() {
    let data = data_dir();
    let root = data.join("redkitchen_rgbd_a");
    let opened = opened(&request(root.join("color"), Some(root.join("depth"))));
    assert_eq!((opened.frames.len(), opened.warnings.len()), (167, 0));
    assert!(
        opened
            .frames
            .iter()
            .all(|frame| frame.depth.is_some() && (frame.width, frame.height) == (640, 480))
    );
    assert_eq!(names(&opened)[..2], ["000000.jpg", "000003.jpg"]);
    let store = FrameStore::new(64 << 20);
    let depth = store.depth(&opened.frames[0]).unwrap().unwrap();
    let known: Vec<f32> = depth.depths.iter().copied().filter(|d| *d > 0.0).collect();
    assert!(known.len() > depth.depths.len() / 2);
    assert!(
        known.iter().all(|d| (0.3..10.0).contains(d)),
        "a kitchen is metres deep"
    );
}

fn real_folders_of_images_decode() {
    let data = data_dir();
    let folders = [
        ("banana/images", 16),
        ("sceaux_castle/images", 11),
        ("romi_virtual_plant_labels/images", 18),
    ];
    let store = FrameStore::new(64 << 20);
    for (folder, count) in folders {
        let opened = opened(&request(data.join(folder), None));
        assert_eq!(opened.frames.len(), count, "{folder}");
        let image = store.image(&opened.frames[count - 1]).unwrap();
        assert_eq!(
            (image.width, image.height),
            (
                opened.frames[count - 1].width,
                opened.frames[count - 1].height
            )
        );
        assert_eq!(
            image.pixels.len(),
            image.width as usize * image.height as usize
        );
    }
}

crate::registry::tests! {
    Data(&["redkitchen_rgbd_a"]) => a_real_rgbd_folder_opens_with_depth_in_metres;
    Data(&["banana", "sceaux_castle", "romi_virtual_plant_labels"]) => real_folders_of_images_decode;
}
