use ostra_project::{EngineName, SegmenterId};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use anyhow::Result;

use super::corrections::drawn;
use super::options::{Aim, Hand};
use super::outline::{DrawingTask, DrawnMask};
use super::{InteractOptions, Sequence};
use crate::simulated_click::next_label_click;
use ostra_core::job::Progress;
use ostra_masks::{Click, LabelId, LabelMask, RunMask, Segmenter, Tracker};
use ostra_project::mask_edits::{keyframe, mask_of};
use ostra_project::prompt::PromptMeaning;
use ostra_project::{Edit, LabelChoice, MaskOrigin, Project, PromptRequest};
use ostra_session::commands::{track_request, transferred};
use ostra_session::{PreparedFrames, TrackSettings};

/// Minimum IoU gain for a click to be effective.
const LEAST_GAIN: f64 = 0.01;

/// Clicks on a label during a visit.
#[derive(Clone, Copy, Default)]
struct VisitClicks {
    clicks: usize,
    /// Number of clicks since the last effective one.
    in_vain: usize,
    best_iou: f64,
}

impl VisitClicks {
    /// Records a click and the IoU after it.
    fn note(&mut self, iou: f64) {
        self.clicks += 1;
        self.in_vain = if iou >= self.best_iou + LEAST_GAIN {
            0
        } else {
            self.in_vain + 1
        };
        self.best_iou = self.best_iou.max(iou);
    }
}

/// Limits of the clicks on a label on a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clicks {
    /// IoU at which clicking ends, 0–1.
    pub good_iou: f64,
    /// Maximum number of clicks.
    pub most: usize,
}

impl Clicks {
    /// The label is only drawn.
    pub const NONE: Self = Self {
        good_iou: 0.0,
        most: 0,
    };
    /// One click, however good the label is.
    pub const ONE: Self = Self {
        good_iou: 1.0,
        most: 1,
    };

    /// Clicks until the label is good.
    #[must_use]
    pub fn of(options: &InteractOptions) -> Self {
        Self {
            good_iou: options.good_iou,
            most: options.visit_clicks,
        }
    }
}

/// The sequence that simulated users label, and what they label it with.
#[derive(Clone, Copy)]
pub struct LabellingSetup<'a> {
    /// The sequence with its ground truth.
    pub sequence: &'a Sequence,
    /// The segmenter that answers clicks.
    pub segmenter: &'a dyn Segmenter,
    /// The frames prepared for the segmenter.
    pub prepared: &'a PreparedFrames,
    /// The progress of the job.
    pub progress: &'a Progress,
    /// The options of the simulation.
    pub options: &'a InteractOptions,
}

/// A simulated user who reads the ground truth to decide where to click and what to draw.
///
/// Clicks go to the deepest point of the largest error; labels that clicks do not improve are
/// drawn. The project is in memory. Clicks are answered and masks are tracked as in a session.
pub struct RobotUser<'a> {
    setup: LabellingSetup<'a>,
    annotator: Hand,
    project: Project,
    clicks: usize,
    corners: usize,
    most_clicks: usize,
}

impl<'a> RobotUser<'a> {
    /// Creates a user for a sequence without masks, with at most `most_clicks` clicks.
    ///
    /// The jitter of the clicks depends on `turn`.
    pub fn new(setup: LabellingSetup<'a>, turn: u64, most_clicks: usize) -> Self {
        Self {
            setup,
            annotator: Hand::new(setup.options, turn),
            project: setup.sequence.project(),
            clicks: 0,
            corners: 0,
            most_clicks,
        }
    }

    /// Returns the number of clicks so far, including undone clicks, corners and border drags.
    pub fn clicks(&self) -> usize {
        self.clicks
    }

    /// Returns how many of the clicks are corners of outlines or border drags.
    pub fn corners(&self) -> usize {
        self.corners
    }

    /// Returns whether no clicks are left.
    pub fn is_spent(&self) -> bool {
        self.clicks >= self.most_clicks
    }

    /// Clicks and draws on a frame; returns whether its mean IoU has increased.
    ///
    /// First, each label of `labels` that is not on the frame yet gets one click. Then clicks go to
    /// the largest error of the labels that still need clicks. A label is skipped after several
    /// clicks in a row without effect. The best state is kept; later clicks are undone but counted.
    /// Finally, drawings that pay for `aim` are made.
    pub fn visit(
        &mut self,
        frame: usize,
        labels: &BTreeMap<LabelId, Clicks>,
        aim: &Aim,
    ) -> Result<bool> {
        let truth = self.setup.sequence.truth_of(frame)?.decode();
        let was = self.frame_iou(frame)?;
        let mut best = (was, self.project.clone());
        let mut given: BTreeMap<LabelId, VisitClicks> = BTreeMap::new();
        while !self.is_spent() {
            let ious = self.ious(frame)?;
            let is_open = |(id, requested): &(&LabelId, &Clicks)| {
                let so_far: VisitClicks = given.get(id).copied().unwrap_or_default();
                let is_poor = ious.get(id).is_some_and(|&iou| iou < requested.good_iou);
                is_poor
                    && so_far.clicks < requested.most
                    && so_far.in_vain < self.setup.options.patience
            };
            let open: Vec<LabelId> = labels.iter().filter(is_open).map(|(&id, _)| id).collect();
            let mask = mask_of(&self.project, frame)?;
            let is_new = |id: &LabelId| !given.contains_key(id) && !mask.ids.contains(id);
            let new: Vec<LabelId> = open.iter().copied().filter(is_new).collect();
            let next = next_label_click(&truth, &mask, if new.is_empty() { &open } else { &new });
            let Some(next) = next else { break };
            let click = self.annotator.place(&next, &truth, &mask);
            self.click(frame, next.label, click)?;
            let now = self.ious(frame)?.get(&next.label).copied().unwrap_or(0.0);
            let before = VisitClicks {
                best_iou: ious.get(&next.label).copied().unwrap_or(0.0),
                ..VisitClicks::default()
            };
            given.entry(next.label).or_insert(before).note(now);
            let iou = self.frame_iou(frame)?;
            if iou > best.0 {
                best = (iou, self.project.clone());
            }
        }
        self.project = best.1;
        for &label in labels.keys() {
            self.draw(frame, label, &truth, aim)?;
        }
        Ok(self.frame_iou(frame)? > was)
    }

    /// Draws a label on a frame if that pays and enough clicks are left.
    ///
    /// The IoU that other labels lose is subtracted from the gain.
    fn draw(&mut self, frame: usize, label: LabelId, truth: &LabelMask, aim: &Aim) -> Result<()> {
        let before = self.ious(frame)?;
        if self.is_spent() || !before.contains_key(&label) {
            return Ok(());
        }
        let sequence = self.setup.sequence;
        let of_truth = sequence.truth_of(frame)?;
        let iou = |mask: &LabelMask| {
            let ious = of_truth.ious(&RunMask::encode(mask));
            let now = |id: &LabelId| ious.get(id).copied().unwrap_or(1.0);
            let lost = before
                .iter()
                .filter(|(id, _)| **id != label)
                .map(|(id, was)| was - now(id))
                .sum::<f64>();
            now(&label) - lost.max(0.0)
        };
        let mask = mask_of(&self.project, frame)?;
        let drawn = drawn(&DrawingTask {
            truth,
            mask: &mask,
            label,
            tree: &sequence.labels,
            iou: &iou,
            aim,
        })?;
        let affordable = self.most_clicks - self.clicks;
        let Some(DrawnMask { mask, corners }) = drawn.filter(|drawn| drawn.corners <= affordable)
        else {
            return Ok(());
        };
        self.project.apply(Edit::SetMask {
            frame,
            mask: Some(keyframe(&mask)),
        })?;
        self.clicks += corners;
        self.corners += corners;
        Ok(())
    }

    /// Tracks the masks of all keyframes to all frames.
    pub fn track(&mut self, tracker: &dyn Tracker) -> Result<()> {
        self.track_with(tracker, &TrackSettings::default())
    }

    /// Tracks labels again between the keyframes next to a corrected frame.
    ///
    /// Nothing happens if there is no frame between them. Other labels are overwritten if they
    /// cover most of the missed pixels.
    pub fn retrack(
        &mut self,
        tracker: &dyn Tracker,
        frame: usize,
        labels: &[LabelId],
    ) -> Result<()> {
        let settings = TrackSettings {
            labels: labels.to_vec(),
            ..TrackSettings::default()
        };
        let Ok(settings) = settings.around(&self.project, frame) else {
            return Ok(());
        };
        let replace = self.is_overrun(&settings);
        self.track_with(
            tracker,
            &TrackSettings {
                replace,
                ..settings
            },
        )
    }

    /// Returns whether other labels cover most pixels that the labels miss in a range of frames.
    fn is_overrun(&self, settings: &TrackSettings) -> bool {
        let labels = &settings.labels;
        let range = settings.from.unwrap_or(0)..=settings.to.unwrap_or(usize::MAX);
        let (mut missed, mut held) = (0, 0);
        for (frame, truth) in self.setup.sequence.truth.range(range) {
            let tracked = self
                .project
                .masks
                .get(frame)
                .filter(|mask| mask.origin != MaskOrigin::Keyframe);
            for (truth, is, pixels) in tracked
                .into_iter()
                .flat_map(|mask| truth.joint_runs(&mask.runs))
            {
                if truth != is && labels.contains(&truth) {
                    missed += pixels;
                    held += if is == LabelId::NONE || labels.contains(&is) {
                        0
                    } else {
                        pixels
                    };
                }
            }
        }
        2 * held > missed
    }

    fn track_with(&mut self, tracker: &dyn Tracker, settings: &TrackSettings) -> Result<()> {
        let request = track_request(&self.project, &self.setup.sequence.store, settings)?;
        let mut tracked = Vec::new();
        tracker.track(
            &request,
            &mut |answer| tracked.push(transferred(answer)),
            self.setup.progress,
        )?;
        let choice = LabelChoice::new(&settings.labels, settings.replace);
        for (frame, mask) in tracked {
            if let Some(edit) = choice.edit(&self.project, frame, mask) {
                self.project.apply(edit)?;
            }
        }
        Ok(())
    }

    /// Clicks for a label on a frame, which becomes a keyframe.
    fn click(&mut self, frame: usize, label: LabelId, click: Click) -> Result<()> {
        self.setup.progress.check()?;
        let mut prompt = self
            .project
            .prompts
            .get(&(frame, label))
            .cloned()
            .unwrap_or_default();
        prompt.clicks.push(click);
        let segmenter = SegmenterId::from_name(self.setup.segmenter.name()).unwrap_or_default();
        let request = PromptRequest {
            frame,
            label,
            prompt,
            segmenter,
        };
        let meaning = PromptMeaning::new(&self.project, &request)?;
        let of = self.project.frame(frame)?;
        let ready = self.setup.prepared.get(
            self.setup.segmenter,
            of,
            &self.setup.sequence.store,
            self.setup.progress,
        )?;
        let image = self.setup.sequence.store.image(of)?;
        let region = meaning.segment(ready.as_ref(), &image, self.setup.progress)?;
        for edit in meaning.edits(&self.project, &region)? {
            self.project.apply(edit)?;
        }
        self.clicks += 1;
        Ok(())
    }

    /// Returns the IoU of each label in the ground truth or the result of a frame.
    pub fn ious(&self, frame: usize) -> Result<BTreeMap<LabelId, f64>> {
        let truth = self.setup.sequence.truth_of(frame)?;
        let nothing = || Arc::new(RunMask::empty(truth.width, truth.height));
        let result = self
            .project
            .masks
            .get(&frame)
            .map_or_else(nothing, |mask| Arc::clone(&mask.runs));
        Ok(truth.ious(&result))
    }

    /// Returns the IoU of each label on each frame with the label in ground truth or result.
    pub fn ious_by_label(&self) -> Result<IousByLabel> {
        by_label(
            self.setup
                .sequence
                .truth
                .keys()
                .map(|&frame| Ok((frame, self.ious(frame)?))),
        )
    }

    /// Returns the mean IoU over the sequence ([`mean_over_labels`]).
    pub fn mean_iou(&self) -> Result<f64> {
        Ok(mean_over_labels(self.ious_by_label()?))
    }

    /// Returns the keyframes.
    pub fn keyframes(&self) -> BTreeSet<usize> {
        let keyframes = self
            .project
            .masks
            .iter()
            .filter(|(_, mask)| mask.origin == MaskOrigin::Keyframe);
        keyframes.map(|(&frame, _)| frame).collect()
    }

    /// Returns the mean IoU over the labels in the ground truth or the result of a frame.
    fn frame_iou(&self, frame: usize) -> Result<f64> {
        Ok(mean(self.ious(frame)?.into_values()))
    }
}

/// Groups the IoUs of frames by label.
pub(super) fn by_label(
    frames: impl Iterator<Item = Result<(usize, BTreeMap<LabelId, f64>)>>,
) -> Result<IousByLabel> {
    let mut all = IousByLabel::new();
    for of_frame in frames {
        let (frame, ious) = of_frame?;
        for (label, iou) in ious {
            all.entry(label).or_default().insert(frame, iou);
        }
    }
    Ok(all)
}

/// Returns the mean over labels of the mean over their frames.
pub(super) fn mean_over_labels(ious: IousByLabel) -> f64 {
    mean(ious.into_values().map(|of| mean(of.into_values())))
}

/// Returns the mean, or 1 without values, since nothing is wrong then.
fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values
        .into_iter()
        .fold((0.0, 0_usize), |(sum, count), value| {
            (sum + value, count + 1)
        });
    if count == 0 { 1.0 } else { sum / count as f64 }
}

/// IoU per label and frame, for frames with the label in ground truth or result.
pub type IousByLabel = BTreeMap<LabelId, BTreeMap<usize, f64>>;
