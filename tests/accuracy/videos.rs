//! Tests of videos through ffmpeg: their images, and that an index always gives the same one.

use std::path::Path;

use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameFolder, FrameStore, OpenRequest, Opened, open};

use crate::video::{self, Making};

const COUNT: u64 = 80;
const SIZE: (u32, u32) = (96, 64);

/// Writes a video whose image k shows k: the left half k / 10, the right half k mod 10, in grey.
fn make_video(path: &Path, options: &str) {
    video::make_video(
        path,
        &Making {
            size: SIZE,
            pixels: "gray",
            count: COUNT,
            options,
        },
        |k| {
            let grey = |x: u32| {
                if x < SIZE.0 / 2 {
                    30 + 20 * (k / 10) as u8
                } else {
                    30 + 20 * (k % 10) as u8
                }
            };
            (0..SIZE.0 * SIZE.1).map(|at| grey(at % SIZE.0)).collect()
        },
    );
}

/// Returns the index of the [`make_video`] image that a frame shows.
fn shown(store: &FrameStore, frame: &Frame) -> u64 {
    let image = store.image(frame).unwrap();
    let digit = |x| (f64::from(image.at(x, image.height / 2)[1]) - 30.0) / 20.0;
    let (tens, ones) = (digit(image.width / 4), digit(image.width * 3 / 4));
    assert!(
        (tens - tens.round()).abs() < 0.3 && (ones - ones.round()).abs() < 0.3,
        "{tens} {ones}"
    );
    tens.round() as u64 * 10 + ones.round() as u64
}

fn open_video(path: &Path) -> Opened {
    let request = OpenRequest {
        sources: vec![FrameFolder::from(path.to_path_buf())],
        ..OpenRequest::default()
    };
    open(&request, &Progress::default()).unwrap()
}

fn every_index_gives_its_image_in_any_order_and_container() {
    let folder = tempfile::tempdir().unwrap();
    let kinds = [
        (
            "b-frames.mp4",
            "-c:v libx264 -preset ultrafast -bf 3 -g 30 -pix_fmt yuv420p",
        ),
        (
            "uneven.mkv",
            "-vf setpts=N*N*20 -fps_mode passthrough -enc_time_base -1 -c:v libx264 -g 20 -pix_fmt yuv420p",
        ),
        ("old.avi", "-c:v mpeg4 -q:v 2 -bf 2"),
        ("broadcast.ts", "-c:v mpeg2video -q:v 2 -bf 2"),
        (
            "hidden.webm",
            "-c:v libvpx -b:v 1M -auto-alt-ref 1 -lag-in-frames 16",
        ),
    ];
    for (name, options) in kinds {
        let path = folder.path().join(name);
        make_video(&path, options);
        let opened = open_video(&path);
        assert_eq!(
            opened.frames.len() as u64,
            COUNT,
            "{name}: {:?}",
            opened.warnings
        );
        let stem = name.split('.').next().unwrap();
        assert_eq!(opened.frames[7].name, format!("{stem}/000007"));
        assert_eq!((opened.frames[7].width, opened.frames[7].height), SIZE);
        let store = FrameStore::new(1 << 20);
        for index in [50, 3, 79, 4, 5, 20, 0, 78] {
            assert_eq!(
                shown(&store, &opened.frames[index]),
                index as u64,
                "{name} at random"
            );
        }
        let fresh = FrameStore::new(1 << 20);
        for (index, frame) in opened.frames.iter().enumerate() {
            assert_eq!(shown(&fresh, frame), index as u64, "{name} in order");
        }
    }
}

fn threads_that_read_one_video_concurrently_get_the_right_images() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.mp4");
    make_video(
        &path,
        "-c:v libx264 -preset ultrafast -g 20 -pix_fmt yuv420p",
    );
    let frames = open_video(&path).frames;
    let store = FrameStore::new(100 << 10);
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (store, frames) = (&store, &frames);
            scope.spawn(move || {
                for step in 0..12 {
                    let index = (thread * 17 + step) % frames.len();
                    assert_eq!(shown(store, &frames[index]), index as u64);
                    assert!(store.bytes_kept() <= 100 << 10);
                }
            });
        }
    });
}

fn truncated_video_is_read_to_its_end_and_broken_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (path, cut) = (
        folder.path().join("whole.mp4"),
        folder.path().join("cut.mp4"),
    );
    make_video(
        &path,
        "-c:v libx264 -g 10 -pix_fmt yuv420p -movflags +faststart",
    );
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() * 7 / 10]).unwrap();
    let opened = open_video(&cut);
    assert!((10..COUNT as usize).contains(&opened.frames.len()));
    assert!(
        opened.warnings[0].contains("cut.mp4: damaged"),
        "{:?}",
        opened.warnings
    );
    let store = FrameStore::new(1 << 20);
    assert_eq!(shown(&store, &opened.frames[9]), 9);
    for broken in [&bytes[..40], b"no video at all"] {
        std::fs::write(&cut, broken).unwrap();
        let request = OpenRequest {
            sources: vec![FrameFolder::from(cut.clone())],
            ..OpenRequest::default()
        };
        let error = open(&request, &Progress::default())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("cut.mp4: ffmpeg cannot read this as a video"),
            "{error}"
        );
    }
    let gone = store.image(&open_video(&path).frames[3]).map(|_| ());
    assert!(gone.is_ok());
    let frame = open_video(&path).frames.remove(4);
    std::fs::remove_file(&path).unwrap();
    assert!(
        store
            .image(&frame)
            .unwrap_err()
            .to_string()
            .contains("whole.mp4: is missing")
    );
}

crate::registry::tests! {
    Ffmpeg =>
        every_index_gives_its_image_in_any_order_and_container,
        threads_that_read_one_video_concurrently_get_the_right_images,
        truncated_video_is_read_to_its_end_and_broken_one_is_refused;
}
