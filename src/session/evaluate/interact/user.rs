use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use anyhow::Result;

use super::Sequence;
use crate::engine::job::Progress;
use crate::masks::{Click, LabelClick, LabelId, RunMask, Segmenter, Tracker, next_label_click};
use crate::session::commands::{LabelChoice, anchor, answer, carried, mask_of, track_request, with_answer};
use crate::session::prepared::PreparedFrames;
use crate::session::{Edit, Project, PromptRequest, TrackSettings};

/// A user who reads the truth only to see where to click: at the deepest point of the largest error. The project that
/// is clicked on lives in memory; clicks are answered, and masks tracked, as in a session.
pub struct RobotUser<'a> {
    sequence: &'a Sequence,
    segmenter: &'a dyn Segmenter,
    prepared: &'a PreparedFrames,
    progress: &'a Progress,
    project: Project,
    clicks: usize,
    most_clicks: usize,
}

impl<'a> RobotUser<'a> {
    /// A user before a sequence without masks, who gives `most_clicks` at most.
    pub fn new(
        sequence: &'a Sequence,
        segmenter: &'a dyn Segmenter,
        prepared: &'a PreparedFrames,
        progress: &'a Progress,
        most_clicks: usize,
    ) -> Self {
        Self { sequence, segmenter, prepared, progress, project: sequence.project(), clicks: 0, most_clicks }
    }

    /// Clicks given so far; those taken back count.
    pub fn clicks(&self) -> usize {
        self.clicks
    }

    /// Whether no click is left.
    pub fn is_spent(&self) -> bool {
        self.clicks >= self.most_clicks
    }

    /// Clicks on a frame, once for each of `labels` that it does not show yet, then always into the largest error of
    /// those whose IoU is below `good_iou`, at most `most` times for each. The best that was reached on the way stands,
    /// the clicks after it are taken back (and count). Says whether the frame is better than before.
    pub fn visit(&mut self, frame: usize, labels: &[LabelId], good_iou: f64, most: usize) -> Result<bool> {
        let truth = self.sequence.truth_of(frame)?.decode();
        let was = self.frame_iou(frame)?;
        let mut best = (was, self.project.clone());
        let mut given: BTreeMap<LabelId, usize> = BTreeMap::new();
        while !self.is_spent() {
            let ious = self.ious(frame)?;
            let is_poor = |id: &LabelId| ious.get(id).is_some_and(|&iou| iou < good_iou);
            let is_open = |id: &LabelId| is_poor(id) && given.get(id).is_none_or(|&clicks| clicks < most);
            let open: Vec<LabelId> = labels.iter().copied().filter(is_open).collect();
            let mask = mask_of(&self.project, frame)?;
            let is_new = |id: &LabelId| !given.contains_key(id) && !mask.ids.contains(id);
            let new: Vec<LabelId> = open.iter().copied().filter(is_new).collect();
            let next = next_label_click(&truth, &mask, if new.is_empty() { &open } else { &new });
            let Some(LabelClick { label, click, .. }) = next else { break };
            self.click(frame, label, click)?;
            *given.entry(label).or_default() += 1;
            let iou = self.frame_iou(frame)?;
            if iou > best.0 {
                best = (iou, self.project.clone());
            }
        }
        self.project = best.1;
        Ok(best.0 > was)
    }

    /// Carries the masks of all anchors to all frames.
    pub fn track(&mut self, tracker: &dyn Tracker) -> Result<()> {
        self.track_with(tracker, &TrackSettings::default())
    }

    /// Carries one label anew between the anchors next to a corrected frame, where there is a frame between them.
    pub fn retrack(&mut self, tracker: &dyn Tracker, frame: usize, label: LabelId) -> Result<()> {
        let settings = TrackSettings { labels: vec![label], ..TrackSettings::default() };
        match settings.around(&self.project, frame) {
            Ok(settings) => self.track_with(tracker, &settings),
            Err(_) => Ok(()),
        }
    }

    fn track_with(&mut self, tracker: &dyn Tracker, settings: &TrackSettings) -> Result<()> {
        let request = track_request(&self.project, &self.sequence.store, settings)?;
        let mut tracked = Vec::new();
        tracker.track(&request, &mut |answer| tracked.push(carried(answer)), self.progress)?;
        let choice = LabelChoice::new(settings);
        for (frame, mask) in tracked {
            if let Some(edit) = choice.edit(&self.project, frame, mask) {
                self.project.apply(edit)?;
            }
        }
        Ok(())
    }

    /// One click for a label on a frame, which becomes an anchor.
    fn click(&mut self, frame: usize, label: LabelId, click: Click) -> Result<()> {
        self.progress.check()?;
        let mut prompt = self.project.prompts.get(&(frame, label)).cloned().unwrap_or_default();
        prompt.clicks.push(click);
        let segmenter = self.segmenter.name().to_owned();
        let request = PromptRequest { frame, label, prompt: prompt.clone(), segmenter };
        let of = self.project.frame(frame)?;
        let ready = self.prepared.get(self.segmenter, of, &self.sequence.store, self.progress)?;
        let region = answer(ready.as_ref(), &self.project, &request)?;
        let mask = with_answer(&self.project, &request, &region)?;
        self.project.apply(Edit::SetPrompt { frame, label, prompt: Some(prompt) })?;
        self.project.apply(Edit::SetMask { frame, mask: Some(anchor(&mask)) })?;
        self.clicks += 1;
        Ok(())
    }

    /// IoU of each label that truth or result shows on a frame.
    pub fn ious(&self, frame: usize) -> Result<BTreeMap<LabelId, f64>> {
        let truth = self.sequence.truth_of(frame)?;
        let nothing = || Arc::new(RunMask::empty(truth.width, truth.height));
        let result = self.project.masks.get(&frame).map_or_else(nothing, |mask| Arc::clone(&mask.runs));
        Ok(truth.ious(&result))
    }

    /// Mean over labels of the mean over the frames on which truth or result shows the label.
    pub fn mean_iou(&self) -> Result<f64> {
        let mut of_label: BTreeMap<LabelId, Vec<f64>> = BTreeMap::new();
        for &frame in self.sequence.truth.keys() {
            for (label, iou) in self.ious(frame)? {
                of_label.entry(label).or_default().push(iou);
            }
        }
        Ok(mean(of_label.into_values().map(mean)))
    }

    /// The frame and label with the lowest IoU below 1, and that IoU; those in `left_alone` are passed over.
    pub fn worst(&self, left_alone: &BTreeSet<(usize, LabelId)>) -> Result<Option<(usize, LabelId, f64)>> {
        let mut worst: Option<(usize, LabelId, f64)> = None;
        for &frame in self.sequence.truth.keys() {
            for (label, iou) in self.ious(frame)? {
                let is_worse = iou < worst.map_or(1.0, |(_, _, least)| least);
                if is_worse && !left_alone.contains(&(frame, label)) {
                    worst = Some((frame, label, iou));
                }
            }
        }
        Ok(worst)
    }

    /// Mean IoU over the labels that truth or result shows on a frame.
    fn frame_iou(&self, frame: usize) -> Result<f64> {
        Ok(mean(self.ious(frame)?.into_values()))
    }
}

/// 1 of nothing: there is nothing wrong.
fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    if count == 0 { 1.0 } else { sum / count as f64 }
}
