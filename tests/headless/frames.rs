//! Opening folders, RGB-D recordings and films; the cache.

use std::path::{Path, PathBuf};

use ostra::engine::job::Progress;
use ostra::frames::{FrameFolder, FrameStore, OpenRequest, Opened, open};

use crate::support::data_dir;

fn request(frames: impl Into<PathBuf>, depth: Option<PathBuf>) -> OpenRequest {
    OpenRequest { sources: vec![FrameFolder { frames: frames.into(), depth }], ..OpenRequest::default() }
}

fn opened(request: &OpenRequest) -> Opened {
    open(request, &Progress::default()).unwrap()
}

fn refused(request: &OpenRequest) -> String {
    open(request, &Progress::default()).unwrap_err().to_string()
}

fn names(opened: &Opened) -> Vec<&str> {
    opened.frames.iter().map(|frame| frame.name.as_str()).collect()
}

/// A picture with a value that tells where a pixel is.
fn picture(path: &Path, width: u32, height: u32) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, (x * y) as u8])).save(path).unwrap();
}

fn depth_picture(path: &Path, width: u32, height: u32) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let steps = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(width, height, |x, y| {
        image::Luma([if (x, y) == (0, 0) { 65535 } else { (x + y) as u16 }])
    });
    steps.save(path).unwrap();
}

#[test]
fn a_real_rgbd_folder_opens_with_depth_in_metres() {
    let Some(data) = data_dir() else { return };
    let root = data.join("redkitchen_rgbd_a");
    let opened = opened(&request(root.join("color"), Some(root.join("depth"))));
    assert_eq!((opened.frames.len(), opened.warnings.len()), (167, 0));
    assert!(opened.frames.iter().all(|frame| frame.depth.is_some() && (frame.width, frame.height) == (640, 480)));
    assert_eq!(names(&opened)[..2], ["000000.jpg", "000003.jpg"]);
    let store = FrameStore::new(64 << 20);
    let depth = store.depth(&opened.frames[0]).unwrap().unwrap();
    let known: Vec<f32> = depth.depths.iter().copied().filter(|d| *d > 0.0).collect();
    assert!(known.len() > depth.depths.len() / 2);
    assert!(known.iter().all(|d| (0.3..10.0).contains(d)), "a kitchen is metres deep");
}

#[test]
fn real_folders_of_pictures_decode() {
    let Some(data) = data_dir() else { return };
    let folders = [("banana/images", 16), ("sceaux_castle/images", 11), ("romi_virtual_plant_labels/images", 18)];
    let store = FrameStore::new(64 << 20);
    for (folder, count) in folders {
        let opened = opened(&request(data.join(folder), None));
        assert_eq!(opened.frames.len(), count, "{folder}");
        let image = store.image(&opened.frames[count - 1]).unwrap();
        assert_eq!((image.width, image.height), (opened.frames[count - 1].width, opened.frames[count - 1].height));
        assert_eq!(image.pixels.len(), image.width as usize * image.height as usize);
    }
}

#[test]
fn every_from_to_count_source_frames_and_to_is_included() {
    let folder = tempfile::tempdir().unwrap();
    for index in 0..12 {
        picture(&folder.path().join(format!("img_{index}.png")), 4, 3);
    }
    let thinned = OpenRequest { every: 3, from: Some(2), to: Some(8), ..request(folder.path(), None) };
    assert_eq!(names(&opened(&thinned)), ["img_2.png", "img_5.png", "img_8.png"]);
    let beyond = OpenRequest { from: Some(12), ..request(folder.path(), None) };
    assert!(refused(&beyond).contains("there are 12, numbered from 0"));
}

#[test]
fn several_folders_are_named_apart_and_hidden_files_are_skipped() {
    let root = tempfile::tempdir().unwrap();
    for name in ["b/rgb/2.png", "b/rgb/10.png", "a/rgb/sub/1.png", "a/rgb/.hidden.png", "a/rgb/.thumbs/1.png"] {
        picture(&root.path().join(name), 4, 3);
    }
    std::fs::write(root.path().join("a/rgb/notes.txt"), "no picture").unwrap();
    let sources = ["b/rgb", "a/rgb"].map(|name| FrameFolder::from(root.path().join(name)));
    let both = OpenRequest { sources: sources.to_vec(), ..OpenRequest::default() };
    assert_eq!(names(&opened(&both)), ["b/rgb/2.png", "b/rgb/10.png", "a/rgb/sub/1.png"]);
}

#[test]
fn depth_is_scaled_and_its_unknown_values_are_zero() {
    let root = tempfile::tempdir().unwrap();
    picture(&root.path().join("color/1.png"), 4, 3);
    depth_picture(&root.path().join("depth/1.png"), 4, 3);
    let request =
        OpenRequest { depth_unit: 0.5, ..request(root.path().join("color"), Some(root.path().join("depth"))) };
    let opened = opened(&request);
    let depth = FrameStore::new(1 << 20).depth(&opened.frames[0]).unwrap().unwrap();
    assert_eq!(depth.depths, [0.0, 0.5, 1.0, 1.5, 0.5, 1.0, 1.5, 2.0, 1.0, 1.5, 2.0, 2.5]);
}

#[test]
fn a_cut_off_body_is_an_error_not_a_grey_picture() {
    for ending in ["png", "jpg", "tif", "webp"] {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join(format!("cut.{ending}"));
        picture(&path, 200, 150);
        let whole = std::fs::read(&path).unwrap();
        let cut = if ending == "tif" { whole.len() - 2000 } else { whole.len() * 2 / 3 };
        let request = request(&path, None);
        let frames = opened(&request).frames;
        std::fs::write(&path, &whole[..cut]).unwrap();
        let error = FrameStore::new(1 << 20).image(&frames[0]).unwrap_err().to_string();
        assert!(error.contains(&format!("cut.{ending}")) && error.contains("damaged or cut off"), "{error}");
        std::fs::write(&path, &whole[..6]).unwrap();
        assert!(refused(&request).contains(&format!("cut.{ending}")));
    }
}
