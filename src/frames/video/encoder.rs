use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::Path;
use std::process::Stdio;

use super::programs::{Programs, command};
use crate::{FrameError, Image};
use ostra_core::disk::{Unfinished, WorkFolder};
use ostra_core::job::Progress;
use ostra_core::programs::ChildProcess;

/// Size, length and rate of a video to write.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurntableOptions {
    /// Width and height of every image in pixels, above 0.
    pub size: (u32, u32),
    /// Number of images.
    pub count: usize,
    /// Images per second, above 0.
    pub fps: f64,
}

/// Writes a video with the system's ffmpeg; `draw` returns the image with a given number, from 0.
///
/// The file extension of `path` selects the format (mp4, mkv, webm …). The video is written to a
/// temporary file first, which is removed if writing is stopped or fails.
///
/// # Errors
///
/// [`FrameError::Invalid`] if ffmpeg is missing or fails, [`FrameError::Stopped`].
pub fn write_turntable(
    path: &Path,
    options: &TurntableOptions,
    draw: impl Fn(usize) -> Image,
    progress: &Progress,
) -> Result<(), FrameError> {
    // A separate folder lets the file keep its extension, from which ffmpeg infers the format.
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let work = WorkFolder::create(folder).map_err(|error| invalid(path, &error))?;
    let _listed = Unfinished::list(work.path());
    let part = work.path().join(path.file_name().unwrap_or_default());
    encode(path, &part, options, draw, progress)?;
    check_whole(path, &part, options.count)?;
    std::fs::rename(&part, path).map_err(|error| invalid(path, &error))
}

fn encode(
    path: &Path,
    part: &Path,
    options: &TurntableOptions,
    draw: impl Fn(usize) -> Image,
    progress: &Progress,
) -> Result<(), FrameError> {
    let ffmpeg = Encoder(start(path, part, options)?);
    let input = ffmpeg.0.take_stdin();
    for number in 0..options.count {
        progress.step(number, options.count)?;
        let image = draw(number);
        let bytes: &[u8] = bytemuck::cast_slice(&image.pixels);
        if input
            .as_ref()
            .is_none_or(|mut input| input.write_all(bytes).is_err())
        {
            break; // ffmpeg has ended; its error output has the reason
        }
    }
    drop(input);
    ffmpeg.finish(path)
}

/// Returns an error for a video without all images: ffmpeg may succeed although the disk was full.
fn check_whole(path: &Path, part: &Path, count: usize) -> Result<(), FrameError> {
    let programs = Programs::default();
    let mut probe = command(
        &programs.ffprobe,
        ["-v", "error", "-count_packets", "-select_streams", "v:0"],
    );
    probe
        .args(["-show_entries", "stream=nb_read_packets", "-of", "csv=p=0"])
        .arg(file_argument(path, part)?);
    let cannot =
        |error: &dyn std::fmt::Display| invalid(path, &format!("ffprobe cannot check it: {error}"));
    let child = ChildProcess::spawn(probe.stdin(Stdio::null()).stdout(Stdio::piped()))
        .map_err(|error| cannot(&error))?;
    let mut counted = String::new();
    if let Some(mut stdout) = child.take_stdout() {
        stdout
            .read_to_string(&mut counted)
            .map_err(|error| cannot(&error))?;
    }
    let ended = child.wait().map_err(|error| cannot(&error))?;
    let packets = counted
        .trim()
        .trim_end_matches(',')
        .parse::<usize>()
        .unwrap_or_default();
    if ended.success() && packets >= count {
        return Ok(());
    }
    Err(invalid(
        path,
        &format!("it holds {packets} of {count} images; the disk may be full"),
    ))
}

/// Returns a file argument for ffmpeg that cannot be read as an option or an address.
fn file_argument(path: &Path, part: &Path) -> Result<OsString, FrameError> {
    let mut argument = OsString::from("file:");
    argument.push(std::path::absolute(part).map_err(|source| FrameError::io(path, source))?);
    Ok(argument)
}

fn start(path: &Path, part: &Path, options: &TurntableOptions) -> Result<ChildProcess, FrameError> {
    let programs = Programs::default();
    let size = format!("{}x{}", options.size.0, options.size.1);
    let mut command = command(
        &programs.ffmpeg,
        [
            "-v", "error", "-xerror", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24",
        ],
    );
    command.args([
        "-s",
        &size,
        "-framerate",
        &options.fps.to_string(),
        "-i",
        "pipe:0",
    ]);
    let output = file_argument(path, part)?;
    // Most players need even sides and chroma at half resolution.
    command
        .args([
            "-vf",
            "pad=ceil(iw/2)*2:ceil(ih/2)*2",
            "-pix_fmt",
            "yuv420p",
        ])
        .arg(output);
    ChildProcess::spawn(command.stdin(Stdio::piped()).stdout(Stdio::null())).map_err(|error| FrameError::Invalid {
        path: path.into(),
        what: format!(
            "videos are made with ffmpeg, and {} cannot be started ({error}); install ffmpeg so that it is found by the PATH \
             (apt install ffmpeg, brew install ffmpeg, winget install ffmpeg)",
            programs.ffmpeg.display()
        ),
    })
}

/// A running ffmpeg, ended when dropped.
struct Encoder(ChildProcess);

impl Encoder {
    fn finish(self, path: &Path) -> Result<(), FrameError> {
        let mut message = String::new();
        if let Some(mut errors) = self.0.take_stderr() {
            let _ = errors.read_to_string(&mut message);
        }
        match self.0.wait() {
            Ok(status) if status.success() => Ok(()),
            Ok(status) if status.code().is_none() => Err(invalid(
                path,
                &format!("ffmpeg was ended from outside: {status}"),
            )),
            _ => Err(invalid(
                path,
                &message.lines().last().unwrap_or("ffmpeg ended early"),
            )),
        }
    }
}

fn invalid(path: &Path, why: &dyn std::fmt::Display) -> FrameError {
    let what = format!(
        "the video cannot be written ({why}); check the folder, its permissions and the ending, e.g. .mp4"
    );
    FrameError::Invalid {
        path: path.into(),
        what,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(number: usize) -> Image {
        Image {
            width: 31,
            height: 20,
            pixels: vec![[number as u8 * 20; 3]; 31 * 20],
        }
    }

    #[test]
    fn stopped_or_refused_video_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let options = TurntableOptions {
            size: (31, 20),
            count: 10,
            fps: 5.0,
        };
        let stopped = Progress::default();
        let path = folder.path().join("film.mp4");
        let stop_at_3 = |number| {
            if number == 3 {
                stopped.stop();
            }
            grey(number)
        };
        let result = write_turntable(&path, &options, stop_at_3, &stopped);
        if result
            .as_ref()
            .is_err_and(|error| error.to_string().contains("cannot be started"))
        {
            assert!(std::env::var_os("CI").is_none(), "ffmpeg is missing");
            return;
        }
        assert!(matches!(result, Err(FrameError::Stopped(_))));
        let refused = write_turntable(
            &folder.path().join("film.xyz"),
            &options,
            grey,
            &Progress::default(),
        );
        assert!(
            refused
                .unwrap_err()
                .to_string()
                .contains("video cannot be written")
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        write_turntable(&path, &options, grey, &Progress::default()).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
