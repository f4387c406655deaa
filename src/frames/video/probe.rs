use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{ChildStderr, Stdio};
use std::sync::mpsc::channel;

use super::decoder::{Decoder, DecoderOptions, decoding, read_log};
use super::programs::{Programs, command, explained, input, not_started};
use crate::FrameError;
use ostra_core::job::Progress;
use ostra_core::programs::ChildProcess;

/// Properties of a video found on opening.
#[derive(Debug)]
pub(crate) struct Probed {
    /// Width in pixels as shown (ffmpeg rotates images upright).
    pub width: u32,
    /// Height in pixels as shown.
    pub height: u32,
    /// Time of each image in seconds from the start, increasing; at least one.
    pub times_s: Vec<f64>,
    /// Damage found by ffmpeg in a video that is still readable.
    pub damage: Option<String>,
}

/// Assumed seconds between two frames if the video does not say.
const USUAL_STEP_S: f64 = 0.04;

/// Clock step in seconds from which frames of a fast camera may share a time.
const COARSE_CLOCK_S: f64 = 1e-4;

/// Containers in which every frame has a time and seeking lands on a flagged key frame.
const TIMED_CONTAINERS: [&str; 4] = ["mov", "mp4", "matroska", "webm"];

/// Codecs with one shown frame per packet, whose decoder shows where decoding may begin.
const SEEKABLE_CODECS: [&str; 9] = [
    "h264", "hevc", "vp8", "vp9", "av1", "mjpeg", "prores", "dnxhd", "ffv1",
];

/// Maximum number of pixels in all frames of a video that is decoded on opening.
///
/// This takes a few seconds and finds every damage. The frames of longer videos are taken from the
/// container if it lists them.
const MAX_SCAN_PIXELS: u64 = 1_000_000_000;

/// Reads the frame times and the shown size of a video.
///
/// # Errors
///
/// [`FrameError`] if ffmpeg is not installed, the file is not a video or is damaged, or the user
/// stopped it.
pub(crate) fn probe(path: &Path, progress: &Progress) -> Result<Probed, FrameError> {
    probe_with(&Programs::default(), path, progress)
}

fn probe_with(programs: &Programs, path: &Path, progress: &Progress) -> Result<Probed, FrameError> {
    let stream = Stream::read(programs, path, progress)?;
    let (times_s, damage) = times(programs, path, &stream, progress)?;
    if times_s.is_empty() {
        return Err(no_video(
            path,
            damage.as_deref().unwrap_or("it has no frames"),
        ));
    }
    let options = DecoderOptions {
        seek_s: None,
        ahead: 1,
        checksums: false,
        single_thread: false,
    };
    let first = Decoder::start(programs, path, options)?
        .next()
        .map_err(|why| no_video(path, &why))?
        .image;
    Ok(Probed {
        width: first.width,
        height: first.height,
        times_s,
        damage,
    })
}

/// Properties of the first video stream from the header.
#[derive(Debug)]
pub(super) struct Stream {
    /// Whether frames are found by their times after a seek.
    ///
    /// Otherwise frame k is the k-th of decoding from the beginning. Containers such as AVI,
    /// MPEG-TS and raw streams have no reliable times, and decoders such as that of MPEG-4 Part 2
    /// do not show whether frames after a seek are complete.
    pub is_seekable: bool,
    /// Start of the file's clock in seconds.
    pub start_s: f64,
    pixels: u64,
    /// Seconds per step of the clock that times are counted in.
    clock_step_s: f64,
}

impl Stream {
    /// Returns a stream with only this property set.
    #[cfg(test)]
    pub fn for_tests(is_seekable: bool) -> Self {
        Self {
            is_seekable,
            start_s: 0.0,
            pixels: 1,
            clock_step_s: 1e-5,
        }
    }

    /// Reads the header.
    pub fn read(programs: &Programs, path: &Path, progress: &Progress) -> Result<Self, FrameError> {
        let mut stream = None;
        let (mut start_s, mut is_timed) = (0.0, false);
        let entries =
            "stream=codec_name,field_order,width,height,time_base:format=format_name,start_time";
        let errors = ffprobe(programs, path, entries, progress, |line| {
            if let Some(codec) = field(line, "stream|", "codec_name") {
                let progressive = matches!(
                    field(line, "stream|", "field_order"),
                    None | Some("progressive" | "unknown")
                );
                let side = |name| {
                    field(line, "stream|", name)
                        .and_then(|side| side.parse::<u32>().ok())
                        .unwrap_or(0)
                };
                let pixels = u64::from(side("width")) * u64::from(side("height"));
                let base =
                    field(line, "stream|", "time_base").and_then(|base| base.split_once('/'));
                let step =
                    base.and_then(|(n, d)| Some(n.parse::<f64>().ok()? / d.parse::<f64>().ok()?));
                let step_s = step.filter(|step| step.is_finite()).unwrap_or(1.0);
                stream = Some((
                    progressive && SEEKABLE_CODECS.contains(&codec),
                    pixels,
                    step_s,
                ));
            }
            if let Some(names) = field(line, "format|", "format_name") {
                is_timed = names
                    .split(',')
                    .any(|name| TIMED_CONTAINERS.contains(&name));
            }
            if let Some(start) =
                field(line, "format|", "start_time").and_then(|start| start.parse().ok())
            {
                start_s = start;
            }
        })?;
        let Some((is_seekable, pixels, clock_step_s)) = stream else {
            return Err(no_video(
                path,
                errors.as_deref().unwrap_or("it has no video stream"),
            ));
        };
        Ok(Self {
            is_seekable: is_seekable && is_timed,
            start_s,
            pixels,
            clock_step_s,
        })
    }

    /// Marks the stream as not seekable if two frames have the same time.
    ///
    /// All packets are read if the clock is coarse, as in Matroska, whose usual steps are
    /// milliseconds.
    pub fn check_times(
        &mut self,
        programs: &Programs,
        path: &Path,
        progress: &Progress,
    ) -> Result<(), FrameError> {
        if self.is_seekable && self.clock_step_s >= COARSE_CLOCK_S {
            let (packets, _) = Packets::read(programs, path, progress)?;
            self.is_seekable = !packets.has_equal_times();
        }
        Ok(())
    }
}

/// Returns the times of the frames, and the damage found.
fn times(
    programs: &Programs,
    path: &Path,
    stream: &Stream,
    progress: &Progress,
) -> Result<(Vec<f64>, Option<String>), FrameError> {
    let mut listed = None;
    if stream.is_seekable {
        let (packets, errors) = Packets::read(programs, path, progress)?;
        listed = packets.whole().filter(|_| errors.is_none());
        if let Some(times_s) =
            listed.take_if(|times_s| times_s.len() as u64 * stream.pixels > MAX_SCAN_PIXELS)
        {
            return Ok((from_start(times_s, stream.start_s), None));
        }
    }
    let (mut times_s, mut damage) = scan(programs, path, false, progress)?;
    if damage.is_some() {
        // Frames of damaged videos are read with one thread, because the result depends on the
        // threads.
        (times_s, damage) = scan(programs, path, true, progress)?;
    }
    let missing = listed.map_or(0, |listed| listed.len().saturating_sub(times_s.len()));
    if missing > 0 && damage.is_none() {
        damage = Some(format!("{missing} frames cannot be decoded"));
    }
    Ok((from_start(times_s, stream.start_s), damage))
}

/// Returns the times of all frames by decoding the video, and the first error with its frame.
fn scan(
    programs: &Programs,
    path: &Path,
    single_thread: bool,
    progress: &Progress,
) -> Result<(Vec<f64>, Option<String>), FrameError> {
    let options = DecoderOptions {
        seek_s: None,
        ahead: 1,
        checksums: false,
        single_thread,
    };
    let mut command = decoding(programs, path, options)?;
    command.args(["-f", "null", "-"]).stdout(Stdio::null());
    let child = ChildProcess::spawn(&mut command)
        .map_err(|error| not_started(path, &programs.ffmpeg, &error))?;
    let (sender, infos) = channel();
    let stderr = child.take_stderr();
    let log = std::thread::spawn(move || stderr.and_then(|stderr| read_log(stderr, &sender)));
    let (mut times_s, mut damage) = (Vec::new(), None);
    for info in infos {
        if let Err(stopped) = progress.check() {
            let _ = child.kill();
            let _ = child.wait();
            return Err(stopped.into());
        }
        if let Some(error) = info.error {
            damage.get_or_insert_with(|| format!("at frame {}: {error}", times_s.len()));
        }
        times_s.push(info.pts_s.unwrap_or_else(|| after(&times_s)));
    }
    let _ = child.wait();
    let last = log
        .join()
        .ok()
        .flatten()
        .map(|error| format!("after frame {}: {error}", times_s.len().max(1) - 1));
    Ok((
        times_s,
        damage.or(last).map(|complaint| explained(&complaint)),
    ))
}

/// Times of packets; `None` once one has no time.
struct Packets {
    times_s: Option<Vec<f64>>,
    starts_with_key: Option<bool>,
}

impl Packets {
    /// Reads all packets of the video; also returns ffprobe's first error.
    fn read(
        programs: &Programs,
        path: &Path,
        progress: &Progress,
    ) -> Result<(Self, Option<String>), FrameError> {
        let mut packets = Self {
            times_s: Some(Vec::new()),
            starts_with_key: None,
        };
        let errors = ffprobe(programs, path, "packet=pts_time,flags", progress, |line| {
            packets.take(line);
        })?;
        Ok((packets, errors))
    }

    /// Returns whether two frames cannot be distinguished by their times.
    fn has_equal_times(&self) -> bool {
        let mut times_s = self.times_s.clone().unwrap_or_default();
        times_s.sort_by(f64::total_cmp);
        times_s
            .windows(2)
            .any(|pair| pair[1] - pair[0] <= SAME_TIME_S)
    }

    /// Returns the times in order of presentation if they are certain.
    ///
    /// Each must be different, and none before that of the first key frame, which could not be
    /// decoded.
    fn whole(self) -> Option<Vec<f64>> {
        let mut times_s = self
            .times_s
            .filter(|_| self.starts_with_key == Some(true))?;
        let first = *times_s.first()?;
        times_s.sort_by(f64::total_cmp);
        let is_certain = times_s[0] == first
            && times_s
                .windows(2)
                .all(|pair| pair[1] - pair[0] > SAME_TIME_S);
        is_certain.then_some(times_s)
    }

    fn take(&mut self, line: &str) {
        if !line.starts_with("packet|") {
            return;
        }
        let flags = field(line, "packet|", "flags").unwrap_or_default();
        self.starts_with_key.get_or_insert(flags.contains('K'));
        if flags.contains('D') {
            return; // decoded but not shown
        }
        let time = field(line, "packet|", "pts_time").and_then(|time| time.parse::<f64>().ok());
        let time = time.filter(|time| time.is_finite());
        self.times_s = self.times_s.take().zip(time).map(|(mut times_s, time)| {
            times_s.push(time);
            times_s
        });
    }
}

/// Returns the time of an image without one: the previous step is repeated.
fn after(times_s: &[f64]) -> f64 {
    match times_s {
        [.., before, last] => 2.0 * last - before,
        [last] => last + USUAL_STEP_S,
        [] => 0.0,
    }
}

fn from_start(mut times_s: Vec<f64>, start_s: f64) -> Vec<f64> {
    times_s.iter_mut().for_each(|time| *time -= start_s);
    times_s.sort_by(f64::total_cmp);
    times_s
}

/// Runs ffprobe on the video's images and passes on its lines; returns its first error message.
fn ffprobe(
    programs: &Programs,
    path: &Path,
    entries: &str,
    progress: &Progress,
    mut take: impl FnMut(&str),
) -> Result<Option<String>, FrameError> {
    let arguments = [
        "-hide_banner",
        "-v",
        "error",
        "-select_streams",
        "V:0",
        "-show_entries",
        entries,
        "-of",
        "compact",
    ];
    let mut command = command(&programs.ffprobe, arguments);
    command.args(input(path)?);
    let child = ChildProcess::spawn(&mut command)
        .map_err(|error| not_started(path, &programs.ffprobe, &error))?;
    let complaint = child
        .take_stderr()
        .map(|stderr| std::thread::spawn(move || first_line(stderr)));
    let stdout = child.take_stdout();
    let read = stdout.map_or(Ok(()), |stdout| {
        for line in BufReader::new(stdout).lines() {
            progress.check()?;
            take(&line.map_err(|source| FrameError::io(path, source))?);
        }
        Ok(())
    });
    if read.is_err() {
        let _ = child.kill();
    }
    let _ = child.wait();
    let complaint = complaint.and_then(|thread| thread.join().ok()).flatten();
    read.map(|()| complaint)
}

/// Returns the first line of a program's error output.
///
/// It reads on to the end, so that the program does not block.
fn first_line(stderr: ChildStderr) -> Option<String> {
    let mut reader = BufReader::new(stderr);
    let mut line = Vec::new();
    let _ = reader.read_until(b'\n', &mut line);
    let _ = std::io::copy(&mut reader.by_ref(), &mut std::io::sink());
    let line = String::from_utf8_lossy(&line).trim().to_owned();
    let message = line
        .rsplit_once("] ")
        .map_or(line.as_str(), |(_, message)| message);
    (!message.is_empty()).then(|| message.to_owned())
}

/// Returns the value of `key` in a line of ffprobe's compact form, if it belongs to `section`.
fn field<'a>(line: &'a str, section: &str, key: &str) -> Option<&'a str> {
    let fields = line.strip_prefix(section)?.split('|');
    fields
        .filter_map(|field| field.split_once('='))
        .find(|(name, _)| *name == key)
        .map(|(_, value)| value)
}

fn no_video(path: &Path, why: &str) -> FrameError {
    let why = explained(why);
    let what = format!(
        "ffmpeg cannot read this as a video ({why}); give a video, an image or a folder of images"
    );
    FrameError::Invalid {
        path: path.into(),
        what,
    }
}

/// Maximum difference in seconds of equal times.
///
/// Times are whole steps of the same clock, rounded to microseconds.
pub(super) const SAME_TIME_S: f64 = 5e-6;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_programs_are_named_with_what_to_install() {
        let nowhere = Programs::new("/nowhere/ffmpeg".into(), "/nowhere/ffprobe".into());
        let file = tempfile::NamedTempFile::with_suffix("video.mp4").unwrap();
        let error = probe_with(&nowhere, file.path(), &Progress::default())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("video.mp4")
                && error.contains("/nowhere/ffprobe")
                && error.contains("install ffmpeg")
        );
    }

    #[test]
    fn packets_in_decoding_order_give_increasing_times() {
        let mut packets = Packets {
            times_s: Some(Vec::new()),
            starts_with_key: None,
        };
        for line in [
            "packet|pts_time=1.0|flags=K_",
            "packet|pts_time=1.16|flags=__",
            "packet|pts_time=1.08|flags=__",
            "",
        ] {
            packets.take(line);
        }
        packets.take("packet|pts_time=0.9|flags=_D");
        assert_eq!(packets.starts_with_key, Some(true));
        let times_s = from_start(packets.times_s.clone().unwrap(), 1.0);
        assert_eq!(times_s.len(), 3);
        assert!(times_s.is_sorted() && times_s[0] == 0.0 && (times_s[1] - 0.08).abs() < 1e-9);
        assert!(!packets.has_equal_times());
        packets.take("packet|pts_time=1.16|flags=__");
        assert!(packets.has_equal_times());
        packets.take("packet|pts_time=N/A|flags=__");
        assert!(packets.times_s.is_none());
    }
}
