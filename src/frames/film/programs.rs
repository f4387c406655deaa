use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use ffmpeg_sidecar::command::FfmpegCommand;

use crate::frames::FrameError;

/// The system's ffmpeg programs, found when they are first needed.
#[derive(Debug)]
pub(super) struct Programs {
    pub ffmpeg: PathBuf,
    pub ffprobe: PathBuf,
    every_picture_once: OnceLock<[&'static str; 2]>,
}

impl Default for Programs {
    fn default() -> Self {
        Self::new(ffmpeg_sidecar::paths::ffmpeg_path(), ffmpeg_sidecar::ffprobe::ffprobe_path())
    }
}

impl Programs {
    /// Programs at other places than the system's own.
    pub fn new(ffmpeg: PathBuf, ffprobe: PathBuf) -> Self {
        Self { ffmpeg, ffprobe, every_picture_once: OnceLock::new() }
    }

    /// The options that pass every picture on once, without doubling or dropping any to keep a rate.
    pub fn every_picture_once(&self) -> [&'static str; 2] {
        *self.every_picture_once.get_or_init(|| {
            let output = command(&self.ffmpeg, ["-version"]).output();
            let text = output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default();
            if is_before_5_1(&text) { ["-vsync", "passthrough"] } else { ["-fps_mode", "passthrough"] }
        })
    }
}

/// A program that reads nothing from the terminal; its output is piped here.
pub(super) fn command(program: &Path, arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Command {
    let mut command = Command::from(FfmpegCommand::new_with_path(program)); // opens no console on Windows
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// The error for a program that cannot be started to read `film`.
pub(super) fn not_started(film: &Path, program: &Path, error: &std::io::Error) -> FrameError {
    let what = format!(
        "films are read with ffmpeg, and {} cannot be started ({error}); install ffmpeg, with ffprobe, so that both are \
         found by the PATH (apt install ffmpeg, brew install ffmpeg, winget install ffmpeg), or give a folder of pictures",
        program.display()
    );
    FrameError::Invalid { path: film.into(), what }
}

/// Reads `ffmpeg version 4.4.2-…` or `ffmpeg version n5.0 …`; builds named otherwise are taken for new ones.
fn is_before_5_1(text: &str) -> bool {
    let version = text.strip_prefix("ffmpeg version ").unwrap_or_default().trim_start_matches('n');
    let mut numbers = version.split(|c: char| !c.is_ascii_digit()).map_while(|number| number.parse::<u32>().ok());
    numbers.next().is_some_and(|major| (major, numbers.next().unwrap_or(0)) < (5, 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_told_apart() {
        for old in ["4.4.2-0ubuntu0.22.04.1", "n5.0 Copyright", "5 Copyright"] {
            assert!(is_before_5_1(&format!("ffmpeg version {old}")), "{old}");
        }
        for new in ["5.1.9-0+deb12u1", "n6.0", "7.1", "10", "N-109468-gd39b34123d", "2024-01-01-git"] {
            assert!(!is_before_5_1(&format!("ffmpeg version {new}")), "{new}");
        }
    }
}
