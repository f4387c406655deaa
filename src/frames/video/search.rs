use std::path::Path;
use std::sync::Arc;

use super::decoder::{Decoded, Decoder, DecoderOptions};
use super::probe::{SAME_TIME_S, Stream};
use super::programs::Programs;
use crate::{FrameError, Image};

/// The requested frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    /// Number from 0, in the order of decoding from the beginning.
    pub index: u64,
    /// Time in seconds from the start of the file.
    pub time_s: f64,
}

/// A request to read a frame, and how far to decode beyond it.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameRequest {
    pub target: Target,
    /// Number of frames to decode ahead of requests; at least 1.
    pub ahead: usize,
}

/// Seconds before the requested frame to seek to, tried in turn while a seek lands too late.
///
/// A seek lands behind leading frames that cannot be decoded without the frames before the key
/// frame.
const RUN_UPS_S: [f64; 4] = [0.0, 2.0, 10.0, 60.0];

/// Frame number below which decoding from the beginning is as fast as seeking.
const NEAR_START: u64 = 60;

/// Knowledge about a video after reading some of it.
#[derive(Debug, Clone)]
pub(super) struct Knowledge {
    pub stream: Arc<Stream>,
    /// Whether no seek found the requested frame, or ffmpeg reported errors after one.
    ///
    /// Seeks are then not reliable.
    pub is_unseekable: bool,
    /// First error of decoding from the beginning.
    pub damage: Option<Damage>,
    /// Checksum and time of each frame decoded from the beginning so far.
    ///
    /// Equal frames confirm a seek.
    pub seen: Vec<FrameIdentity>,
}

/// The first error in a video.
#[derive(Debug, Clone)]
pub(super) struct Damage {
    pub index: u64,
    pub error: String,
}

/// Properties by which a frame is recognised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameIdentity {
    pts_s: Option<f64>,
    checksum: Option<u32>,
}

impl Knowledge {
    pub fn new(stream: Stream) -> Self {
        Self {
            stream: Arc::new(stream),
            is_unseekable: false,
            damage: None,
            seen: Vec::new(),
        }
    }

    /// Returns whether the time of a frame after a seek is reliable.
    pub fn has_reliable_seeks(&self) -> bool {
        self.stream.is_seekable && !self.is_unseekable && self.damage.is_none()
    }

    fn note(&mut self, index: u64, seen: FrameIdentity) {
        if seen.checksum.is_some() && self.seen.len() as u64 == index {
            self.seen.push(seen);
        }
    }

    /// Returns how to start decoding to reach `target`, best first.
    fn starts(&self, target: Target, ahead: usize) -> Vec<DecoderOptions> {
        let (checksums, single_thread) = (!self.has_reliable_seeks(), self.damage.is_some());
        let start = |seek_s| DecoderOptions {
            seek_s,
            ahead,
            checksums,
            single_thread,
        };
        let is_seen = (target.index as usize) < self.seen.len();
        let may_seek = self.has_reliable_seeks() || self.damage.is_none() && is_seen;
        let seeks = RUN_UPS_S
            .map(|run_up_s| target.time_s - run_up_s)
            .into_iter()
            .filter(|time_s| *time_s > 0.0);
        let seeks = seeks
            .filter(|_| may_seek && target.index > NEAR_START)
            .map(|time_s| start(Some(time_s)));
        seeks.chain([start(None)]).collect()
    }
}

/// A decoder and its position.
#[derive(Debug)]
pub(super) struct Running {
    decoder: Decoder,
    /// Number of the next frame; after a seek known only once a frame has been recognised.
    pub next: Option<u64>,
    is_from_start: bool,
    is_single_thread: bool,
}

/// Why a decoder did not find the requested frame.
#[derive(Debug)]
enum Missed {
    /// The decoder is past the frame, or its frames are not the expected ones.
    Passed,
    /// There are no more frames, with the reason.
    Ended(String),
    /// ffmpeg reported an error at a frame.
    Error(Damage),
}

impl Running {
    /// Decodes up to the requested frame.
    fn advance(&mut self, target: Target, known: &mut Knowledge) -> Result<Image, Missed> {
        loop {
            let frame = self.decoder.next().map_err(Missed::Ended)?;
            // Frames that are recognised by their content need no other check.
            let counts =
                known.damage.is_none() && (self.is_from_start || known.has_reliable_seeks());
            if let Some(error) = frame.info.error.clone().filter(|_| counts) {
                return Err(Missed::Error(Damage {
                    index: self.next.unwrap_or(target.index),
                    error,
                }));
            }
            let is_target = self.is_target(&frame, target, known)?;
            self.next = if is_target {
                Some(target.index + 1)
            } else {
                self.next.map(|next| next + 1)
            };
            if is_target {
                return Ok(frame.image);
            }
        }
    }

    fn is_target(
        &mut self,
        frame: &Decoded,
        target: Target,
        known: &mut Knowledge,
    ) -> Result<bool, Missed> {
        let pts_s = frame.info.pts_s;
        let seen = FrameIdentity {
            pts_s,
            checksum: frame.info.checksum,
        };
        if self.is_from_start {
            let number = self.next.unwrap_or(0);
            known.note(number, seen);
            return match pts_s.filter(|_| known.stream.is_seekable) {
                Some(pts_s) => compare_time(pts_s - known.stream.start_s, target),
                None => compare_number(number, target),
            };
        }
        if !known.has_reliable_seeks() {
            return self.is_seen_target(seen, target, known);
        }
        let Some(pts_s) = pts_s else {
            return Err(Missed::Passed);
        };
        if self.next.is_none() && !frame.info.is_intra_key {
            return Err(Missed::Passed);
        }
        // The number is only right from the first recognised frame on.
        self.next = self.next.or(Some(0));
        compare_time(pts_s - known.stream.start_s, target)
    }

    /// Returns whether a frame after an unreliable seek is the target.
    ///
    /// Frames are recognised by time and content as those of the first pass from the beginning.
    fn is_seen_target(
        &self,
        found: FrameIdentity,
        target: Target,
        known: &Knowledge,
    ) -> Result<bool, Missed> {
        if let Some(next) = self.next {
            // After a recognised frame, each must be the one that followed it in the first pass.
            let is_known =
                known.seen.get(next as usize) == Some(&found) && found.checksum.is_some();
            return if is_known {
                compare_number(next, target)
            } else {
                Err(Missed::Passed)
            };
        }
        let wanted = known
            .seen
            .get(target.index as usize)
            .copied()
            .ok_or(Missed::Passed)?;
        match (found.pts_s, wanted.pts_s) {
            (Some(found_s), Some(wanted_s)) if found_s < wanted_s => Ok(false),
            _ if found == wanted && found.checksum.is_some() => Ok(true),
            _ => Err(Missed::Passed),
        }
    }
}

/// Returns whether a frame of this time is the requested one.
fn compare_time(time_s: f64, target: Target) -> Result<bool, Missed> {
    match time_s - target.time_s {
        late if late > SAME_TIME_S => Err(Missed::Passed),
        late => Ok(late >= -SAME_TIME_S),
    }
}

/// Returns whether the frame of this number is the requested one.
fn compare_number(number: u64, target: Target) -> Result<bool, Missed> {
    if number > target.index {
        Err(Missed::Passed)
    } else {
        Ok(number == target.index)
    }
}

/// Reads one frame and returns the decoder for the frames that follow.
///
/// The frame comes from a decoder that reaches it soon, else from one that is started near it, else
/// from the beginning.
pub(super) fn read_frame(
    programs: &Programs,
    path: &Path,
    running: Option<Running>,
    request: FrameRequest,
    known: &mut Knowledge,
) -> Result<(Image, Running), FrameError> {
    let target = request.target;
    let usable = |running: &Running| known.damage.is_none() || running.is_single_thread;
    if let Some(mut running) = running.filter(usable) {
        match running.advance(target, known) {
            Ok(image) => return Ok((image, running)),
            Err(Missed::Error(damage)) => known.learn(damage, running.is_from_start),
            Err(Missed::Passed | Missed::Ended(_)) => {}
        }
    }
    loop {
        let was_damaged = known.damage.is_some();
        match start_and_read(programs, path, request, known)? {
            Ok(found) => return Ok(found),
            // Try again with one thread.
            Err(Missed::Error(_)) if !was_damaged => {}
            Err(missed) => return Err(no_frame(path, target, &missed, known)),
        }
    }
}

fn start_and_read(
    programs: &Programs,
    path: &Path,
    request: FrameRequest,
    known: &mut Knowledge,
) -> Result<Result<(Image, Running), Missed>, FrameError> {
    let FrameRequest { target, ahead } = request;
    let mut missed = Missed::Passed;
    for options in known.starts(target, ahead) {
        let is_from_start = options.seek_s.is_none();
        if is_from_start && target.index > NEAR_START {
            known.is_unseekable = true; // no seek found it
        }
        let options = DecoderOptions {
            checksums: !known.has_reliable_seeks(),
            ..options
        };
        let decoder = Decoder::start(programs, path, options)?;
        let next = is_from_start.then_some(0);
        let mut running = Running {
            decoder,
            next,
            is_from_start,
            is_single_thread: options.single_thread,
        };
        match running.advance(target, known) {
            Ok(image) => return Ok(Ok((image, running))),
            Err(Missed::Error(damage)) if is_from_start => {
                known.learn(damage.clone(), true);
                return Ok(Err(Missed::Error(damage)));
            }
            Err(why) => missed = why,
        }
    }
    Ok(Err(missed))
}

impl Knowledge {
    /// Adds the knowledge of another thread.
    pub fn learn_from(&mut self, other: Self) {
        self.is_unseekable |= other.is_unseekable;
        self.damage = self.damage.take().or(other.damage);
        if other.seen.len() > self.seen.len() {
            self.seen = other.seen;
        }
    }

    /// Adds an error of ffmpeg.
    ///
    /// After a seek, it may only mean that earlier frames were missing.
    fn learn(&mut self, damage: Damage, is_from_start: bool) {
        if is_from_start {
            self.damage.get_or_insert(damage);
        } else {
            self.is_unseekable = true;
        }
    }
}

fn no_frame(video: &Path, target: Target, missed: &Missed, known: &Knowledge) -> FrameError {
    let why = match (missed, &known.damage) {
        (Missed::Ended(why), None) => why.clone(),
        (Missed::Passed, None) => format!("no frame has the time {:.6} s", target.time_s),
        (_, Some(Damage { index, error })) | (Missed::Error(Damage { index, error }), _) => {
            format!("damaged at frame {index}: {error}")
        }
    };
    let what = format!(
        "frame {} cannot be decoded ({why}); the video is damaged or was changed: put the earlier file back or open the \
         frames again",
        target.index
    );
    FrameError::Invalid {
        path: video.into(),
        what,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(is_seekable: bool) -> Knowledge {
        Knowledge::new(Stream::for_tests(is_seekable))
    }

    #[test]
    fn videos_without_reliable_seeks_are_decoded_from_the_beginning() {
        let target = Target {
            index: 100,
            time_s: 4.0,
        };
        let seeks = |known: &Knowledge| {
            known
                .starts(target, 1)
                .iter()
                .map(|start| start.seek_s)
                .collect::<Vec<_>>()
        };
        assert_eq!(seeks(&known(true)), [Some(4.0), Some(2.0), None]);
        assert_eq!(seeks(&known(false)), [None]);
        let mut seen = known(false);
        for index in 0..=100 {
            seen.note(
                index,
                FrameIdentity {
                    pts_s: Some(index as f64),
                    checksum: Some(7),
                },
            );
        }
        assert_eq!(
            seeks(&seen),
            [Some(4.0), Some(2.0), None],
            "what was seen once proves a seek"
        );
        seen.damage = Some(Damage {
            index: 3,
            error: String::new(),
        });
        assert_eq!(seeks(&seen), [None]);
        assert!(seen.starts(target, 1)[0].single_thread);
    }
}
