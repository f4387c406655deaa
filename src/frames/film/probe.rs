use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::ChildStderr;

use super::decoder::{Decoder, Start};
use super::programs::{Programs, command, not_started};
use crate::engine::job::Progress;
use crate::frames::FrameError;

/// What opening a film finds out.
#[derive(Debug)]
pub(in crate::frames) struct Probed {
    /// Columns as shown (ffmpeg turns pictures upright).
    pub width: u32,
    /// Rows as shown.
    pub height: u32,
    /// Time of each picture in seconds from the start, rising. At least one.
    pub times_s: Vec<f64>,
    /// What ffmpeg found wrong with the film, where it can be read all the same.
    pub damage: Option<String>,
}

/// Seconds between two pictures where nothing says so.
const USUAL_STEP_S: f64 = 0.04;

/// Codecs whose packets are one shown picture each, so that the times need no decoding.
const ONE_PACKET_A_PICTURE: [&str; 9] = ["h264", "hevc", "vp9", "av1", "mjpeg", "prores", "dnxhd", "ffv1", "mpeg4"];

/// Finds out when the pictures of a film are and how large they are shown.
///
/// # Errors
/// [`FrameError`] when ffmpeg is not installed, the file is no film or a damaged one, or the user stopped it.
pub(in crate::frames) fn probe(path: &Path, progress: &Progress) -> Result<Probed, FrameError> {
    probe_with(&Programs::default(), path, progress)
}

fn probe_with(programs: &Programs, path: &Path, progress: &Progress) -> Result<Probed, FrameError> {
    let stream = Stream::read(programs, path, progress)?;
    let (times_s, damage) = times(programs, path, &stream, progress)?;
    if times_s.is_empty() {
        return Err(no_film(path, damage.as_deref().unwrap_or("it has no pictures")));
    }
    let start = Start { index: 0, time_s: times_s[0], ahead: 1 };
    let first = Decoder::start(programs, path, start)?.next().map_err(|why| no_film(path, &why))?;
    Ok(Probed { width: first.width, height: first.height, times_s, damage })
}

/// What the header says of the film's first stream of pictures.
struct Stream {
    has_plain_packets: bool,
    start_s: f64,
}

impl Stream {
    fn read(programs: &Programs, path: &Path, progress: &Progress) -> Result<Self, FrameError> {
        let mut stream = None;
        let mut start_s = 0.0;
        let entries = "stream=codec_name,field_order:format=start_time";
        let errors = ffprobe(programs, path, entries, progress, |line| {
            if let Some(codec) = field(line, "stream|", "codec_name") {
                let progressive =
                    matches!(field(line, "stream|", "field_order"), None | Some("progressive" | "unknown"));
                stream = Some(progressive && ONE_PACKET_A_PICTURE.contains(&codec));
            }
            if let Some(start) = field(line, "format|", "start_time").and_then(|start| start.parse().ok()) {
                start_s = start;
            }
        })?;
        let Some(has_plain_packets) = stream else {
            return Err(no_film(path, errors.as_deref().unwrap_or("it has no pictures")));
        };
        Ok(Self { has_plain_packets, start_s })
    }
}

/// The times of the pictures, from packets where that is exact, else by decoding; and what ffprobe complained about.
fn times(
    programs: &Programs,
    path: &Path,
    stream: &Stream,
    progress: &Progress,
) -> Result<(Vec<f64>, Option<String>), FrameError> {
    if stream.has_plain_packets {
        let mut packets = Packets { times_s: Some(Vec::new()), starts_with_key: None };
        let errors = ffprobe(programs, path, "packet=pts_time,flags", progress, |line| packets.take(line))?;
        if let (None, Some(times_s), Some(true)) = (errors, packets.times_s, packets.starts_with_key) {
            return Ok((from_start(times_s, stream.start_s), None));
        }
    }
    let mut times_s = Vec::new();
    let errors = ffprobe(programs, path, "frame=best_effort_timestamp_time", progress, |line| {
        if let Some(time) = field(line, "frame|", "best_effort_timestamp_time") {
            let time = time.parse().ok().filter(|time: &f64| time.is_finite());
            times_s.push(time.unwrap_or_else(|| after(&times_s)));
        }
    })?;
    Ok((from_start(times_s, stream.start_s), errors))
}

/// Times that packets give; `None` once one has no time.
struct Packets {
    times_s: Option<Vec<f64>>,
    starts_with_key: Option<bool>,
}

impl Packets {
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

/// The time of a picture that has none: as long after the one before as that is after its own.
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

/// Runs ffprobe on the film's pictures and hands over its lines; returns its first complaint.
fn ffprobe(
    programs: &Programs,
    path: &Path,
    entries: &str,
    progress: &Progress,
    mut take: impl FnMut(&str),
) -> Result<Option<String>, FrameError> {
    let arguments =
        ["-hide_banner", "-v", "error", "-select_streams", "V:0", "-show_entries", entries, "-of", "compact"];
    let mut command = command(&programs.ffprobe, arguments);
    let mut child = command.arg(path).spawn().map_err(|error| not_started(path, &programs.ffprobe, &error))?;
    let complaint = child.stderr.take().map(|stderr| std::thread::spawn(move || first_line(stderr)));
    let stdout = child.stdout.take();
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

/// The first line of what a program complained about; reads on to the end so that the program is not held up.
fn first_line(stderr: ChildStderr) -> Option<String> {
    let mut reader = BufReader::new(stderr);
    let mut line = Vec::new();
    let _ = reader.read_until(b'\n', &mut line);
    let _ = std::io::copy(&mut reader.by_ref(), &mut std::io::sink());
    let line = String::from_utf8_lossy(&line).trim().to_owned();
    let message = line.rsplit_once("] ").map_or(line.as_str(), |(_, message)| message);
    (!message.is_empty()).then(|| message.to_owned())
}

/// The value of `key` in a line of ffprobe's compact form, when the line belongs to `section`.
fn field<'a>(line: &'a str, section: &str, key: &str) -> Option<&'a str> {
    let fields = line.strip_prefix(section)?.split('|');
    fields.filter_map(|field| field.split_once('=')).find(|(name, _)| *name == key).map(|(_, value)| value)
}

fn no_film(path: &Path, why: &str) -> FrameError {
    let what = format!("ffmpeg cannot read this as a film ({why}); give a film, a picture or a folder of pictures");
    FrameError::Invalid { path: path.into(), what }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_programs_are_named_with_what_to_install() {
        let nowhere = Programs::new("/nowhere/ffmpeg".into(), "/nowhere/ffprobe".into());
        let error = probe_with(&nowhere, Path::new("/film.mp4"), &Progress::default()).unwrap_err().to_string();
        assert!(error.contains("/film.mp4") && error.contains("/nowhere/ffprobe") && error.contains("install ffmpeg"));
    }

    #[test]
    fn packets_in_decoding_order_give_rising_times() {
        let mut packets = Packets { times_s: Some(Vec::new()), starts_with_key: None };
        for line in
            ["packet|pts_time=1.0|flags=K_", "packet|pts_time=1.16|flags=__", "packet|pts_time=1.08|flags=__", ""]
        {
            packets.take(line);
        }
        packets.take("packet|pts_time=0.9|flags=_D");
        assert_eq!(packets.starts_with_key, Some(true));
        let times_s = from_start(packets.times_s.clone().unwrap(), 1.0);
        assert_eq!(times_s.len(), 3);
        assert!(times_s.is_sorted() && times_s[0] == 0.0 && (times_s[1] - 0.08).abs() < 1e-9);
        packets.take("packet|pts_time=N/A|flags=__");
        assert!(packets.times_s.is_none());
    }
}
