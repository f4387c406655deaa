use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::programs::{Programs, command, not_started};
use crate::frames::header::MAX_PIXELS;
use crate::frames::{FrameError, Image};

/// Where to start decoding a film.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    /// Number of the first picture wanted.
    pub index: u64,
    /// Its time in seconds from the start.
    pub time_s: f64,
    /// How many pictures to decode ahead of what is asked for; at least 1.
    pub ahead: usize,
}

/// Pictures are found by their time less this: pictures of films lie farther apart.
const JUST_BEFORE_S: f64 = 0.0004;

/// How much earlier to begin, in seconds, in films without an index, where ffmpeg may land behind the time asked for.
const RUN_UP_S: f64 = 10.0;

/// Endings of the kinds of film that have an index, in lower case.
const INDEXED: [&str; 7] = ["mp4", "m4v", "mov", "mkv", "webm", "avi", "3gp"];

/// A running ffmpeg that hands out the pictures of a film in order, some of them decoded ahead.
#[derive(Debug)]
pub(super) struct Decoder {
    child: Child,
    /// `None` only while dropped.
    pictures: Option<Receiver<Result<Image, String>>>,
    reader: Option<std::thread::JoinHandle<()>>,
}

impl Decoder {
    /// Starts ffmpeg so that [`Self::next`] first gives the picture `start.index`.
    pub fn start(programs: &Programs, path: &Path, start: Start) -> Result<Self, FrameError> {
        let mut command = command(&programs.ffmpeg, ["-v", "error", "-nostdin"]);
        let (seek, run_up) = seek_and_run_up(path, start);
        if seek > 0.0 {
            command.args(["-ss", &format!("{seek:.6}")]);
        }
        command.arg("-i").arg(path).args(["-map", "0:V:0"]);
        if run_up > 0.0 {
            command.args(["-ss", &format!("{run_up:.6}")]);
        }
        command.args(programs.every_picture_once()).args(["-pix_fmt", "rgb24", "-c:v", "ppm", "-f", "image2pipe", "-"]);
        let mut child =
            command.stderr(Stdio::null()).spawn().map_err(|error| not_started(path, &programs.ffmpeg, &error))?;
        let (sender, pictures) = sync_channel(start.ahead.max(1));
        let stdout = child.stdout.take();
        let reader = std::thread::Builder::new().name("film".into()).spawn(move || {
            if let Some(stdout) = stdout {
                read_pictures(stdout, &sender);
            }
        });
        let reader = Some(reader.map_err(|source| FrameError::io(path, source))?);
        Ok(Self { child, pictures: Some(pictures), reader })
    }

    /// The next picture; an error says why there is none.
    pub fn next(&mut self) -> Result<Image, String> {
        let received = self.pictures.as_ref().map(Receiver::recv);
        received.and_then(Result::ok).unwrap_or_else(|| Err("the film has no more pictures".into()))
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        drop(self.pictures.take()); // so that the reader does not wait for someone to take a picture
        let _ = self.child.kill();
        let _ = self.child.wait();
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
    }
}

/// The time to seek to, and how long to decode from there without giving pictures out.
fn seek_and_run_up(path: &Path, start: Start) -> (f64, f64) {
    if start.index == 0 {
        return (0.0, 0.0);
    }
    let time_s = start.time_s - JUST_BEFORE_S;
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if INDEXED.contains(&ending.as_str()) {
        return (time_s, 0.0);
    }
    let seek = (time_s - RUN_UP_S).max(0.0);
    (seek, time_s - seek)
}

fn read_pictures(stdout: ChildStdout, sender: &SyncSender<Result<Image, String>>) {
    let mut reader = BufReader::with_capacity(1 << 16, stdout);
    loop {
        let picture = match reader.fill_buf() {
            Ok([]) => return,
            _ => read_ppm(&mut reader).map_err(|error| format!("it breaks off: {error}")),
        };
        let broken = picture.is_err();
        if sender.send(picture).is_err() || broken {
            return;
        }
    }
}

/// Reads one binary PPM of 8 bits, as ffmpeg writes it: three lines, then the pixels.
fn read_ppm(reader: &mut impl BufRead) -> std::io::Result<Image> {
    let invalid = || std::io::Error::new(std::io::ErrorKind::InvalidData, "no picture where one must be");
    let mut header = String::new();
    for _ in 0..3 {
        reader.by_ref().take(32).read_line(&mut header)?;
    }
    let words: Vec<&str> = header.split_whitespace().collect();
    let &["P6", width, height, "255"] = words.as_slice() else { return Err(invalid()) };
    let (Ok(width), Ok(height)) = (width.parse::<u32>(), height.parse::<u32>()) else { return Err(invalid()) };
    if !(1..=MAX_PIXELS).contains(&(u64::from(width) * u64::from(height))) {
        return Err(invalid());
    }
    let mut pixels = vec![[0; 3]; width as usize * height as usize];
    reader.read_exact(bytemuck::cast_slice_mut(&mut pixels))?;
    Ok(Image { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_follow_each_other_and_a_cut_one_is_an_error() {
        let bytes = [b"P6\n2 1\n255\n".as_slice(), &[10, 1, 2, 3, 4, 5], b"P6\n1 1\n255\n", &[9, 9]].concat();
        let mut reader = bytes.as_slice();
        assert_eq!(read_ppm(&mut reader).unwrap().pixels, [[10, 1, 2], [3, 4, 5]]);
        assert!(read_ppm(&mut reader).is_err());
        assert!(read_ppm(&mut b"P6\n99999999 99999999\n255\n".as_slice()).is_err());
        assert!(read_ppm(&mut b"P5\n1 1\n255\n0".as_slice()).is_err());
    }

    #[test]
    fn films_without_an_index_get_a_run_up() {
        let start = Start { index: 500, time_s: 20.0, ahead: 1 };
        assert_eq!(seek_and_run_up(Path::new("a.MP4"), start), (20.0 - JUST_BEFORE_S, 0.0));
        let (seek, run_up) = seek_and_run_up(Path::new("a.ts"), start);
        assert!((seek + run_up - 20.0 + JUST_BEFORE_S).abs() < 1e-9 && run_up == RUN_UP_S);
        assert_eq!(seek_and_run_up(Path::new("a.ts"), Start { index: 0, ..start }), (0.0, 0.0));
    }
}
