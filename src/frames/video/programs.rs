use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use ffmpeg_sidecar::command::FfmpegCommand;

use crate::FrameError;
use ostra_core::programs::{ChildProcess, find};

/// Containers that contain their own data.
///
/// Those that refer to other files or addresses (playlists such as HLS and DASH, concat scripts,
/// SDP, image sequences) are left out: an untrusted file must not make ffmpeg open anything else.
const CONTAINERS: &str = "mov,matroska,webm,avi,mpegts,mpegtsraw,mpeg,mpegvideo,m4v,h261,h263,h264,hevc,vvc,vc1,\
                          vc1test,av1,obu,ivf,dirac,mjpeg,mjpeg_2000,dnxhd,cavsvideo,flv,live_flv,asf,ogg,gif,apng,nut,mxf,gxf,\
                          lxf,rm,dv,wtv,pva,nuv,swf,yuv4mpegpipe,smk,bink,roq,rpl,film_cpk,nsv,ty,viv,xmv,r3d,4xm";

/// The system's ffmpeg programs, located on first use.
#[derive(Debug)]
pub(super) struct Programs {
    pub ffmpeg: PathBuf,
    pub ffprobe: PathBuf,
    every_image_once: OnceLock<[&'static str; 2]>,
}

impl Default for Programs {
    fn default() -> Self {
        Self::new(located("ffmpeg"), located("ffprobe"))
    }
}

impl Programs {
    /// Returns programs at the given paths.
    pub fn new(ffmpeg: PathBuf, ffprobe: PathBuf) -> Self {
        Self {
            ffmpeg,
            ffprobe,
            every_image_once: OnceLock::new(),
        }
    }

    /// Returns the options that output every image once, without a constant rate.
    pub fn every_image_once(&self) -> [&'static str; 2] {
        *self.every_image_once.get_or_init(|| {
            let mut text = String::new();
            if let Ok(child) =
                ChildProcess::spawn(command(&self.ffmpeg, ["-version"]).stderr(Stdio::null()))
                && let Some(mut stdout) = child.take_stdout()
            {
                let _ = stdout.read_to_string(&mut text);
            }
            if is_before_5_1(&text) {
                ["-vsync", "passthrough"]
            } else {
                ["-fps_mode", "passthrough"]
            }
        })
    }
}

/// Returns the command of a program with piped output that reads nothing from the terminal.
pub(super) fn command(
    program: &Path,
    arguments: impl IntoIterator<Item = impl AsRef<OsStr>>,
) -> Command {
    // `FfmpegCommand` opens no console on Windows.
    let mut command = Command::from(FfmpegCommand::new_with_path(program));
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// Returns the program next to this one, else that of the `PATH`.
///
/// If there is none, returns the bare name, which [`ChildProcess::spawn`] refuses.
fn located(name: &str) -> PathBuf {
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let own = std::env::current_exe()
        .ok()
        .and_then(|exe| Some(exe.parent()?.join(file)));
    own.filter(|path| path.is_absolute() && path.is_file())
        .or_else(|| find(name))
        .unwrap_or_else(|| name.into())
}

/// Returns the arguments that name an input: a regular file by its absolute path, only as `file:`.
///
/// # Errors
///
/// [`FrameError`] if the path is relative (it may be an address) or not that of a regular file.
pub(super) fn input(path: &Path) -> Result<Vec<OsString>, FrameError> {
    let invalid = |what: &str| FrameError::Invalid {
        path: path.into(),
        what: what.to_owned(),
    };
    if !path.is_absolute() {
        return Err(invalid(
            "the path of a video must be absolute; point the project to the file",
        ));
    }
    let file = path
        .metadata()
        .map_err(|source| FrameError::io(path, source))?;
    if !file.is_file() {
        return Err(invalid("not a regular file; give a video file"));
    }
    let mut name = OsString::from("file:");
    name.push(path);
    let options = [
        "-protocol_whitelist",
        "file",
        "-format_whitelist",
        CONTAINERS,
        "-i",
    ];
    Ok(options
        .into_iter()
        .map(OsString::from)
        .chain([name])
        .collect())
}

/// Returns the meaning of an ffmpeg error for the user, if its own text is not clear.
pub(super) fn explained(complaint: &str) -> String {
    if complaint.contains("not on whitelist") {
        return "its format is not a supported video container, or one that refers to other files, such as a playlist"
            .to_owned();
    }
    complaint.to_owned()
}

/// Returns the error for a program that cannot be started to read `film`.
pub(super) fn not_started(video: &Path, program: &Path, error: &std::io::Error) -> FrameError {
    let what = format!(
        "videos are read with ffmpeg, and {} cannot be started ({error}); install ffmpeg, with ffprobe, so that both are \
         found by the PATH (apt install ffmpeg, brew install ffmpeg, winget install ffmpeg), or give a folder of images",
        program.display()
    );
    FrameError::Invalid {
        path: video.into(),
        what,
    }
}

/// Returns whether a line `ffmpeg version 4.4.2-…` or `ffmpeg version n5.0 …` is older than 5.1.
///
/// Builds with other names count as new.
fn is_before_5_1(text: &str) -> bool {
    let version = text
        .strip_prefix("ffmpeg version ")
        .unwrap_or_default()
        .trim_start_matches('n');
    let mut numbers = version
        .split(|c: char| !c.is_ascii_digit())
        .map_while(|number| number.parse::<u32>().ok());
    numbers
        .next()
        .is_some_and(|major| (major, numbers.next().unwrap_or(0)) < (5, 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_before_5_1_are_recognised() {
        for old in ["4.4.2-0ubuntu0.22.04.1", "n5.0 Copyright", "5 Copyright"] {
            assert!(is_before_5_1(&format!("ffmpeg version {old}")), "{old}");
        }
        for new in [
            "5.1.9-0+deb12u1",
            "n6.0",
            "7.1",
            "10",
            "N-109468-gd39b34123d",
            "2024-01-01-git",
        ] {
            assert!(!is_before_5_1(&format!("ffmpeg version {new}")), "{new}");
        }
    }
}
