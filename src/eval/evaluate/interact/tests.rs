mod taken_back;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex};

use super::user::{Clicks, LabellingSetup, RobotUser};
use super::{FrameByFrame, InteractOptions, Sequence, interact};
use crate::evaluate::interact::options::Aim;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::{DepthMap, FrameFolder, FrameStore, Image, OpenRequest, open};
use ostra_masks::{
    Label, LabelId, LabelMask, LabelTree, MaskError, PreparedFrame, Region, RunMask,
    SegmentRequest, Segmenter, TrackRequest, TrackedFrame, Tracker,
};
use ostra_session::PreparedFrames;

pub(super) mod shape;

const SIZE: (u32, u32) = (64, 24);
const FRAMES: u32 = 12;

/// Returns the columns of two objects.
///
/// The red one moves by 2 px per frame. The blue one exists from frame 3 on and does not move.
fn columns(frame: u32) -> [(LabelId, [u8; 3], Range<u32>); 2] {
    let blue = if frame < 3 { 0..0 } else { 52..62 };
    [
        (LabelId(1), [200, 30, 30], 2 + 2 * frame..18 + 2 * frame),
        (LabelId(2), [30, 30, 200], blue),
    ]
}

/// Writes frames to files and returns them with their ground truth masks.
fn sequence(folder: &Path) -> Sequence {
    let (width, height) = SIZE;
    let mut truth = BTreeMap::new();
    for frame in 0..FRAMES {
        let object = |x, y| {
            columns(frame)
                .into_iter()
                .find(|(_, _, at)| at.contains(&x) && (4..20).contains(&y))
        };
        // Chequered: a click of which only its pixel obeys changes that pixel and none around it.
        let shade = |x: u32, y: u32| 1 + (x + y) as u8 % 2;
        let color = |x, y| {
            let color = object(x, y).map_or([90; 3], |(_, color, _)| color);
            image::Rgb(color.map(|channel| channel / shade(x, y)))
        };
        image::RgbImage::from_fn(width, height, color)
            .save(folder.join(format!("{frame:02}.png")))
            .unwrap();
        let id = |at: u32| object(at % width, at / width).map_or(LabelId::NONE, |(id, _, _)| id);
        let mask = LabelMask {
            width,
            height,
            ids: (0..width * height).map(id).collect(),
        };
        truth.insert(frame as usize, RunMask::encode(&mask));
    }
    let sources = vec![FrameFolder::from(folder.to_owned())];
    let opened = open(
        &OpenRequest {
            sources,
            ..OpenRequest::default()
        },
        &Progress::default(),
    )
    .unwrap();
    let label = |id: u16| Label {
        id: LabelId(id),
        name: id.to_string(),
        color: [0; 3],
        parent: None,
    };
    let labels = LabelTree::try_from(vec![label(1), label(2)]).unwrap();
    Sequence {
        frames: Arc::new(opened.frames),
        store: Arc::new(FrameStore::new(1 << 20)),
        labels,
        truth,
    }
}

/// A segmenter that returns all pixels of the clicked colour, or only the clicked pixel.
struct ByColor {
    whole: bool,
}

struct Colors {
    image: Arc<Image>,
    whole: bool,
}

impl Segmenter for ByColor {
    fn name(&self) -> &'static str {
        "by color"
    }

    fn prepare(
        &self,
        image: &Arc<Image>,
        _: Option<&Arc<DepthMap>>,
        _: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        Ok(Arc::new(Colors {
            image: Arc::clone(image),
            whole: self.whole,
        }))
    }
}

impl PreparedFrame for Colors {
    fn segment(&self, request: &SegmentRequest<'_>, _: &Progress) -> Result<Region, MaskError> {
        let (width, height) = (self.image.width, self.image.height);
        let click = request.prompt.clicks.last().unwrap();
        let at = click.pixel_in(width, height).unwrap();
        let hue = |pixel: usize| {
            let [red, _, blue] = self.image.pixels[pixel];
            red.cmp(&blue)
        };
        let alike = |pixel: usize| click.include && hue(pixel) == hue(at);
        let inside = (0..self.image.pixels.len()).map(|pixel| {
            if self.whole {
                alike(pixel)
            } else {
                pixel == at
            }
        });
        Ok(Region {
            width,
            height,
            inside: inside.collect(),
        })
    }

    fn bytes(&self) -> usize {
        0
    }
}

/// Keyframes, range and labels of a request.
type Asked = (BTreeSet<usize>, Range<usize>, Option<BTreeSet<LabelId>>);

/// A tracker that copies the nearest keyframe and records the requests.
#[derive(Default)]
struct Copier {
    requested: Mutex<Vec<Asked>>,
}

impl Tracker for Copier {
    fn name(&self) -> &'static str {
        "copier"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        let keyframes: BTreeSet<usize> = request.keyframes.keys().copied().collect();
        self.requested.lock().unwrap().push((
            keyframes,
            request.from..request.to + 1,
            request.labels.clone(),
        ));
        for frame in
            (request.from..=request.to).filter(|frame| !request.keyframes.contains_key(frame))
        {
            progress.check()?;
            let nearest = request
                .keyframes
                .iter()
                .min_by_key(|(keyframe, _)| keyframe.abs_diff(frame))
                .unwrap();
            let mask = nearest.1.as_ref().clone();
            emit(TrackedFrame {
                frame,
                mask,
                confidence: BTreeMap::new(),
                preliminary: false,
            });
        }
        Ok(Vec::new())
    }
}

#[test]
fn corrections_between_keyframes_reach_the_goal() {
    let folder = tempfile::tempdir().unwrap();
    let (sequence, tracker) = (sequence(folder.path()), Copier::default());
    let options = InteractOptions::default();
    let report = interact(
        &sequence,
        &ByColor { whole: true },
        &tracker,
        &options,
        &Progress::default(),
    )
    .unwrap();
    // One click per object and frame: 12 frames show red and 9 show blue.
    assert_eq!(
        report.frame_by_frame,
        FrameByFrame {
            frames: 12,
            clicks: 21,
            failed: 0
        }
    );
    assert!(report.mean_iou >= 0.95, "{report:?}");
    let clicks: Vec<usize> = report
        .reached
        .iter()
        .map(|goal| goal.clicks.unwrap())
        .collect();
    assert!(
        clicks.is_sorted() && clicks[0] > 1 && clicks[2] == report.clicks && clicks[2] < 21,
        "{clicks:?}"
    );
    assert!(report.saved().unwrap() > 0.3);
    let requested = tracker.requested.into_inner().unwrap();
    assert_eq!(
        requested[0],
        (BTreeSet::from([0]), 0..FRAMES as usize, None),
        "first all labels over all frames"
    );
    for (keyframes, range, labels) in &requested[1..] {
        assert!(
            labels
                .as_ref()
                .is_some_and(|labels| (1..=2).contains(&labels.len())),
            "what is poor on the frame"
        );
        assert_eq!(
            keyframes
                .iter()
                .filter(|&keyframe| range.contains(keyframe))
                .count(),
            1,
            "{keyframes:?} {range:?}"
        );
        let is_bound = |frame: usize| frame == FRAMES as usize || keyframes.contains(&frame);
        assert!((range.start == 0 || is_bound(range.start - 1)) && is_bound(range.end));
    }
    let asks_for = |label, requested: &Asked| {
        requested
            .2
            .as_ref()
            .is_some_and(|labels| labels.contains(&LabelId(label)))
    };
    assert!(
        requested[1..]
            .iter()
            .any(|requested| asks_for(2, requested)),
        "blue comes later"
    );
}

#[test]
fn drawing_replaces_ineffective_clicks_and_its_corners_count() {
    let folder = tempfile::tempdir().unwrap();
    let sequence = sequence(folder.path());
    let options = InteractOptions::default();
    let report = interact(
        &sequence,
        &ByColor { whole: false },
        &Copier::default(),
        &options,
        &Progress::default(),
    )
    .unwrap();
    // Three clicks without gain, and the four corners of a rectangle.
    assert_eq!(
        report.frame_by_frame,
        FrameByFrame {
            frames: 12,
            clicks: 21 * (options.patience + 4),
            failed: 0
        }
    );
    assert!(report.mean_iou >= 0.95, "{report:?}");
    // What was copied to where nothing is goes by an exclude click, whose pixel was all of it.
    assert_eq!(report.corners % 4, 0, "rectangles: {report:?}");
    assert!(
        report.clicks * 4 >= report.corners * 7,
        "clicks in vain come before each: {report:?}"
    );
}

#[test]
fn drawing_resumes_when_the_price_is_lowered() {
    let folder = tempfile::tempdir().unwrap();
    let sequence = sequence(folder.path());
    // Each of the four corners gains an IoU of a quarter.
    for (least_price, is_drawn) in [(0.2, false), (0.1, true)] {
        let options = InteractOptions {
            price: 0.3,
            price_beyond: 0.3,
            least_price,
            ..InteractOptions::default()
        };
        let report = interact(
            &sequence,
            &ByColor { whole: false },
            &Copier::default(),
            &options,
            &Progress::default(),
        )
        .unwrap();
        assert_eq!(
            (report.corners >= 4, report.mean_iou >= 0.9),
            (is_drawn, is_drawn),
            "{report:?}"
        );
        assert_eq!(
            report.failed_by_frame.frames,
            FRAMES as usize - 1,
            "the first was not tracked"
        );
        // Without the two objects of the last frame, the mean is 0.90 already.
        let corners = if is_drawn { 19 * 4 } else { 0 };
        assert_eq!(
            report.frame_by_frame.clicks,
            21 * options.patience + corners,
            "by the same rules: {report:?}"
        );
        // Blue is also clicked where it was copied to but is not present.
        let in_vain = report.clicks - report.corners;
        assert!(
            in_vain <= 22 * options.patience,
            "nothing is clicked on in vain twice: {report:?}"
        );
    }
}

#[test]
fn too_coarse_precision_still_terminates() {
    let folder = tempfile::tempdir().unwrap();
    let sequence = sequence(folder.path());
    let options = InteractOptions {
        outline_px: 100.0,
        ..InteractOptions::default()
    };
    let report = interact(
        &sequence,
        &ByColor { whole: false },
        &Copier::default(),
        &options,
        &Progress::default(),
    )
    .unwrap();
    assert!(report.reached.iter().all(|goal| goal.clicks.is_none()) && report.saved().is_none());
    assert!(
        report.clicks <= 2 * report.frame_by_frame.clicks && report.mean_iou < 0.1,
        "{report:?}"
    );
    assert_eq!(
        report.frame_by_frame,
        FrameByFrame {
            frames: 12,
            clicks: 21 * options.patience,
            failed: FRAMES as usize
        }
    );
}

#[test]
fn click_limit_is_not_exceeded() {
    let folder = tempfile::tempdir().unwrap();
    let (sequence, options, progress) = (
        sequence(folder.path()),
        InteractOptions::default(),
        Progress::default(),
    );
    let (prepared, segmenter) = (PreparedFrames::new(1 << 20), ByColor { whole: false });
    for most in [2, 5] {
        let setup = LabellingSetup {
            sequence: &sequence,
            segmenter: &segmenter,
            prepared: &prepared,
            progress: &progress,
            options: &options,
        };
        let mut user = RobotUser::new(setup, 0, most);
        let requested = sequence
            .shown_on(4)
            .into_iter()
            .map(|label| (label, Clicks::of(&options)))
            .collect();
        user.visit(4, &requested, &Aim::of(&options)).unwrap();
        // Six clicks without gain and four corners for each of two labels would be needed.
        assert!(
            user.is_spent() && user.clicks() == most && user.corners() == 0,
            "{} of {most}",
            user.clicks()
        );
    }
}

#[test]
fn stopping_ends_the_simulation() {
    let folder = tempfile::tempdir().unwrap();
    let (sequence, options, stopped) = (
        sequence(folder.path()),
        InteractOptions::default(),
        Progress::default(),
    );
    stopped.stop();
    let stopped = interact(
        &sequence,
        &ByColor { whole: true },
        &Copier::default(),
        &options,
        &stopped,
    );
    assert!(stopped.unwrap_err().is::<Stopped>());
}

#[test]
fn ground_truth_without_labels_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let mut sequence = sequence(folder.path());
    sequence
        .truth
        .values_mut()
        .for_each(|mask| *mask = RunMask::empty(SIZE.0, SIZE.1));
    let options = InteractOptions::default();
    let error = interact(
        &sequence,
        &ByColor { whole: true },
        &Copier::default(),
        &options,
        &Progress::default(),
    );
    assert!(error.unwrap_err().to_string().contains("no label"));
}

#[test]
fn jitter_is_determined_by_the_seed() {
    let folder = tempfile::tempdir().unwrap();
    let sequence = sequence(folder.path());
    let options = InteractOptions {
        jitter_px: 3.0,
        ..InteractOptions::default()
    };
    let play = || {
        let mut report = interact(
            &sequence,
            &ByColor { whole: true },
            &Copier::default(),
            &options,
            &Progress::default(),
        )
        .unwrap();
        report.seconds = 0.0;
        report
    };
    let report = play();
    assert_eq!(report, play());
    assert!(
        report.mean_iou >= 0.95 && report.failed_by_frame.clicks > 0,
        "{report:?}"
    );
    assert!(report.share_of_reclicking().unwrap() < 1.0, "{report:?}");
}
