use std::collections::BTreeMap;

use anyhow::{Context, Result};
use glam::DVec2;

use super::studio::Studio;
use crate::masks::{Click, LabelId, LabelMask, LabelTree, Prompt, next_label_click};
use crate::session::{Command, PromptRequest, TrackSettings};

/// Clicks that the simulated user may give per class over the whole sequence.
pub const MAX_CLICKS: usize = 8;

/// A class is left alone on a frame where its mask is this good.
const GOOD_IOU: f64 = 0.94;

/// Around a click that did not help the user does not click again.
const LEFT_ALONE_PX: f64 = 20.0;

/// A user who reads the truth only to place clicks where a person would: at the deepest point of the largest error.
pub(super) struct SimulatedUser {
    /// Exact masks in class ids of the project, by frame.
    truth: Vec<LabelMask>,
    classes: Vec<Class>,
    given: BTreeMap<(usize, LabelId), Vec<Click>>,
}

/// A class to be labelled.
struct Class {
    name: String,
    id: LabelId,
    clicks: usize,
}

impl SimulatedUser {
    /// Makes the classes of `tree` as labels of the open project, under the specimen as in the truth. `truth` holds a
    /// mask per frame in ids of `tree`.
    pub(super) fn new(
        studio: &mut Studio<'_, '_>,
        mut truth: Vec<LabelMask>,
        tree: &LabelTree,
        level: usize,
    ) -> Result<Self> {
        let mut classes = Vec::new();
        let mut in_project = BTreeMap::new();
        for label in tree.iter().filter(|label| tree.depth(label.id) <= level) {
            let parent = label.parent.and_then(|id| tree.get(id)).map(|parent| parent.name.clone());
            studio.act(Command::AddLabel { name: label.name.clone(), parent, color: Some(label.color) })?;
            if tree.depth(label.id) == level {
                let project = studio.session.project().context("no project is open")?;
                let id = project.labels.by_name(&label.name).context("the label was not made")?.id;
                in_project.insert(label.id, id);
                classes.push(Class { name: label.name.clone(), id, clicks: 0 });
            }
        }
        for id in truth.iter_mut().flat_map(|mask| &mut mask.ids) {
            *id = in_project.get(&tree.at_level(*id, level)).copied().unwrap_or(LabelId::NONE);
        }
        Ok(Self { truth, classes, given: BTreeMap::new() })
    }

    /// Clicks on one frame, once for each class nothing is there of, then always into the largest error, at most `most`
    /// times for each class; a click that made things worse is taken back (and counted), and the place left alone.
    pub(super) fn click_on(&mut self, studio: &mut Studio<'_, '_>, frame: usize, most: usize) -> Result<()> {
        let most: Vec<usize> = self.classes.iter().map(|class| MAX_CLICKS.min(class.clicks + most)).collect();
        let mut left_alone: Vec<Click> = Vec::new();
        loop {
            let ious = self.ious(studio, frame)?;
            let classes = self.classes.iter().zip(&most).zip(&ious);
            let open: Vec<(LabelId, f64)> = classes
                .filter(|((class, most), iou)| class.clicks < **most && **iou < GOOD_IOU)
                .map(|((class, _), iou)| (class.id, *iou))
                .collect();
            let new = open.iter().filter(|(id, iou)| *iou == 0.0 && !self.given.contains_key(&(frame, *id)));
            let new: Vec<LabelId> = new.map(|(id, _)| *id).collect();
            let open = if new.is_empty() { open.into_iter().map(|(id, _)| id).collect() } else { new };
            let seen = overlooking(&mask_of(studio, frame)?, &self.truth[frame], &left_alone);
            let Some((label, click)) = next_label_click(&self.truth[frame], &seen, &open) else { return Ok(()) };
            if !self.click(studio, frame, label, click)? {
                left_alone.push(click);
            }
        }
    }

    /// Carries the masks through the sequence.
    pub(super) fn track(studio: &mut Studio<'_, '_>) -> Result<()> {
        studio.act(Command::Track(TrackSettings {
            tracker: "geometry".into(),
            from: None,
            to: None,
            direction: crate::masks::Direction::Both,
            constrain: false,
        }))
    }

    /// The frame with the worst masks of classes for which clicks are left; `None` when all is good.
    pub(super) fn worst_frame(&self, studio: &Studio<'_, '_>) -> Result<Option<usize>> {
        let mut worst = (GOOD_IOU, None);
        for frame in 0..self.truth.len() {
            let ious = self.ious(studio, frame)?;
            let open = self.classes.iter().zip(ious).filter(|(class, _)| class.clicks < MAX_CLICKS);
            let ious: Vec<f64> = open.map(|(_, iou)| iou).collect();
            let mean = ious.iter().sum::<f64>() / ious.len() as f64;
            if mean < worst.0 {
                worst = (mean, Some(frame));
            }
        }
        Ok(worst.1)
    }

    /// Mean IoU over all frames, per class.
    pub(super) fn mean_ious(&self, studio: &Studio<'_, '_>) -> Result<BTreeMap<String, f64>> {
        let mut sums = vec![0.0; self.classes.len()];
        for frame in 0..self.truth.len() {
            sums.iter_mut().zip(self.ious(studio, frame)?).for_each(|(sum, iou)| *sum += iou);
        }
        let mean = |(class, sum): (&Class, f64)| (class.name.clone(), sum / self.truth.len().max(1) as f64);
        Ok(self.classes.iter().zip(sums).map(mean).collect())
    }

    /// Clicks given so far, per class.
    pub(super) fn clicks(&self) -> BTreeMap<String, usize> {
        self.classes.iter().map(|class| (class.name.clone(), class.clicks)).collect()
    }

    /// One click; returns whether it helped.
    fn click(&mut self, studio: &mut Studio<'_, '_>, frame: usize, label: LabelId, click: Click) -> Result<bool> {
        let before = self.ious(studio, frame)?;
        let clicks = self.given.entry((frame, label)).or_default();
        clicks.push(click);
        let prompt = Prompt { clicks: clicks.clone(), boxes: Vec::new() };
        self.classes.iter_mut().filter(|class| class.id == label).for_each(|class| class.clicks += 1);
        studio.act(Command::Prompt(PromptRequest { frame, label, prompt, segmenter: "builtin".into() }))?;
        if self.ious(studio, frame)?.iter().sum::<f64>() >= before.iter().sum::<f64>() {
            return Ok(true);
        }
        studio.act(Command::Undo)?;
        if let Some(clicks) = self.given.get_mut(&(frame, label)) {
            clicks.pop();
        }
        Ok(false)
    }

    /// IoU of each class on one frame.
    fn ious(&self, studio: &Studio<'_, '_>, frame: usize) -> Result<Vec<f64>> {
        let mask = mask_of(studio, frame)?;
        let iou = |class: &Class| {
            let (mut both, mut either) = (0_usize, 0_usize);
            for (&truth, &result) in self.truth[frame].ids.iter().zip(&mask.ids) {
                let (a, b) = (truth == class.id, result == class.id);
                both += usize::from(a && b);
                either += usize::from(a || b);
            }
            if either == 0 { 1.0 } else { both as f64 / either as f64 }
        };
        Ok(self.classes.iter().map(iou).collect())
    }
}

/// The mask with its errors around some places put right.
fn overlooking(mask: &LabelMask, truth: &LabelMask, places: &[Click]) -> LabelMask {
    let mut mask = mask.clone();
    let width = mask.width;
    for (at, (id, truth)) in mask.ids.iter_mut().zip(&truth.ids).enumerate() {
        let (x, y) = (at as u32 % width, at as u32 / width);
        let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        if places.iter().any(|place| place.at_px.distance(centre) < LEFT_ALONE_PX) {
            *id = *truth;
        }
    }
    mask
}

fn mask_of(studio: &Studio<'_, '_>, frame: usize) -> Result<LabelMask> {
    let project = studio.session.project().context("no project is open")?;
    let frame_size = &project.frames[frame];
    let mask = project.masks.get(&frame).map(|mask| mask.runs.decode());
    Ok(mask.unwrap_or_else(|| LabelMask::empty(frame_size.width, frame_size.height)))
}
