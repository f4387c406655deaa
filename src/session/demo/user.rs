use std::collections::BTreeMap;

use anyhow::{Context, Result};

use super::studio::Studio;
use crate::masks::{Click, LabelId, LabelMask, LabelTree, Prompt, next_click};
use crate::session::{Command, PromptRequest, TrackSettings};

/// Clicks that the simulated user may give per class over the whole sequence.
pub const MAX_CLICKS: usize = 8;

/// A class is left alone on a frame where its mask is this good.
const GOOD_IOU: f64 = 0.94;

/// A user who reads the truth only to place clicks where a person would: at the deepest point of the largest error.
pub(super) struct SimulatedUser<'t> {
    /// Exact masks in class ids of the truth, by frame.
    truth: &'t [LabelMask],
    classes: Vec<Class>,
    given: BTreeMap<(usize, LabelId), Vec<Click>>,
}

/// A class to be labelled.
struct Class {
    name: String,
    in_truth: LabelId,
    in_project: LabelId,
    clicks: usize,
}

impl<'t> SimulatedUser<'t> {
    /// Makes the classes of `tree` as labels of the open project, under the specimen as in the truth.
    pub(super) fn new(
        studio: &mut Studio<'_, '_>,
        truth: &'t [LabelMask],
        tree: &LabelTree,
        level: usize,
    ) -> Result<Self> {
        let mut classes = Vec::new();
        for label in tree.iter().filter(|label| tree.depth(label.id) <= level) {
            let parent = label.parent.and_then(|id| tree.get(id)).map(|parent| parent.name.clone());
            studio.act(Command::AddLabel { name: label.name.clone(), parent, color: Some(label.color) })?;
            if tree.depth(label.id) == level {
                let project = studio.session.project().context("no project is open")?;
                let made = project.labels.by_name(&label.name).context("the label was not made")?.id;
                classes.push(Class { name: label.name.clone(), in_truth: label.id, in_project: made, clicks: 0 });
            }
        }
        Ok(Self { truth, classes, given: BTreeMap::new() })
    }

    /// Clicks on one frame, always for the class with the largest wrong area there, each at most `most` times; a click
    /// that made things worse is taken back (and counted).
    pub(super) fn click_on(&mut self, studio: &mut Studio<'_, '_>, frame: usize, most: usize) -> Result<()> {
        let before: Vec<usize> = self.classes.iter().map(|class| class.clicks).collect();
        let mut given_up = vec![false; self.classes.len()];
        loop {
            let mut worst = (0, None);
            for (index, class) in self.classes.iter().enumerate() {
                let open = !given_up[index] && class.clicks < MAX_CLICKS.min(before[index] + most);
                let wrong = self.wrong_pixels(studio, frame, class)?;
                if open && self.iou(studio, frame, class)? < GOOD_IOU && wrong > worst.0 {
                    worst = (wrong, Some(index));
                }
            }
            let Some(index) = worst.1 else { return Ok(()) };
            given_up[index] = !self.click(studio, frame, index)?;
        }
    }

    /// Carries the masks through the sequence.
    pub(super) fn track(&self, studio: &mut Studio<'_, '_>) -> Result<()> {
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
        let mut worst = (f64::INFINITY, None);
        for frame in 0..self.truth.len() {
            let mut sum = 0.0;
            let open: Vec<&Class> = self.classes.iter().filter(|class| class.clicks < MAX_CLICKS).collect();
            for class in &open {
                sum += self.iou(studio, frame, class)?;
            }
            let mean = sum / open.len().max(1) as f64;
            if !open.is_empty() && mean < GOOD_IOU && mean < worst.0 {
                worst = (mean, Some(frame));
            }
        }
        Ok(worst.1)
    }

    /// Mean IoU over all frames, per class.
    pub(super) fn mean_ious(&self, studio: &Studio<'_, '_>) -> Result<BTreeMap<String, f64>> {
        let mut means = BTreeMap::new();
        for class in &self.classes {
            let mut sum = 0.0;
            for frame in 0..self.truth.len() {
                sum += self.iou(studio, frame, class)?;
            }
            means.insert(class.name.clone(), sum / self.truth.len().max(1) as f64);
        }
        Ok(means)
    }

    /// Clicks given so far, per class.
    pub(super) fn clicks(&self) -> BTreeMap<String, usize> {
        self.classes.iter().map(|class| (class.name.clone(), class.clicks)).collect()
    }

    /// One click; returns whether it helped.
    fn click(&mut self, studio: &mut Studio<'_, '_>, frame: usize, index: usize) -> Result<bool> {
        let class = &self.classes[index];
        let mask = mask_of(studio, frame)?;
        let truth = self.truth[frame].region(class.in_truth);
        let Some(click) = next_click(&truth, &mask.region(class.in_project)) else { return Ok(false) };
        let before = self.iou(studio, frame, class)?;
        let label = class.in_project;
        let clicks = self.given.entry((frame, label)).or_default();
        clicks.push(click);
        let prompt = Prompt { clicks: clicks.clone(), boxes: Vec::new() };
        self.classes[index].clicks += 1;
        studio.act(Command::Prompt(PromptRequest { frame, label, prompt, segmenter: "builtin".into() }))?;
        if self.iou(studio, frame, &self.classes[index])? < before {
            studio.act(Command::Undo)?;
            if let Some(clicks) = self.given.get_mut(&(frame, label)) {
                clicks.pop();
            }
            return Ok(false);
        }
        Ok(true)
    }

    fn wrong_pixels(&self, studio: &Studio<'_, '_>, frame: usize, class: &Class) -> Result<usize> {
        let mask = mask_of(studio, frame)?;
        let differs =
            |(&truth, &result): (&LabelId, &LabelId)| (truth == class.in_truth) != (result == class.in_project);
        Ok(self.truth[frame].ids.iter().zip(&mask.ids).filter(|&pair| differs(pair)).count())
    }

    fn iou(&self, studio: &Studio<'_, '_>, frame: usize, class: &Class) -> Result<f64> {
        let mask = mask_of(studio, frame)?;
        let (mut both, mut either) = (0_usize, 0_usize);
        for (&truth, &result) in self.truth[frame].ids.iter().zip(&mask.ids) {
            let (a, b) = (truth == class.in_truth, result == class.in_project);
            both += usize::from(a && b);
            either += usize::from(a || b);
        }
        Ok(if either == 0 { 1.0 } else { both as f64 / either as f64 })
    }
}

fn mask_of(studio: &Studio<'_, '_>, frame: usize) -> Result<LabelMask> {
    let project = studio.session.project().context("no project is open")?;
    let frame_size = &project.frames[frame];
    let mask = project.masks.get(&frame).map(|mask| mask.runs.decode());
    Ok(mask.unwrap_or_else(|| LabelMask::empty(frame_size.width, frame_size.height)))
}
