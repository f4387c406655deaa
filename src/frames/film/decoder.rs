use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{ChildStdout, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::thread::{Builder, JoinHandle};

use super::log::{FrameInfo, read_log};
use super::programs::{Programs, command, input, not_started};
use crate::header::MAX_PIXELS;
use crate::{FrameError, Image};
use ostra_core::programs::ChildProcess;

/// How to decode a video.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    /// Time to seek to, in seconds from the start of the file; `None` decodes from the very beginning.
    pub seek_s: Option<f64>,
    /// How many frames to decode ahead of what is asked for; at least 1.
    pub ahead: usize,
    /// Whether frames come with a checksum of their pixels.
    pub checksums: bool,
    /// One thread only: what decoders make of damaged data depends on the timing of threads.
    pub single_thread: bool,
}

/// One decoded frame.
#[derive(Debug)]
pub(super) struct Decoded {
    pub image: Image,
    pub info: FrameInfo,
}

/// A running ffmpeg that hands out the frames of a video in order, some of them decoded ahead.
#[derive(Debug)]
pub(super) struct Decoder {
    child: ChildProcess,
    /// `None` only while dropped.
    images: Option<Receiver<Result<Image, String>>>,
    infos: Receiver<FrameInfo>,
    reader: Option<JoinHandle<()>>,
    log: Option<JoinHandle<Option<String>>>,
}

impl Decoder {
    /// Starts ffmpeg. After a seek the first frame is that of a key frame somewhere near, or any other: compare its info.
    pub fn start(programs: &Programs, path: &Path, start: Start) -> Result<Self, FrameError> {
        let mut command = decoding(programs, path, start)?;
        command.args([
            "-pix_fmt",
            "rgb24",
            "-c:v",
            "ppm",
            "-f",
            "image2pipe",
            "pipe:1",
        ]);
        let child = ChildProcess::spawn(&mut command)
            .map_err(|error| not_started(path, &programs.ffmpeg, &error))?;
        let (sender, images) = sync_channel(start.ahead.max(1));
        let (info_sender, infos) = channel();
        let (stdout, stderr) = (child.take_stdout(), child.take_stderr());
        let log = Builder::new().name("video log".into());
        let log = log.spawn(move || stderr.and_then(|stderr| read_log(stderr, &info_sender)));
        let reader = Builder::new().name("video".into()).spawn(move || {
            if let Some(stdout) = stdout {
                read_images(stdout, &sender);
            }
        });
        let mut decoder = Self {
            child,
            images: Some(images),
            infos,
            reader: None,
            log: None,
        };
        decoder.log = Some(log.map_err(|source| FrameError::io(path, source))?);
        decoder.reader = Some(reader.map_err(|source| FrameError::io(path, source))?);
        Ok(decoder)
    }

    /// The next frame; an error says why there is none.
    pub fn next(&mut self) -> Result<Decoded, String> {
        let received = self.images.as_ref().map(Receiver::recv);
        let image = received
            .and_then(Result::ok)
            .unwrap_or_else(|| Err(self.end()))?;
        // Each frame is logged before it is written.
        let info = self.infos.recv().map_err(|_| self.end())?;
        Ok(Decoded { image, info })
    }

    /// Why there are no more frames.
    fn end(&mut self) -> String {
        let error = self.log.take().and_then(|log| log.join().ok()).flatten();
        error.unwrap_or_else(|| "the video has no more frames".to_owned())
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        drop(self.images.take()); // so that the reader does not wait for someone to take an image
        let _ = self.child.kill();
        let _ = self.child.wait();
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
        if let Some(log) = self.log.take() {
            let _ = log.join();
        }
    }
}

/// The part of ffmpeg's command line that decodes: every frame once, each reported by `showinfo` with its own time.
pub(super) fn decoding(
    programs: &Programs,
    path: &Path,
    start: Start,
) -> Result<std::process::Command, FrameError> {
    let input = input(path)?;
    let mut command = command(
        &programs.ffmpeg,
        [
            "-hide_banner",
            "-nostats",
            "-nostdin",
            "-v",
            "level+repeat+info",
        ],
    );
    if start.single_thread {
        command.args(["-threads", "1"]);
    }
    command.arg("-copyts");
    if let Some(seek_s) = start.seek_s {
        // Frames before the time asked for are not dropped by ffmpeg: the first one shows where decoding began.
        command.args(["-noaccurate_seek", "-ss", &format!("{seek_s:.6}")]);
    }
    let info = if start.checksums {
        "showinfo"
    } else {
        "showinfo=checksum=0"
    };
    command
        .args(input)
        .args(["-map", "0:V:0", "-vf", info])
        .args(programs.every_picture_once());
    command.stdin(Stdio::null());
    Ok(command)
}

fn read_images(stdout: ChildStdout, sender: &SyncSender<Result<Image, String>>) {
    let mut reader = BufReader::with_capacity(1 << 16, stdout);
    loop {
        let image = match reader.fill_buf() {
            Ok([]) => return,
            _ => read_ppm(&mut reader).map_err(|error| format!("its data breaks off: {error}")),
        };
        let broken = image.is_err();
        if sender.send(image).is_err() || broken {
            return;
        }
    }
}

/// Reads one binary PPM of 8 bits, as ffmpeg writes it: three lines, then the pixels.
fn read_ppm(reader: &mut impl BufRead) -> std::io::Result<Image> {
    let invalid = || std::io::Error::new(std::io::ErrorKind::InvalidData, "not an image of ffmpeg");
    let mut header = String::new();
    for _ in 0..3 {
        reader.by_ref().take(32).read_line(&mut header)?;
    }
    let words: Vec<&str> = header.split_whitespace().collect();
    let &["P6", width, height, "255"] = words.as_slice() else {
        return Err(invalid());
    };
    let (Ok(width), Ok(height)) = (width.parse::<u32>(), height.parse::<u32>()) else {
        return Err(invalid());
    };
    if !(1..=MAX_PIXELS).contains(&(u64::from(width) * u64::from(height))) {
        return Err(invalid());
    }
    let mut pixels = vec![[0; 3]; width as usize * height as usize];
    reader.read_exact(bytemuck::cast_slice_mut(&mut pixels))?;
    Ok(Image {
        width,
        height,
        pixels,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_follow_each_other_and_a_cut_one_is_an_error() {
        let bytes = [
            b"P6\n2 1\n255\n".as_slice(),
            &[10, 1, 2, 3, 4, 5],
            b"P6\n1 1\n255\n",
            &[9, 9],
        ]
        .concat();
        let mut reader = bytes.as_slice();
        assert_eq!(
            read_ppm(&mut reader).unwrap().pixels,
            [[10, 1, 2], [3, 4, 5]]
        );
        assert!(read_ppm(&mut reader).is_err());
        assert!(read_ppm(&mut b"P6\n99999999 99999999\n255\n".as_slice()).is_err());
        assert!(read_ppm(&mut b"P5\n1 1\n255\n0".as_slice()).is_err());
    }
}
