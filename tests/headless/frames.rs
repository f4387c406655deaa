//! Tests of opening folders, RGB-D recordings and videos, and of the cache.

use std::path::{Path, PathBuf};

use ostra_core::job::Progress;
use ostra_frames::{
    FrameFolder, FrameStore, OpenRequest, Opened, missing_sources, open, open_more,
};

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

fn refused(request: &OpenRequest) -> String {
    open(request, &Progress::default()).unwrap_err().to_string()
}

fn names(opened: &Opened) -> Vec<&str> {
    opened
        .frames
        .iter()
        .map(|frame| frame.name.as_str())
        .collect()
}

/// Writes an image whose pixel values encode the position.
fn image(path: &Path, width: u32, height: u32) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([x as u8, y as u8, (x * y) as u8])
    })
    .save(path)
    .unwrap();
}

fn depth_image(path: &Path, width: u32, height: u32) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let steps = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(width, height, |x, y| {
        image::Luma([if (x, y) == (0, 0) {
            65535
        } else {
            (x + y) as u16
        }])
    });
    steps.save(path).unwrap();
}

#[test]
fn every_from_and_to_count_source_frames_and_to_is_included() {
    let folder = tempfile::tempdir().unwrap();
    for index in 0..12 {
        image(&folder.path().join(format!("img_{index}.png")), 4, 3);
    }
    let thinned = OpenRequest {
        every: 3,
        from: Some(2),
        to: Some(8),
        ..request(folder.path(), None)
    };
    assert_eq!(
        names(&opened(&thinned)),
        ["img_2.png", "img_5.png", "img_8.png"]
    );
    let beyond = OpenRequest {
        from: Some(12),
        ..request(folder.path(), None)
    };
    assert!(refused(&beyond).contains("there are 12, numbered from 0"));
}

#[test]
fn names_differ_between_folders_and_hidden_files_are_skipped() {
    let root = tempfile::tempdir().unwrap();
    for name in [
        "b/rgb/2.png",
        "b/rgb/10.png",
        "a/rgb/sub/1.png",
        "a/rgb/.hidden.png",
        "a/rgb/.thumbs/1.png",
    ] {
        image(&root.path().join(name), 4, 3);
    }
    std::fs::write(root.path().join("a/rgb/notes.txt"), "no image").unwrap();
    let sources = ["b/rgb", "a/rgb"].map(|name| FrameFolder::from(root.path().join(name)));
    let both = OpenRequest {
        sources: sources.to_vec(),
        ..OpenRequest::default()
    };
    assert_eq!(
        names(&opened(&both)),
        ["b/rgb/2.png", "b/rgb/10.png", "a/rgb/sub/1.png"]
    );
}

#[test]
fn depth_is_scaled_and_unknown_values_are_zero() {
    let root = tempfile::tempdir().unwrap();
    image(&root.path().join("color/1.png"), 4, 3);
    depth_image(&root.path().join("depth/1.png"), 4, 3);
    let request = OpenRequest {
        depth_unit: 0.5,
        ..request(root.path().join("color"), Some(root.path().join("depth")))
    };
    let opened = opened(&request);
    let depth = FrameStore::new(1 << 20)
        .depth(&opened.frames[0])
        .unwrap()
        .unwrap();
    assert_eq!(
        depth.depths,
        [0.0, 0.5, 1.0, 1.5, 0.5, 1.0, 1.5, 2.0, 1.0, 1.5, 2.0, 2.5]
    );
}

#[test]
fn truncated_body_is_an_error_not_a_grey_image() {
    for ending in ["png", "jpg", "tif", "webp"] {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join(format!("cut.{ending}"));
        image(&path, 200, 150);
        let whole = std::fs::read(&path).unwrap();
        let cut = if ending == "tif" {
            whole.len() - 2000
        } else {
            whole.len() * 2 / 3
        };
        let request = request(&path, None);
        let frames = opened(&request).frames;
        std::fs::write(&path, &whole[..cut]).unwrap();
        let error = FrameStore::new(1 << 20)
            .image(&frames[0])
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(&format!("cut.{ending}")) && error.contains("damaged or cut off"),
            "{error}"
        );
        if ending != "tif" {
            let error = refused(&request); // opening finds it, too
            assert!(
                error.contains(&format!("cut.{ending}")) && error.contains("damaged or cut off"),
                "{error}"
            );
        }
        std::fs::write(&path, &whole[..6]).unwrap();
        assert!(refused(&request).contains(&format!("cut.{ending}")));
    }
}

/// Returns an EXIF block that contains only the orientation.
pub(super) fn exif(orientation: u8) -> Vec<u8> {
    let mut exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    exif
}

#[test]
fn images_and_depth_are_rotated_by_their_exif_orientation() {
    let root = tempfile::tempdir().unwrap();
    let stored = image::RgbImage::from_fn(40, 24, |x, y| {
        image::Rgb(if x < 20 {
            if y < 12 { [250, 0, 0] } else { [0, 250, 0] }
        } else {
            [0, 0, 250]
        })
    });
    for orientation in 1..=8 {
        let (color, depth) = (
            root.path().join(format!("c{orientation}")),
            root.path().join(format!("d{orientation}")),
        );
        depth_image(&depth.join("1.png"), 40, 24);
        std::fs::create_dir_all(&color).unwrap();
        let file = std::fs::File::create(color.join("1.jpg")).unwrap();
        let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(file, 95);
        image::ImageEncoder::set_exif_metadata(&mut encoder, exif(orientation)).unwrap();
        encoder.encode_image(&stored).unwrap();

        let frame = opened(&request(&color, Some(depth.clone())))
            .frames
            .remove(0);
        let store = FrameStore::new(1 << 20);
        let (image, depth) = (
            store.image(&frame).unwrap(),
            store.depth(&frame).unwrap().unwrap(),
        );
        let size = if orientation >= 5 { (24, 40) } else { (40, 24) };
        assert_eq!(
            (frame.width, frame.height),
            size,
            "orientation {orientation}"
        );
        assert_eq!(
            (depth.width, depth.height),
            size,
            "orientation {orientation}"
        );
        let mut expected = image::DynamicImage::ImageRgb8(stored.clone());
        expected.apply_orientation(image::metadata::Orientation::from_exif(orientation).unwrap());
        let expected = expected.into_rgb8();
        let mut expected_depth =
            image::open(root.path().join(format!("d{orientation}/1.png"))).unwrap();
        expected_depth
            .apply_orientation(image::metadata::Orientation::from_exif(orientation).unwrap());
        let expected_depth = expected_depth.into_luma16();
        for (x, y) in [
            (4, 4),
            (size.0 - 5, 4),
            (4, size.1 - 5),
            (size.0 - 5, size.1 - 5),
        ] {
            let mut channels = image.at(x, y).into_iter().zip(expected.get_pixel(x, y).0);
            assert!(
                channels.all(|(a, b)| a.abs_diff(b) < 30),
                "orientation {orientation} at {x}, {y}"
            );
            let steps = expected_depth.get_pixel(x, y).0[0];
            assert!((depth.at(x, y) - f32::from(steps) / 1000.0).abs() < 1e-6);
        }
    }
}

#[test]
fn errors_name_the_source_that_cannot_be_opened() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    std::fs::create_dir(path("empty")).unwrap();
    let empty = refused(&request(path("empty"), None));
    assert!(
        empty.contains("empty: no images") && empty.contains("jpg, jpeg, png, tif, tiff, webp"),
        "{empty}"
    );
    assert!(refused(&request(path("nowhere"), None)).contains("nowhere: no such file or folder"));
    std::fs::create_dir(path("text")).unwrap();
    std::fs::write(path("text/a.png"), "this is no image").unwrap();
    let text = refused(&request(path("text"), None));
    assert!(
        text.contains("a.png: this is not a JPEG, PNG, TIFF or WebP image"),
        "{text}"
    );
    std::fs::write(path("text/a.png"), "").unwrap();
    assert!(refused(&request(path("text"), None)).contains("a.png: the file is empty"));
    assert!(
        refused(&OpenRequest {
            every: 0,
            ..request(path("empty"), None)
        })
        .contains("1 or more")
    );
    assert!(
        refused(&OpenRequest {
            depth_unit: f64::NAN,
            ..request(path("empty"), None)
        })
        .contains("depth unit")
    );
    assert!(refused(&OpenRequest::default()).contains("no frames are given"));
}

#[test]
fn header_with_an_excessive_size_is_refused() {
    let root = tempfile::tempdir().unwrap();
    let path = root.path().join("huge.jpg");
    image(&path, 16, 16);
    let mut bytes = std::fs::read(&path).unwrap();
    let size = bytes
        .windows(2)
        .position(|pair| pair == [0xff, 0xc0])
        .unwrap()
        + 5;
    bytes[size..size + 4].copy_from_slice(&[0xff; 4]);
    std::fs::write(&path, bytes).unwrap();
    assert!(
        refused(&request(&path, None)).contains("huge.jpg: its header says 65535 × 65535 pixels")
    );
}

#[test]
fn depth_that_does_not_fit_is_refused() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    image(&path("rgb/a.png"), 8, 6);
    depth_image(&path("small/a.png"), 4, 3);
    depth_image(&path("other/b.png"), 8, 6);
    image(&path("drawn/a.png"), 8, 6);
    image(&path("rgb/c.png"), 8, 6);
    depth_image(&path("other/d.png"), 8, 6);
    let small = refused(&request(path("rgb"), Some(path("small"))));
    assert!(
        small.contains("small/a.png: depth of 4 × 3 pixels")
            && small.contains("rgb/a.png of 8 × 6"),
        "{small}"
    );
    assert!(
        refused(&request(path("rgb"), Some(path("other"))))
            .contains("other: no depth image fits a frame")
    );
    assert!(
        refused(&request(path("rgb"), Some(path("drawn"))))
            .contains("a.png: depth must be a grey image of 16")
    );
}

#[test]
fn frames_without_depth_are_accepted_and_named() {
    let root = tempfile::tempdir().unwrap();
    for index in 0..8 {
        image(&root.path().join(format!("rgb/{index}.png")), 4, 3);
    }
    depth_image(&root.path().join("depth/depth_0003.png"), 4, 3);
    let opened = opened(&request(
        root.path().join("rgb"),
        Some(root.path().join("depth")),
    ));
    assert_eq!(
        opened
            .frames
            .iter()
            .filter(|frame| frame.depth.is_some())
            .count(),
        1
    );
    assert!(opened.frames[3].depth.is_some());
    assert_eq!(
        opened.warnings,
        ["7 of 8 frames have no depth: 0.png, 1.png, 2.png, …"]
    );
}

#[test]
fn rgbd_layouts_are_recognised_automatically() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    for index in 0..3 {
        image(
            &path(&format!("scenes/seq-01/frame-00000{index}.color.png")),
            4,
            3,
        );
        depth_image(
            &path(&format!("scenes/seq-01/frame-00000{index}.depth.png")),
            4,
            3,
        );
        image(&path(&format!("open3d/color/{index:06}.jpg")), 4, 3);
        depth_image(&path(&format!("open3d/depth/{index:06}.png")), 4, 3);
        image(&path(&format!("open3d/labels/{index:06}.png")), 4, 3);
        image(
            &path(&format!("tum/rgb/{}.100000.png", 1_305_031_102 + index)),
            4,
            3,
        );
        depth_image(
            &path(&format!("tum/depth/{}.115000.png", 1_305_031_102 + index)),
            4,
            3,
        );
        depth_image(&path(&format!("only/{index}.png")), 4, 3);
    }
    let all_with_depth = |opened: &Opened| {
        opened.frames.len() == 3 && opened.frames.iter().all(|f| f.depth.is_some())
    };
    let scenes = opened(&request(path("scenes"), None));
    assert!(
        all_with_depth(&scenes) && names(&scenes)[0] == "seq-01/frame-000000.color.png",
        "{scenes:?}"
    );
    let same = opened(&request(path("scenes/seq-01"), Some(path("scenes/seq-01"))));
    assert!(all_with_depth(&same) && same.warnings.is_empty());
    let open3d = opened(&request(path("open3d"), None));
    assert!(all_with_depth(&open3d) && names(&open3d)[0] == "color/000000.jpg");
    assert!(
        open3d.warnings[0].contains("3 of 3 images have depth, 3 other images in it are left out")
    );
    assert!(all_with_depth(&opened(&request(
        path("open3d"),
        Some(path("open3d/depth"))
    ))));
    let tum = opened(&request(path("tum"), None));
    assert!(
        all_with_depth(&tum)
            && tum
                .warnings
                .iter()
                .any(|line| line.contains("--depth-unit 0.0002"))
    );
    let only = opened(&request(path("only"), None));
    assert!(
        only.warnings[0].contains("3 frames are grey images of 16 bits"),
        "{:?}",
        only.warnings
    );
}

#[test]
fn associations_pair_depth_with_images() {
    let root = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        image(&root.path().join(format!("rgb/{name}.png")), 4, 3);
        depth_image(&root.path().join(format!("depth/{name}.png")), 4, 3);
    }
    std::fs::write(
        root.path().join("associations.txt"),
        "0.0 rgb/a.png 0.01 depth/b.png\n",
    )
    .unwrap();
    let opened = opened(&request(
        root.path().join("rgb"),
        Some(root.path().join("depth")),
    ));
    assert!(
        opened.frames[0]
            .depth
            .as_ref()
            .unwrap()
            .sensor_path()
            .unwrap()
            .ends_with("depth/b.png")
    );
    assert!(opened.frames[1].depth.is_none());
}

#[test]
fn three_thousand_frames_are_opened_from_their_headers() {
    let root = tempfile::tempdir().unwrap();
    let path = |index: usize| root.path().join(format!("IMG_{index}.jpg"));
    image(&path(0), 640, 480);
    for index in 1..3000 {
        std::fs::copy(path(0), path(index)).unwrap();
    }
    let start = std::time::Instant::now();
    let opened = opened(&request(root.path(), None));
    println!(
        "3,000 frames opened in {:.3} s",
        start.elapsed().as_secs_f64()
    );
    assert_eq!(opened.frames.len(), 3000);
    assert_eq!(names(&opened)[9..11], ["IMG_9.jpg", "IMG_10.jpg"]);
}

#[test]
fn cache_never_exceeds_its_budget() {
    let root = tempfile::tempdir().unwrap();
    for index in 0..30 {
        image(&root.path().join(format!("{index}.png")), 100, 100);
    }
    image(&root.path().join("large.png"), 300, 300);
    let frames = opened(&request(root.path(), None)).frames;
    let budget = 5 * 30_000 + 10;
    let store = FrameStore::new(budget);
    store.prefetch(&frames);
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (store, frames) = (&store, &frames);
            scope.spawn(move || {
                for step in 0..60 {
                    let frame = &frames[(step * (thread + 3)) % frames.len()];
                    assert_eq!(store.image(frame).unwrap().width, frame.width);
                    assert!(store.bytes_kept() <= budget);
                }
            });
        }
    });
    assert!(store.bytes_kept() >= 4 * 30_000, "the cache is used");
    let large = frames.iter().find(|frame| frame.width == 300).unwrap();
    assert_eq!(store.image(large).unwrap().pixels.len(), 90_000);
    assert!(store.cached_image(large).is_none());
}

#[test]
fn prefetched_frames_and_thumbnails_are_cached() {
    let root = tempfile::tempdir().unwrap();
    for index in 0..6 {
        image(&root.path().join(format!("{index}.png")), 64, 48);
    }
    let frames = opened(&request(root.path(), None)).frames;
    let store = FrameStore::new(1 << 20);
    assert!(
        store.cached_image(&frames[2]).is_none()
            && store.cached_thumbnail(&frames[2], 16).is_none()
    );
    store.prefetch(&frames[2..4]);
    store.prefetch_thumbnails(&frames, 16);
    while store.cached_image(&frames[3]).is_none()
        || store.cached_thumbnail(&frames[5], 16).is_none()
    {
        std::thread::yield_now();
    }
    let small = store.thumbnail(&frames[5], 16).unwrap();
    assert_eq!((small.width, small.height), (16, 12));
}

#[test]
fn changed_or_missing_image_is_reported() {
    let root = tempfile::tempdir().unwrap();
    let path = root.path().join("old/a.png");
    image(&path, 8, 6);
    let frames = opened(&request(path.parent().unwrap(), None)).frames;
    image(&path, 8, 7);
    let changed = FrameStore::new(1 << 20)
        .image(&frames[0])
        .unwrap_err()
        .to_string();
    assert!(
        changed.contains("a.png: it is 8 × 7 pixels now but was 8 × 6"),
        "{changed}"
    );
    image(&path, 8, 6);
    std::fs::rename(root.path().join("old"), root.path().join("new")).unwrap();
    let gone = FrameStore::new(1 << 20)
        .image(&frames[0])
        .unwrap_err()
        .to_string();
    assert!(
        gone.contains("a.png: is missing; if it was moved"),
        "{gone}"
    );

    assert_eq!(missing_sources(&frames), [frames[0].image.path()]);
}

#[test]
fn frames_added_later_get_unique_names() {
    let root = tempfile::tempdir().unwrap();
    for name in ["a/0.png", "a/1.png", "b/0.png", "b/7.png"] {
        image(&root.path().join(name), 4, 3);
    }
    let a = opened(&OpenRequest {
        to: Some(0),
        ..request(root.path().join("a"), None)
    });
    let b = open_more(
        &a.frames,
        &request(root.path().join("b"), None),
        &Progress::default(),
    )
    .unwrap();
    assert_eq!(
        (names(&a), names(&b)),
        (vec!["0.png"], vec!["b/0.png", "b/7.png"])
    );
    let rest = open_more(
        &a.frames,
        &request(root.path().join("a"), None),
        &Progress::default(),
    )
    .unwrap();
    assert_eq!(names(&rest), ["1.png"]);
    assert_eq!(
        rest.warnings,
        ["1 of 2 images are frames already and are left out"]
    );
    let none = open_more(
        &b.frames,
        &request(root.path().join("b"), None),
        &Progress::default(),
    );
    assert!(
        none.unwrap_err()
            .to_string()
            .contains("all 2 images are frames already")
    );
}

#[test]
fn opening_can_be_stopped() {
    let root = tempfile::tempdir().unwrap();
    image(&root.path().join("0.png"), 4, 3);
    let progress = Progress::default();
    progress.stop();
    assert_eq!(
        open(&request(root.path(), None), &progress)
            .unwrap_err()
            .to_string(),
        "stopped"
    );
}
