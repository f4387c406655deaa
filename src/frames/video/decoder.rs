//! A running ffmpeg that decodes a video: its images and the reports in its log.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{ChildStdout, Stdio};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::{Builder, JoinHandle};

use super::programs::{Programs, command, input, not_started};
use crate::header::MAX_PIXELS;
use crate::{FrameError, Image};
use ostra_core::programs::ChildProcess;

/// How to decode a video.
#[derive(Debug, Clone, Copy)]
pub(super) struct DecoderOptions {
    /// Time to seek to, in seconds from the start of the file; `None` decodes from the beginning.
    pub seek_s: Option<f64>,
    /// Number of frames to decode ahead of requests; at least 1.
    pub ahead: usize,
    /// Whether frames have a checksum of their pixels.
    pub checksums: bool,
    /// Whether to use one thread only.
    ///
    /// The result of decoding damaged data depends on the timing of threads.
    pub single_thread: bool,
}

/// One decoded frame.
#[derive(Debug)]
pub(super) struct Decoded {
    pub image: Image,
    pub info: FrameInfo,
}

/// A running ffmpeg that returns the frames of a video in order and decodes some ahead.
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
    /// Starts ffmpeg.
    ///
    /// After a seek, the first frame may be any frame near the time, usually a key frame: compare
    /// its info.
    pub fn start(
        programs: &Programs,
        path: &Path,
        options: DecoderOptions,
    ) -> Result<Self, FrameError> {
        let mut command = decoding(programs, path, options)?;
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
        let (sender, images) = sync_channel(options.ahead.max(1));
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

    /// Returns the next frame, or an error that says why there is none.
    pub fn next(&mut self) -> Result<Decoded, String> {
        let received = self.images.as_ref().map(Receiver::recv);
        let image = received
            .and_then(Result::ok)
            .unwrap_or_else(|| Err(self.end()))?;
        // Each frame is logged before it is written.
        let info = self.infos.recv().map_err(|_| self.end())?;
        Ok(Decoded { image, info })
    }

    /// Returns why there are no more frames.
    fn end(&mut self) -> String {
        let error = self.log.take().and_then(|log| log.join().ok()).flatten();
        error.unwrap_or_else(|| "the video has no more frames".to_owned())
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        drop(self.images.take()); // so that the reader does not wait for its image to be taken
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

/// Returns ffmpeg's decoding command.
///
/// It outputs every frame once, and `showinfo` reports each with its own time.
pub(super) fn decoding(
    programs: &Programs,
    path: &Path,
    options: DecoderOptions,
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
    if options.single_thread {
        command.args(["-threads", "1"]);
    }
    command.arg("-copyts");
    if let Some(seek_s) = options.seek_s {
        // ffmpeg does not drop frames before the requested time: the first one shows where decoding
        // began.
        command.args(["-noaccurate_seek", "-ss", &format!("{seek_s:.6}")]);
    }
    let info = if options.checksums {
        "showinfo"
    } else {
        "showinfo=checksum=0"
    };
    command
        .args(input)
        .args(["-map", "0:V:0", "-vf", info])
        .args(programs.every_image_once());
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

/// Reads one 8-bit binary PPM as ffmpeg writes it: three lines, then the pixels.
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

/// Report of ffmpeg's filter `showinfo` about one decoded frame, in the order of output.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FrameInfo {
    /// Presentation time in seconds on the clock of the file; `None` if the frame has none.
    pub pts_s: Option<f64>,
    /// Whether decoding may begin at this frame: a key frame that is completely intra coded.
    ///
    /// The decoder also calls frames key frames where an intra refresh begins, but these are
    /// incomplete.
    pub is_intra_key: bool,
    /// Checksum of the decoded pixels, if requested.
    pub checksum: Option<u32>,
    /// Error that ffmpeg reported since the previous frame, if any.
    pub error: Option<String>,
}

/// Parses ffmpeg's log (`-v level+repeat+info`, with `showinfo` in the filter graph) line by line.
#[derive(Debug, Default)]
pub(super) struct LogParser {
    time_base_s: f64,
    /// First error since the latest frame.
    error: Option<String>,
}

impl LogParser {
    /// Returns the frame that a line reports, if any.
    pub fn parse(&mut self, line: &str) -> Option<FrameInfo> {
        let (source, level, info) = parts(line)?;
        if matches!(level, "error" | "fatal" | "panic") {
            self.take_error(source, info);
            return None;
        }
        if level != "info" || !source.starts_with("[Parsed_showinfo_") {
            return None;
        }
        if let Some((_, base)) = info.split_once("config in time_base: ") {
            let fraction = base
                .split(',')
                .next()
                .and_then(|base| base.trim().split_once('/'));
            let parts =
                fraction.and_then(|(n, d)| Some((n.parse::<f64>().ok()?, d.parse::<f64>().ok()?)));
            self.time_base_s = parts.filter(|(_, d)| *d > 0.0).map_or(0.0, |(n, d)| n / d);
            return None;
        }
        if !info.starts_with("n:") {
            return None;
        }
        let pts = value(info, "pts:").and_then(|pts| pts.parse::<i64>().ok());
        Some(FrameInfo {
            pts_s: pts
                .filter(|_| self.time_base_s > 0.0)
                .map(|pts| pts as f64 * self.time_base_s),
            is_intra_key: value(info, "iskey:") == Some("1") && value(info, "type:") == Some("I"),
            checksum: value(info, "checksum:").and_then(|sum| u32::from_str_radix(sum, 16).ok()),
            error: self.error.take(),
        })
    }

    fn take_error(&mut self, source: &str, message: &str) {
        // Reports of ffmpeg about its own output do not concern the video.
        if !source.contains("[image2pipe") && !source.contains("[null @") {
            self.error.get_or_insert_with(|| message.trim().to_owned());
        }
    }

    /// Returns the error that was reported after the last frame.
    pub fn last_error(self) -> Option<String> {
        self.error
    }
}

/// Splits a line `[source @ 0x5] [level] message`, with any number of sources.
///
/// The message may contain text of the video itself, such as its title. A level therefore counts
/// only where there are only sources before it.
fn parts(line: &str) -> Option<(&str, &str, &str)> {
    let mut at = 0;
    while line[at..].starts_with('[') {
        let end = at + line[at..].find("] ")?;
        let (word, after) = (&line[at + 1..end], end + 2);
        if matches!(
            word,
            "panic" | "fatal" | "error" | "warning" | "info" | "verbose" | "debug" | "trace"
        ) {
            return Some((&line[..at], word, &line[after..]));
        }
        at = after;
    }
    None
}

/// Returns the word after `key`, which must begin a word itself.
fn value<'a>(line: &'a str, key: &str) -> Option<&'a str> {
    let at = line
        .match_indices(key)
        .map(|(at, _)| at)
        .find(|&at| at == 0 || line.as_bytes()[at - 1] == b' ')?;
    line[at + key.len()..].split_whitespace().next()
}

/// Sends the frames in the log to `sender`; returns the error after the last frame.
///
/// It always reads to the end, so that ffmpeg does not block.
pub(super) fn read_log(stderr: impl Read, sender: &Sender<FrameInfo>) -> Option<String> {
    let mut parser = LogParser::default();
    let mut reader = BufReader::new(stderr);
    let (mut line, mut is_start) = (Vec::new(), true);
    while reader
        .by_ref()
        .take(1 << 16)
        .read_until(b'\n', &mut line)
        .is_ok_and(|read| read > 0)
    {
        // The rest of an overlong line may look like a separate line.
        if is_start && let Some(info) = parser.parse(&String::from_utf8_lossy(&line)) {
            let _ = sender.send(info); // fails once the decoder is dropped
        }
        is_start = line.ends_with(b"\n");
        line.clear();
    }
    parser.last_error()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_follow_each_other_and_a_truncated_one_is_an_error() {
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

    const FRAME: &str = "[Parsed_showinfo_0 @ 0x5] [info] n:   3 pts:   1024 pts_time:0.08    pos:       44 fmt:gbrp sar:0/1 \
                         s:160x120 i:P iskey:1 type:I checksum:18809BF5 plane_checksum:[A7DA239A]";

    #[test]
    fn frames_are_reported_with_exact_times_and_the_error_before_them() {
        let mut parser = LogParser::default();
        assert_eq!(
            parser.parse(
                "[Parsed_showinfo_0 @ 0x5] [info] config in time_base: 1/12800, frame_rate: 25/1"
            ),
            None
        );
        assert_eq!(
            parser.parse("[h264 @ 0x6] [error] concealing 12 DC errors"),
            None
        );
        assert_eq!(
            parser.parse("[error] Error while decoding stream #0:0"),
            None
        );
        let frame = parser.parse(FRAME).unwrap();
        assert_eq!(frame.pts_s, Some(1024.0 / 12800.0));
        assert!(frame.is_intra_key && frame.checksum == Some(0x1880_9BF5));
        assert_eq!(frame.error.as_deref(), Some("concealing 12 DC errors"));
        let next = parser
            .parse(&FRAME.replace("1024", "NOPTS").replace("type:I", "type:P"))
            .unwrap();
        assert!(next.pts_s.is_none() && !next.is_intra_key && next.error.is_none());
        assert_eq!(
            parser.parse("[Parsed_showinfo_0 @ 0x5] [info]   side data - User Data"),
            None
        );
    }

    #[test]
    fn text_in_the_video_is_neither_a_frame_nor_an_error() {
        let mut parser = LogParser::default();
        for title in [FRAME, "a [error] b", "x] [error] b", "[error] b"] {
            assert_eq!(
                parser.parse(&format!("[info]     title           : {title}")),
                None,
                "{title}"
            );
            assert_eq!(
                parser.parse(&format!("    title           : {title}")),
                None,
                "{title}"
            );
        }
        assert_eq!(
            parser.parse(&FRAME.replacen("[Parsed_showinfo_0", "[a_showinfo_0", 1)),
            None
        );
        assert!(parser.parse(FRAME).unwrap().error.is_none());
        assert_eq!(
            parser.parse("[vist#0:0/h264 @ 0x5] [dec:h264 @ 0x6] [error] no frame"),
            None
        );
        assert_eq!(parser.last_error().as_deref(), Some("no frame"));
        let (sender, frames) = std::sync::mpsc::channel();
        let overlong = format!(
            "[info] {}{FRAME}\n",
            " ".repeat((1 << 16) - "[info] ".len())
        );
        assert!(read_log(overlong.as_bytes(), &sender).is_none() && frames.try_recv().is_err());
    }
}
