//! Playback of the frames with their masks.
//!
//! All times are those of egui's input, so that tests are deterministic. A frame is shown only once
//! its image and its mask are ready, so that the frame number is always that of the shown image.

use egui::{Event, Key};
use serde::{Deserialize, Serialize};

use super::{Action, Shortcuts};
use ostra_frames::{Frame, ImageSource};
use ostra_project::review::Review;

/// Time for which a photo is shown at normal speed, in seconds.
const PHOTO_SECONDS: f64 = 0.25;

/// Maximum time for which an image of a video is shown at normal speed, in seconds.
///
/// A project may use every hundredth frame of a video.
const MAX_SECONDS: f64 = 0.5;

/// Maximum time in seconds for which images of a video are left out at once.
///
/// A window that is drawn slowly leaves out images to keep the time. Images that are decoded slowly
/// are all shown, because decoding has to pass through them, and playback takes longer.
const MAX_LATE: f64 = 0.5;

/// Time between two looks at a frame that is not ready, in seconds.
const WAIT_SECONDS: f64 = 0.05;

/// Number of frames to prepare before they are shown.
const AHEAD: usize = 10;

/// Speed of playback.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum PlaySpeed {
    /// The frame rate of a video, or four photos per second.
    #[default]
    Full,
    /// Half the speed.
    Half,
    /// A quarter of the speed.
    Quarter,
}

impl PlaySpeed {
    /// All speeds, fastest first.
    pub const ALL: [Self; 3] = [Self::Full, Self::Half, Self::Quarter];

    /// Returns the text shown in the window.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Full => "1×",
            Self::Half => "½×",
            Self::Quarter => "¼×",
        }
    }

    fn factor(self) -> f64 {
        match self {
            Self::Full => 1.0,
            Self::Half => 0.5,
            Self::Quarter => 0.25,
        }
    }
}

/// Preferences of playback.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlaybackPrefs {
    /// Speed.
    pub speed: PlaySpeed,
    /// Whether playback starts again after the last frame.
    pub loops: bool,
    /// Whether playback pauses at frames to check.
    pub stops: bool,
}

impl Default for PlaybackPrefs {
    fn default() -> Self {
        Self {
            speed: PlaySpeed::Full,
            loops: true,
            stops: false,
        }
    }
}

/// Frames to play, in order.
#[derive(Clone, Copy)]
pub(super) struct PlayList<'a> {
    pub frames: &'a [Frame],
    /// First and last frame.
    pub range: (usize, usize),
    pub prefs: PlaybackPrefs,
    pub review: &'a Review,
}

impl PlayList<'_> {
    /// Returns the frame after another one; `None` at the end.
    fn next(&self, frame: usize) -> Option<usize> {
        let (first, last) = self.range;
        if (first..last).contains(&frame) {
            Some(frame + 1)
        } else {
            (self.prefs.loops || frame != last).then_some(first)
        }
    }

    /// Returns the frames from the one after `frame` on that are to be prepared.
    pub fn coming(&self, frame: usize) -> Vec<usize> {
        let mut at = frame;
        let mut coming = Vec::new();
        while coming.len() < AHEAD
            && let Some(next) = self.next(at)
            && next != frame
        {
            coming.push(next);
            at = next;
        }
        coming
    }

    fn is_video(&self, frame: usize) -> bool {
        let image = self.frames.get(frame).map(|frame| &frame.image);
        matches!(image, Some(ImageSource::Video { .. }))
    }

    fn stops_at(&self, frame: usize) -> bool {
        self.prefs.stops && self.review.to_check.contains_key(&frame)
    }

    /// Returns the time for which a frame is shown, in seconds.
    fn seconds(&self, frame: usize) -> f64 {
        let source = |number: usize| self.frames.get(number).map(|frame| &frame.image);
        let next = frame.saturating_add(1);
        let seconds = match (source(frame), source(next)) {
            (
                Some(ImageSource::Video { path, time_s, .. }),
                Some(ImageSource::Video {
                    path: next_path,
                    time_s: next_s,
                    ..
                }),
            ) if path == next_path && next_s > time_s => (next_s - time_s).min(MAX_SECONDS),
            _ => PHOTO_SECONDS,
        };
        seconds / self.prefs.speed.factor()
    }
}

/// Frame that is shown during playback, and when the next one is due.
#[derive(Debug, Clone, Copy)]
struct Playing {
    frame: usize,
    due: f64,
}

/// State of playback.
#[derive(Debug, Default)]
pub struct Playback {
    playing: Option<Playing>,
    /// Key that starts or pauses playback, while it is held and no button was pressed since.
    tapped: Option<Key>,
    /// Whether the press that paused playback is still held.
    holds_press: bool,
}

impl Playback {
    /// Returns `true` while frames are played.
    #[must_use]
    pub fn is_playing(&self) -> bool {
        self.playing.is_some()
    }

    /// Pauses playback. The shown frame stays.
    pub fn pause(&mut self) {
        self.playing = None;
    }

    /// Starts at a frame and returns the frame to show first.
    ///
    /// Playback from the last frame, or from outside the range, begins with the first one.
    pub(super) fn start(&mut self, now: f64, list: &PlayList<'_>, frame: usize) -> usize {
        let (first, last) = list.range;
        let frame = if (first..last).contains(&frame) {
            frame
        } else {
            first
        };
        let due = now + list.seconds(frame);
        self.playing = Some(Playing { frame, due });
        frame
    }

    /// Returns the frame to show now.
    ///
    /// Pauses at the end, at a frame to check, and if another frame is `shown` than was played.
    pub(super) fn advance(
        &mut self,
        now: f64,
        list: &PlayList<'_>,
        shown: usize,
        is_ready: impl Fn(usize) -> bool,
    ) -> usize {
        let Some(Playing { mut frame, mut due }) = self.playing else {
            return shown;
        };
        if shown != frame {
            self.pause();
            return shown;
        }
        if !is_ready(frame) {
            // The first frame, whose time begins when it can be seen.
            due = now + list.seconds(frame);
        }
        due = due.max(now - MAX_LATE);
        while due <= now {
            let Some(next) = list.next(frame) else {
                self.pause();
                return frame;
            };
            if !is_ready(next) {
                due = now;
                break;
            }
            let seconds = list.seconds(next);
            frame = next;
            if list.stops_at(next) {
                self.pause();
                return frame;
            }
            if !list.is_video(next) {
                // Photos are never left out, and none is shown for less than half its time.
                due = due.max(now - 0.5 * seconds) + seconds;
                break;
            }
            due += seconds;
        }
        self.playing = Some(Playing { frame, due });
        frame
    }

    /// Returns the time in seconds after which the window is to be drawn again.
    ///
    /// The loaders wake the window earlier when a frame that is waited for is ready.
    pub(super) fn seconds_left(&self, now: f64) -> Option<f64> {
        let left = self.playing?.due - now;
        Some(if left > 0.0 { left } else { WAIT_SECONDS })
    }

    /// Returns `true` if the play key was tapped: pressed and released without a press of a button.
    ///
    /// Space with a drag moves the image, so that the press alone does not tell what is meant.
    /// `may_start` is `false` while keys go elsewhere.
    pub(super) fn follow_key(
        &mut self,
        events: &[Event],
        shortcuts: &Shortcuts,
        may_start: bool,
    ) -> bool {
        let mut is_tapped = false;
        for event in events {
            match event {
                Event::Key { key, pressed, .. } if !pressed => {
                    is_tapped |= self.tapped.take_if(|tapped| tapped == key).is_some();
                }
                Event::Key { key, .. }
                    if may_start && shortcuts.action_for(event) == Some(Action::TogglePlay) =>
                {
                    self.tapped = Some(*key);
                }
                Event::PointerButton { pressed: true, .. } | Event::WindowFocused(false) => {
                    self.tapped = None;
                }
                _ => {}
            }
        }
        is_tapped
    }

    /// Pauses if the image is pressed during playback; returns `true` while that press lasts.
    ///
    /// It only pauses, because the frame under the pointer may not be the one that was meant.
    pub(super) fn takes_press(&mut self, is_pressed: bool, is_down: bool) -> bool {
        if is_pressed && self.is_playing() {
            self.pause();
            self.holds_press = true;
        }
        let takes = self.holds_press;
        self.holds_press &= is_down;
        takes
    }
}

#[cfg(test)]
mod tests;
