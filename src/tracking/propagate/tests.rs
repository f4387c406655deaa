//! Tests of the driver with an engine that keeps masks in place and needs no network.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::{
    KeyframeUse, LabelProbabilities, LookAhead, MaskPropagator, PassFrame, PassResult, Section,
    propagate, shown_labels,
};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore, Image, ImageSource, Orientation};
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame};

const WIDTH: u32 = 12;
const HEIGHT: u32 = 4;
const A: LabelId = LabelId(3);
const B: LabelId = LabelId(5);
/// Confidence of the engine.
const CONFIDENT: f32 = 0.75;

/// An engine that records its calls as `r4 p5 …`; frames are identified by their colour.
struct Still<'a> {
    requested: &'a RefCell<Vec<String>>,
    known: BTreeMap<LabelId, Vec<bool>>,
}

impl MaskPropagator for Still<'_> {
    fn start_pass(&mut self, _direction: Direction) {
        self.known.clear();
    }

    fn add_keyframe(&mut self, frame: &PassFrame, mask: &LabelMask) -> Result<(), MaskError> {
        let shown = shown_labels(mask);
        let given: String = shown
            .iter()
            .map(|label| if *label == A { 'A' } else { 'B' })
            .collect();
        self.requested
            .borrow_mut()
            .push(format!("r{}{given}", frame.image.pixels[0][0]));
        self.known.extend(
            shown
                .into_iter()
                .map(|label| (label, mask.region(label).inside)),
        );
        Ok(())
    }

    fn transfer_to(
        &mut self,
        frame: &PassFrame,
        _ahead: &mut LookAhead<'_, '_>,
    ) -> Result<PassResult, MaskError> {
        let image: &Image = &frame.image;
        self.requested
            .borrow_mut()
            .push(format!("p{}", image.pixels[0][0]));
        let rest = (1.0 - CONFIDENT) / self.known.len() as f32;
        let area = image.pixels.len();
        let mut probabilities = vec![rest; (1 + self.known.len()) * area];
        for at in 0..area {
            let there = self
                .known
                .values()
                .position(|inside| inside[at])
                .map_or(0, |place| 1 + place);
            probabilities[there * area + at] = CONFIDENT;
        }
        Ok(PassResult::most_probable(LabelProbabilities {
            labels: self.known.keys().copied().collect(),
            width: image.width as usize,
            height: image.height as usize,
            probabilities,
        }))
    }
}

struct Sequence {
    folder: tempfile::TempDir,
    request: TrackRequest,
}

/// Result of a tracking run.
struct Outcome {
    requested: String,
    /// Frames in the order in which they were emitted.
    given: Vec<TrackedFrame>,
    ended: Result<Vec<String>, MaskError>,
}

impl Sequence {
    fn new(count: usize, keyframes: &[(usize, LabelMask)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let frame = |at: usize| {
            let path = folder.path().join(format!("{at:02}.png"));
            image::RgbImage::from_pixel(WIDTH, HEIGHT, image::Rgb([at as u8; 3]))
                .save(&path)
                .unwrap();
            let image = ImageSource::File {
                path,
                orientation: Orientation::default(),
            };
            Frame {
                name: format!("{at:02}"),
                width: WIDTH,
                height: HEIGHT,
                image,
                depth: None,
                camera: None,
            }
        };
        let request = TrackRequest {
            frames: Arc::new((0..count).map(frame).collect()),
            store: Arc::new(FrameStore::new(1 << 20)),
            keyframes: keyframes
                .iter()
                .map(|(at, mask)| (*at, Arc::new(mask.clone())))
                .collect(),
            from: 0,
            to: count - 1,
            direction: Direction::Both,
            labels: None,
        };
        Self { folder, request }
    }

    fn track(&self) -> Outcome {
        self.track_until(usize::MAX)
    }

    /// Tracks, and requests a stop after `count` frames have been emitted.
    fn track_until(&self, count: usize) -> Outcome {
        let (progress, requested, mut given) =
            (Progress::default(), RefCell::default(), Vec::new());
        let mut emit = |frame| {
            given.push(frame);
            if given.len() == count {
                progress.stop();
            }
        };
        let make = |_: &Section| -> Box<dyn MaskPropagator + '_> {
            Box::new(Still {
                requested: &requested,
                known: BTreeMap::new(),
            })
        };
        let ended = propagate(
            &self.request,
            KeyframeUse::Sequence,
            &mut emit,
            &progress,
            &make,
        );
        let requested = requested.borrow().join(" ");
        Outcome {
            requested,
            given,
            ended,
        }
    }
}

impl Outcome {
    /// Returns the numbers of the emitted frames, with `~` after preliminary ones.
    fn frames(&self) -> String {
        let reported = |frame: &TrackedFrame| {
            format!(
                "{}{}",
                frame.frame,
                if frame.preliminary { "~" } else { "" }
            )
        };
        self.given
            .iter()
            .map(reported)
            .collect::<Vec<_>>()
            .join(" ")
    }

    /// Returns the last result for a frame.
    fn last(&self, frame: usize) -> &TrackedFrame {
        self.given
            .iter()
            .rfind(|given| given.frame == frame)
            .unwrap()
    }
}

/// Creates a mask with a label in each range of columns.
fn mask(parts: &[(LabelId, std::ops::Range<u32>)]) -> LabelMask {
    let mut mask = LabelMask::empty(WIDTH, HEIGHT);
    for (at, id) in mask.ids.iter_mut().enumerate() {
        let column = at as u32 % WIDTH;
        *id = parts
            .iter()
            .find(|(_, columns)| columns.contains(&column))
            .map_or(LabelId::NONE, |(label, _)| *label);
    }
    mask
}

#[test]
fn passes_run_in_both_directions_and_add_keyframes() {
    let mut sequence = Sequence::new(9, &[(3, mask(&[(A, 0..4)])), (6, mask(&[(A, 0..4)]))]);
    let outcome = sequence.track();
    assert_eq!(
        outcome.requested,
        "r3A p4 p5 r6A p7 p8 r6A p5 p4 r3A p2 p1 p0"
    );
    assert_eq!(outcome.frames(), "4~ 5~ 7 8 5 4 2 1 0");
    assert!(outcome.ended.unwrap().is_empty());
    sequence.request.direction = Direction::Forward;
    let outcome = sequence.track();
    assert_eq!(
        (outcome.requested.as_str(), outcome.frames().as_str()),
        ("r3A p4 p5 r6A p7 p8", "4 5 7 8")
    );
    sequence.request.direction = Direction::Backward;
    let outcome = sequence.track();
    assert_eq!(
        (outcome.requested.as_str(), outcome.frames().as_str()),
        ("r6A p5 p4 r3A p2 p1 p0", "5 4 2 1 0")
    );
    assert_eq!(outcome.last(2).mask, mask(&[(A, 0..4)]));
    assert_eq!(outcome.last(2).confidence, BTreeMap::from([(A, CONFIDENT)]));
}

#[test]
fn nearest_keyframes_outside_the_range_are_read() {
    let keyframes = [
        (0, mask(&[(A, 0..2)])),
        (1, mask(&[(B, 8..9)])),
        (2, mask(&[(A, 0..4)])),
        (8, mask(&[(A, 0..4)])),
    ];
    let mut sequence = Sequence::new(10, &keyframes);
    (sequence.request.from, sequence.request.to) = (4, 5);
    let outcome = sequence.track();
    // Label B comes from the last keyframe that shows it.
    assert_eq!(outcome.requested, "r1B r2A p3 p4 p5 r8A p7 p6 p5 p4");
    assert_eq!(outcome.frames(), "4~ 5~ 5 4");
    assert_eq!(outcome.last(4).mask, mask(&[(A, 0..4), (B, 8..9)]));
    (
        sequence.request.from,
        sequence.request.to,
        sequence.request.direction,
    ) = (9, 9, Direction::Backward);
    let text = sequence.track().ended.unwrap_err().to_string();
    assert!(text.contains("side of a keyframe"), "{text}");
}

#[test]
fn label_of_a_later_keyframe_is_added_and_propagated_back() {
    let sequence = Sequence::new(7, &[(0, mask(&[(A, 0..4)])), (4, mask(&[(B, 8..10)]))]);
    let outcome = sequence.track();
    assert_eq!(outcome.requested, "r0A p1 p2 p3 r4B p5 p6 r4B p3 p2 p1");
    assert_eq!(
        outcome.given[1].mask,
        mask(&[(A, 0..4)]),
        "forwards nothing is known of B yet"
    );
    let both = mask(&[(A, 0..4), (B, 8..10)]);
    for frame in [1, 2, 3, 5, 6] {
        assert_eq!(outcome.last(frame).mask, both, "frame {frame}");
        assert_eq!(
            outcome.last(frame).confidence,
            BTreeMap::from([(A, CONFIDENT), (B, CONFIDENT)])
        );
    }
}

#[test]
fn nearer_keyframe_has_more_weight() {
    let sequence = Sequence::new(11, &[(0, mask(&[(A, 0..4)])), (10, mask(&[(A, 4..8)]))]);
    let outcome = sequence.track();
    assert_eq!(outcome.last(2).mask, mask(&[(A, 0..4)]));
    assert_eq!(outcome.last(8).mask, mask(&[(A, 4..8)]));
    // The passes share no pixel, so the confidence is half of that in full agreement.
    assert!((outcome.last(2).confidence[&A] - CONFIDENT / 2.0).abs() < 1e-6);
    assert!(
        outcome
            .given
            .iter()
            .filter(|given| given.preliminary)
            .all(|given| given.mask == mask(&[(A, 0..4)]))
    );
}

#[test]
fn finished_frames_survive_a_stop() {
    let sequence = Sequence::new(9, &[(0, mask(&[(A, 0..4)]))]);
    let outcome = sequence.track_until(3);
    assert!(matches!(outcome.ended, Err(MaskError::Stopped(_))));
    assert_eq!(
        (outcome.frames().as_str(), outcome.requested.as_str()),
        ("1 2 3", "r0A p1 p2 p3")
    );
}

#[test]
fn only_requested_labels_are_tracked() {
    let mut sequence = Sequence::new(
        5,
        &[(0, mask(&[(A, 0..4), (B, 6..8)])), (4, mask(&[(A, 0..4)]))],
    );
    sequence.request.labels = Some(BTreeSet::from([B]));
    let outcome = sequence.track();
    assert_eq!(
        outcome.requested, "r0B p1 p2 p3",
        "the other keyframe shows none"
    );
    assert_eq!(outcome.last(3).mask, mask(&[(B, 6..8)]));
    sequence.request.labels = Some(BTreeSet::from([LabelId(9)]));
    assert!(
        sequence
            .track()
            .ended
            .unwrap_err()
            .to_string()
            .contains("no mask shows a label")
    );
}

#[test]
fn images_of_another_size_get_their_own_pass_or_a_warning() {
    let mut sequence = Sequence::new(6, &[(0, mask(&[(A, 0..4)]))]);
    let mut frames = sequence.request.frames.to_vec();
    for at in [2, 4] {
        let path = sequence.folder.path().join(format!("large-{at}.png"));
        image::RgbImage::from_pixel(20, 10, image::Rgb([at as u8; 3]))
            .save(&path)
            .unwrap();
        frames[at].image = ImageSource::File {
            path,
            orientation: Orientation::default(),
        };
        (frames[at].width, frames[at].height) = (20, 10);
    }
    sequence.request.frames = Arc::new(frames);
    let outcome = sequence.track();
    assert_eq!(outcome.requested, "r0A p1 p3 p5");
    let warnings = outcome.ended.unwrap().join(" ");
    assert!(
        warnings.contains("2 frames")
            && warnings.contains("02, 04")
            && warnings.contains("another size")
    );
    let mut large = LabelMask::empty(20, 10);
    large.ids[7] = B;
    sequence.request.keyframes.insert(4, Arc::new(large));
    let outcome = sequence.track();
    assert_eq!(outcome.requested, "r0A p1 p3 p5 r4B p2");
    assert!(outcome.ended.as_ref().unwrap().is_empty());
    assert_eq!(
        (outcome.last(2).mask.width, outcome.last(2).mask.ids[7]),
        (20, B)
    );
}

#[test]
fn unreadable_frames_are_skipped_and_named() {
    let sequence = Sequence::new(5, &[(0, mask(&[(A, 0..4)])), (4, mask(&[(A, 0..4)]))]);
    let remove = |at: usize| {
        std::fs::remove_file(sequence.folder.path().join(format!("{at:02}.png"))).unwrap();
    };
    [2, 4].into_iter().for_each(remove);
    let outcome = sequence.track();
    assert_eq!(
        outcome.requested, "r0A p1 p3",
        "nothing starts from a keyframe that cannot be read"
    );
    assert_eq!(outcome.frames(), "1~ 3~ 1 3", "no answer stays preliminary");
    let warnings = outcome.ended.unwrap().join(" ");
    assert!(
        warnings.contains("2 frames cannot be read") && warnings.contains("02, 04"),
        "{warnings}"
    );
    [0, 1, 3].into_iter().for_each(remove);
    let mut gone = sequence;
    gone.request.store = Arc::new(FrameStore::new(1 << 20));
    assert!(matches!(gone.track().ended, Err(MaskError::Frame(_))));
}

#[test]
fn frames_after_an_unreadable_keyframe_are_named() {
    let mut sequence = Sequence::new(5, &[(0, mask(&[(A, 0..4)])), (3, mask(&[(A, 0..4)]))]);
    std::fs::remove_file(sequence.folder.path().join("00.png")).unwrap();
    sequence.request.direction = Direction::Forward;
    let outcome = sequence.track();
    assert_eq!(outcome.frames(), "4");
    let warnings = outcome.ended.unwrap().join(" ");
    assert!(
        warnings.contains("2 frames were left out") && warnings.contains("01, 02"),
        "{warnings}"
    );
}
