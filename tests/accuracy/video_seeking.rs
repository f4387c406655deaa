//! Tests that seeking returns the requested frame, for every codec and container.

use std::path::Path;
use std::process::Command;

use ostra_core::job::Progress;
use ostra_frames::{FrameFolder, FrameStore, OpenRequest, Opened, open};

use crate::video::{Making, make_video};

const SIZE: (u32, u32) = (64, 48);
const COUNT: u64 = 150;

/// Returns the image of a bright square that moves over textured ground.
///
/// Every frame differs and depends on the one before.
fn image(k: u64) -> Vec<u8> {
    let (left, top) = ((k * 3 % 52) as u32, (k % 36) as u32);
    let pixel = |at: u32| {
        let (x, y) = (at % SIZE.0, at / SIZE.0);
        let inside = (left..left + 12).contains(&x) && (top..top + 12).contains(&y);
        if inside {
            [220, 40 + (k % 200) as u8, 30]
        } else {
            [(x * 3 % 120) as u8, (y * 4 % 130) as u8, 90]
        }
    };
    (0..SIZE.0 * SIZE.1).flat_map(pixel).collect()
}

fn open_video(path: &Path) -> Opened {
    let request = OpenRequest {
        sources: vec![FrameFolder::from(path.to_path_buf())],
        ..OpenRequest::default()
    };
    open(&request, &Progress::default()).unwrap()
}

/// Returns every frame of an independent linear decode, as RGB.
fn linear(path: &Path, frame_bytes: usize) -> Vec<Vec<u8>> {
    let mut command = Command::new("ffmpeg");
    command
        .args(["-v", "quiet", "-nostdin", "-threads", "1", "-i"])
        .arg(path);
    command.args([
        "-map",
        "0:V:0",
        "-vsync",
        "passthrough",
        "-pix_fmt",
        "rgb24",
        "-f",
        "rawvideo",
        "-",
    ]);
    command
        .output()
        .unwrap()
        .stdout
        .chunks_exact(frame_bytes)
        .map(<[u8]>::to_vec)
        .collect()
}

/// Opens a video and compares its frames by seeking with those of a linear decode.
///
/// Frames are read each with a new store, backwards with one store, and in order.
fn compare(path: &Path, seeks: &[usize]) -> Opened {
    let opened = open_video(path);
    let size = (opened.frames[0].width * opened.frames[0].height * 3) as usize;
    let truth = linear(path, size);
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    assert_eq!(
        opened.frames.len(),
        truth.len(),
        "{name}: {:?}",
        opened.warnings
    );
    let check = |store: &FrameStore, index: usize, how: &str| {
        let image = store.image(&opened.frames[index]).unwrap();
        let pixels: &[u8] = bytemuck::cast_slice(&image.pixels);
        let shown = truth.iter().position(|truth| truth == pixels);
        assert!(
            truth[index] == pixels,
            "{name}: frame {index} {how} shows {shown:?}"
        );
    };
    for &index in seeks.iter().filter(|&&index| index < truth.len()) {
        let store = FrameStore::new(1 << 20);
        for index in index..(index + 3).min(truth.len()) {
            check(&store, index, "after a seek");
        }
    }
    let (backwards, forwards) = (FrameStore::new(1), FrameStore::new(1));
    for index in (0..truth.len()).rev().step_by(50) {
        check(&backwards, index, "backwards");
    }
    for index in 0..truth.len() {
        check(&forwards, index, "in order");
    }
    opened
}

/// Returns whether ffmpeg can make such a video; prints why not.
fn has_encoder(options: &str) -> bool {
    let words: Vec<&str> = options.split_whitespace().collect();
    let at = words.iter().position(|word| *word == "-c:v");
    let Some(encoder) = at.map(|at| words[at + 1]) else {
        return true;
    };
    let encoders = Command::new("ffmpeg")
        .args(["-hide_banner", "-encoders"])
        .output()
        .unwrap()
        .stdout;
    let has = String::from_utf8_lossy(&encoders)
        .split_whitespace()
        .any(|word| word == encoder);
    if !has {
        println!("skipped: this ffmpeg has no encoder {encoder}");
    }
    has
}

const KINDS: [(&str, &str); 16] = [
    (
        "open_gop_hevc.mp4",
        "-c:v libx265 -x265-params log-level=none:open-gop=1:keyint=70:min-keyint=70:bframes=4 -pix_fmt yuv420p",
    ),
    (
        "open_gop_hevc.mkv",
        "-c:v libx265 -x265-params log-level=none:open-gop=1:keyint=70:min-keyint=70:bframes=4 -pix_fmt yuv420p",
    ),
    (
        "open_gop_h264.mkv",
        "-c:v libx264 -x264-params open-gop=1:keyint=70:min-keyint=70:scenecut=0:bframes=4 -pix_fmt yuv420p",
    ),
    (
        "open_gop_h264.mp4",
        "-c:v libx264 -x264-params open-gop=1:keyint=70:min-keyint=70:scenecut=0:bframes=4 -pix_fmt yuv420p",
    ),
    (
        "intra_refresh.mp4",
        "-c:v libx264 -x264-params intra-refresh=1:keyint=50 -pix_fmt yuv420p",
    ),
    (
        "intra_refresh.mkv",
        "-c:v libx264 -x264-params intra-refresh=1:keyint=50 -pix_fmt yuv420p",
    ),
    (
        "intra_refresh.ts",
        "-c:v libx264 -x264-params intra-refresh=1:keyint=50 -pix_fmt yuv420p",
    ),
    ("b_frames_mpeg4.avi", "-c:v mpeg4 -q:v 3 -bf 2 -g 40"),
    ("b_frames_xvid.avi", "-c:v libxvid -q:v 3 -bf 2 -g 40"),
    (
        "b_frames_h264.avi",
        "-c:v libx264 -bf 3 -g 60 -pix_fmt yuv420p",
    ),
    (
        "edit_list.mov",
        "-ss 0.5 -c:v libx264 -bf 3 -g 80 -pix_fmt yuv420p",
    ),
    (
        "variable_rate.mkv",
        "-vf setpts=N*N*20 -vsync passthrough -c:v libx264 -g 70 -pix_fmt yuv420p",
    ),
    (
        "variable_rate.mp4",
        "-vf setpts=N*N*20 -vsync passthrough -video_track_timescale 90000 -c:v libx264 -g 70 -pix_fmt yuv420p",
    ),
    ("program_stream.mpg", "-c:v mpeg2video -q:v 3 -bf 2 -g 30"),
    (
        "vp9.webm",
        "-c:v libvpx-vp9 -b:v 300k -g 70 -auto-alt-ref 1 -lag-in-frames 16 -deadline realtime -cpu-used 8",
    ),
    ("mpeg4.mkv", "-c:v mpeg4 -q:v 3 -bf 2 -g 40"),
];

fn frames_by_seeking_and_in_order_equal_a_linear_decode() {
    let folder = tempfile::tempdir().unwrap();
    for (name, options) in KINDS
        .into_iter()
        .filter(|(_, options)| has_encoder(options))
    {
        let path = folder.path().join(name);
        make_video(
            &path,
            &Making {
                size: SIZE,
                pixels: "rgb24",
                count: COUNT,
                options,
            },
            image,
        );
        compare(&path, &[69, 70, 99, 140]);
    }
}

fn frames_of_equal_times_are_distinguished() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("3000_a_second.mkv");
    // Matroska counts milliseconds, so two or three frames have the same time.
    let options = "-vf settb=1/3000,setpts=N -r 3000 -c:v libx264 -g 70 -pix_fmt yuv420p";
    make_video(
        &path,
        &Making {
            size: SIZE,
            pixels: "rgb24",
            count: COUNT,
            options,
        },
        image,
    );
    let opened = compare(&path, &[64, 65, 66, 99, 140]);
    assert_eq!(opened.frames.len() as u64, COUNT);
}

fn damaged_stream_is_reported_and_equals_a_linear_decode() {
    let folder = tempfile::tempdir().unwrap();
    for (name, options) in [
        ("damaged.mkv", "-c:v libx264 -g 70 -bf 2 -pix_fmt yuv420p"),
        ("damaged.mpg", "-c:v mpeg2video -q:v 3 -bf 2 -g 30"),
    ] {
        let (whole, path) = (
            folder.path().join(format!("whole_{name}")),
            folder.path().join(name),
        );
        make_video(
            &whole,
            &Making {
                size: SIZE,
                pixels: "rgb24",
                count: COUNT,
                options,
            },
            image,
        );
        let mut bytes = std::fs::read(&whole).unwrap();
        let at = bytes.len() / 2;
        bytes[at..at + 300]
            .iter_mut()
            .for_each(|byte| *byte ^= 0x5a);
        std::fs::write(&path, bytes).unwrap();
        let opened = compare(&path, &[20, 100, 140]);
        assert!(
            opened.warnings[0].contains("damaged (") && opened.warnings[0].contains("frame"),
            "{:?}",
            opened.warnings
        );
    }
}

#[cfg(unix)]
fn rotated_video_and_unusual_names_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let options = "-metadata:s:v:0 rotate=90 -c:v libx264 -g 70 -pix_fmt yuv420p";
    for name in ["-y.mp4", "a%03d.mp4", "http:x*.mp4", "turned?.mp4"] {
        let made = folder.path().join("made.mp4");
        make_video(
            &made,
            &Making {
                size: SIZE,
                pixels: "rgb24",
                count: 80,
                options,
            },
            image,
        );
        let path = folder.path().join(name);
        std::fs::rename(&made, &path).unwrap();
        let frames = open_video(&path).frames;
        assert_eq!(frames.len(), 80, "{name}");
        assert_eq!(
            FrameStore::new(1 << 20).image(&frames[79]).unwrap().width,
            frames[79].width
        );
    }
}

fn files_that_refer_to_other_files_are_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let secret = folder.path().join("secret.mp4");
    let options = "-c:v libx264 -pix_fmt yuv420p";
    make_video(
        &secret,
        &Making {
            size: SIZE,
            pixels: "rgb24",
            count: 20,
            options,
        },
        image,
    );
    let secret = secret.display();
    let playlists = [
        (
            "list.ffconcat",
            format!("ffconcat version 1.0\nfile '{secret}'\n"),
        ),
        (
            "list.mp4",
            format!("ffconcat version 1.0\nfile 'file:{secret}'\n"),
        ),
        (
            "list.m3u8",
            format!("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{secret}\n#EXT-X-ENDLIST\n"),
        ),
        (
            "list.avi",
            format!(
                "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfile:{secret}\n#EXT-X-ENDLIST\n"
            ),
        ),
        (
            "call.sdp",
            "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 9 RTP/AVP 96\n"
                .to_owned(),
        ),
    ];
    for (name, text) in playlists {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let request = OpenRequest {
            sources: vec![FrameFolder::from(path)],
            ..OpenRequest::default()
        };
        let error = open(&request, &Progress::default())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(name) && error.contains("cannot read this as a video"),
            "{error}"
        );
        assert!(
            error.contains("refers to other files") && error.len() < 500,
            "{error}"
        );
    }
}

fn relative_paths_and_addresses_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("video.mp4");
    let options = "-c:v libx264 -pix_fmt yuv420p";
    make_video(
        &path,
        &Making {
            size: SIZE,
            pixels: "rgb24",
            count: 5,
            options,
        },
        image,
    );
    let frame = open_video(&path).frames.remove(0);
    for address in [
        "http://127.0.0.1:9/secret",
        "Cargo.toml",
        "-y",
        "concat:a|b",
        "pipe:0",
    ] {
        let mut frame = frame.clone();
        frame.image = ostra_frames::ImageSource::Video {
            path: address.into(),
            index: 0,
            time_s: 0.0,
        };
        let error = FrameStore::new(1).image(&frame).unwrap_err().to_string();
        assert!(
            error.contains(address) && (error.contains("absolute") || error.contains("is missing")),
            "{error}"
        );
    }
}

crate::registry::tests! {
    Ffmpeg =>
        frames_by_seeking_and_in_order_equal_a_linear_decode,
        frames_of_equal_times_are_distinguished,
        damaged_stream_is_reported_and_equals_a_linear_decode,
        rotated_video_and_unusual_names_are_read,
        files_that_refer_to_other_files_are_not_followed,
        relative_paths_and_addresses_are_refused;
}
