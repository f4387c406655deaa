//! Synthetic videos, written with the system's ffmpeg.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// Returns whether ffmpeg can be started.
pub fn has_ffmpeg() -> bool {
    Command::new("ffmpeg").arg("-version").output().is_ok()
}

/// Properties of a synthetic video.
pub struct Making<'a> {
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// ffmpeg's name of the pixel format: `gray` or `rgb24`.
    pub pixels: &'a str,
    /// Number of images.
    pub count: u64,
    /// Output options for ffmpeg.
    pub options: &'a str,
}

/// Writes a video of 25 images per second; `picture` returns the pixels of each, row by row.
pub fn make_video(path: &Path, making: &Making<'_>, image: impl Fn(u64) -> Vec<u8>) {
    let mut command = Command::new("ffmpeg");
    let size = format!("{}x{}", making.size.0, making.size.1);
    command.args([
        "-v",
        "error",
        "-y",
        "-f",
        "rawvideo",
        "-pix_fmt",
        making.pixels,
        "-s",
        &size,
        "-r",
        "25",
        "-i",
        "-",
    ]);
    command
        .args(making.options.split_whitespace())
        .arg(path)
        .stdin(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    for k in 0..making.count {
        input.write_all(&image(k)).unwrap();
    }
    drop(input);
    assert!(child.wait().unwrap().success());
}
