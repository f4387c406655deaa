use ostra_project::{SegmenterId, TrackerId};
use std::collections::BTreeMap;
use std::ops::ControlFlow;

use anyhow::{Context, Result, anyhow};
use glam::DVec2;

use crate::simulated_click::{LabelClick, next_label_click};
use ostra_core::job::Stopped;
use ostra_masks::{Click, LabelId, LabelMask, LabelTree, Prompt};
use ostra_session::{Command, Event, JobView, PromptRequest, Session, TrackSettings};

/// Maximum number of clicks per class over the whole sequence.
///
/// For a class that is split into instances later, this is the number per instance.
pub const MAX_CLICKS: usize = 8;

/// Minimum size of an error that is worth a click, in pixels.
const LEAST_WRONG_PX: usize = 12;

/// Radius around a click that did not help, where the user does not click again, in pixels.
const LEFT_ALONE_PX: f64 = 20.0;

/// A simulated user who clicks at the deepest point of the largest error.
///
/// The ground truth is read only to place clicks where a person would.
pub(super) struct SimulatedUser {
    /// Exact masks by frame, with the class ids of the project.
    truth: Vec<LabelMask>,
    classes: Vec<Class>,
    given: BTreeMap<(usize, LabelId), Vec<Click>>,
    /// Frames and clicks that did not help.
    left_alone: Vec<(usize, Click)>,
}

/// A class that is labelled.
struct Class {
    name: String,
    id: LabelId,
    /// Number of instances that are split later; otherwise 1.
    things: usize,
    clicks: usize,
}

impl Class {
    /// Returns the maximum number of clicks in total.
    fn most(&self) -> usize {
        MAX_CLICKS * self.things
    }
}

impl SimulatedUser {
    /// Adds the labels `clicked` of `tree` and their ancestors to the open project.
    ///
    /// `truth` has a mask per frame in ids of `tree`; descendants of a clicked label count as that
    /// label. The instances of the classes `separated` are clicked one by one.
    pub(super) fn new(
        studio: &mut DemoDriver<'_, '_>,
        mut truth: Vec<LabelMask>,
        tree: &LabelTree,
        clicked: &[LabelId],
        separated: &[String],
    ) -> Result<Self> {
        let mut classes = Vec::new();
        let mut in_project = BTreeMap::new();
        let is_wanted = |id: LabelId| clicked.iter().any(|&below| tree.path(below).contains(&id));
        for label in tree.iter().filter(|label| is_wanted(label.id)) {
            let parent = label
                .parent
                .and_then(|id| tree.get(id))
                .map(|parent| parent.name.clone());
            studio.act(Command::AddLabel {
                name: label.name.clone(),
                parent,
                color: Some(label.color),
            })?;
            if clicked.contains(&label.id) {
                let project = studio.session.project().context("no project is open")?;
                let id = project
                    .labels
                    .by_name(&label.name)
                    .context("the label was not made")?
                    .id;
                in_project.insert(label.id, id);
                let has_instances = separated.contains(&label.name);
                let things = if has_instances {
                    tree.children(Some(label.id)).count().max(1)
                } else {
                    1
                };
                classes.push(Class {
                    name: label.name.clone(),
                    id,
                    things,
                    clicks: 0,
                });
            }
        }
        let found = |id: LabelId| {
            tree.path(id)
                .iter()
                .find_map(|above| in_project.get(above))
                .copied()
        };
        let of_id: Vec<LabelId> = (0..tree.next_id().0)
            .map(|id| found(LabelId(id)).unwrap_or_default())
            .collect();
        for id in truth.iter_mut().flat_map(|mask| &mut mask.ids) {
            *id = of_id[usize::from(id.0)];
        }
        Ok(Self {
            truth,
            classes,
            given: BTreeMap::new(),
            left_alone: Vec::new(),
        })
    }

    /// Clicks on one frame, at most `most` times per class.
    ///
    /// For classes that are split into instances, the limit is per instance. First, each class
    /// without pixels on the frame gets one click; further clicks go to the largest error. A click
    /// that made things worse is undone (but counted), and its surroundings are left alone.
    pub(super) fn click_on(
        &mut self,
        studio: &mut DemoDriver<'_, '_>,
        frame: usize,
        most: usize,
    ) -> Result<()> {
        let most: Vec<usize> = self
            .classes
            .iter()
            .map(|class| class.most().min(class.clicks + most * class.things))
            .collect();
        loop {
            let classes = self.classes.iter().zip(&most);
            let open: Vec<LabelId> = classes
                .filter(|(class, most)| class.clicks < **most)
                .map(|(class, _)| class.id)
                .collect();
            let Some(next) = self.next_click(studio, frame, &open)? else {
                return Ok(());
            };
            if !self.click(studio, frame, next.label, next.click)? {
                self.left_alone.push((frame, next.click));
            }
        }
    }

    /// Returns the frame that shows most of the classes, relative to the maximum area of each.
    pub(super) fn clearest_frame(&self) -> usize {
        let area = |frame: usize, class: &Class| self.truth[frame].region(class.id).area() as f64;
        let mut shown = vec![0.0; self.truth.len()];
        for class in &self.classes {
            let areas: Vec<f64> = (0..self.truth.len())
                .map(|frame| area(frame, class))
                .collect();
            let most = areas.iter().copied().fold(1.0, f64::max);
            shown
                .iter_mut()
                .zip(areas)
                .for_each(|(shown, area)| *shown += area / most);
        }
        (0..shown.len())
            .rev()
            .max_by(|&a, &b| shown[a].total_cmp(&shown[b]))
            .unwrap_or(0)
    }

    /// Returns the frame with the largest error for which clicks are left; `None` if there is none.
    pub(super) fn worst_frame(&self, studio: &DemoDriver<'_, '_>) -> Result<Option<usize>> {
        let open: Vec<LabelId> = self
            .classes
            .iter()
            .filter(|class| class.clicks < class.most())
            .map(|class| class.id)
            .collect();
        let mut worst = (0, None);
        for frame in 0..self.truth.len() {
            let wrong_px = self
                .next_click(studio, frame, &open)?
                .map_or(0, |next| next.wrong_px);
            if wrong_px > worst.0 {
                worst = (wrong_px, Some(frame));
            }
        }
        Ok(worst.1)
    }

    /// Returns the next click on a frame for one of `open`, if an error is large enough.
    fn next_click(
        &self,
        studio: &DemoDriver<'_, '_>,
        frame: usize,
        open: &[LabelId],
    ) -> Result<Option<LabelClick>> {
        let mask = mask_of(studio, frame)?;
        let is_new =
            |id: &&LabelId| !mask.ids.contains(id) && !self.given.contains_key(&(frame, **id));
        let new: Vec<LabelId> = open.iter().filter(is_new).copied().collect();
        let open = if new.is_empty() { open } else { &new };
        let left_alone = self
            .left_alone
            .iter()
            .filter(|(of, _)| *of == frame)
            .map(|(_, click)| click);
        let seen = overlooking(&mask, &self.truth[frame], &left_alone.collect::<Vec<_>>());
        let next = next_label_click(&self.truth[frame], &seen, open);
        Ok(next.filter(|next| next.wrong_px >= LEAST_WRONG_PX))
    }

    /// Tracks the masks through the sequence.
    pub(super) fn track(studio: &mut DemoDriver<'_, '_>) -> Result<()> {
        studio.act(Command::Track(TrackSettings {
            tracker: TrackerId::Geometry,
            ..TrackSettings::default()
        }))
    }

    /// Returns the mean IoU over all frames per class; descendants count as the class.
    pub(super) fn mean_ious(&self, studio: &DemoDriver<'_, '_>) -> Result<BTreeMap<String, f64>> {
        let mut sums = vec![0.0; self.classes.len()];
        for frame in 0..self.truth.len() {
            sums.iter_mut()
                .zip(self.ious(studio, frame)?)
                .for_each(|(sum, iou)| *sum += iou);
        }
        let mean = |(class, sum): (&Class, f64)| {
            (class.name.clone(), sum / self.truth.len().max(1) as f64)
        };
        Ok(self.classes.iter().zip(sums).map(mean).collect())
    }

    /// Returns the number of clicks so far, per class.
    pub(super) fn clicks(&self) -> BTreeMap<String, usize> {
        self.classes
            .iter()
            .map(|class| (class.name.clone(), class.clicks))
            .collect()
    }

    /// Clicks once; returns whether it helped.
    fn click(
        &mut self,
        studio: &mut DemoDriver<'_, '_>,
        frame: usize,
        label: LabelId,
        click: Click,
    ) -> Result<bool> {
        let before = self.ious(studio, frame)?;
        let clicks = self.given.entry((frame, label)).or_default();
        clicks.push(click);
        let prompt = Prompt {
            clicks: clicks.clone(),
            ..Prompt::default()
        };
        self.classes
            .iter_mut()
            .filter(|class| class.id == label)
            .for_each(|class| class.clicks += 1);
        studio.act(Command::Prompt(PromptRequest {
            frame,
            label,
            prompt,
            segmenter: SegmenterId::Builtin,
        }))?;
        // A click that changes nothing makes no step.
        let project = studio.session.project();
        let stored = project.and_then(|project| project.prompts.get(&(frame, label)));
        let is_taken = stored.is_some_and(|prompt| prompt.clicks.last() == Some(&click));
        if is_taken {
            if self.ious(studio, frame)?.iter().sum::<f64>() >= before.iter().sum::<f64>() {
                return Ok(true);
            }
            studio.act(Command::Undo)?;
        }
        if let Some(clicks) = self.given.get_mut(&(frame, label)) {
            clicks.pop();
        }
        Ok(false)
    }

    /// Returns the IoU of each class on one frame.
    fn ious(&self, studio: &DemoDriver<'_, '_>, frame: usize) -> Result<Vec<f64>> {
        let mask = mask_of(studio, frame)?;
        let tree = &studio
            .session
            .project()
            .context("no project is open")?
            .labels;
        let iou = |class: &Class| {
            let is_below = |id: &LabelId| tree.path(*id).contains(&class.id);
            let of_class: Vec<LabelId> =
                tree.iter().map(|label| label.id).filter(is_below).collect();
            let (mut both, mut either) = (0_usize, 0_usize);
            for (&truth, &result) in self.truth[frame].ids.iter().zip(&mask.ids) {
                let (a, b) = (truth == class.id, of_class.contains(&result));
                both += usize::from(a && b);
                either += usize::from(a || b);
            }
            if either == 0 {
                1.0
            } else {
                both as f64 / either as f64
            }
        };
        Ok(self.classes.iter().map(iou).collect())
    }
}

/// Returns the mask with the errors around some clicks corrected.
fn overlooking(mask: &LabelMask, truth: &LabelMask, places: &[&Click]) -> LabelMask {
    let mut mask = mask.clone();
    let width = mask.width;
    for (at, (id, truth)) in mask.ids.iter_mut().zip(&truth.ids).enumerate() {
        let (x, y) = (at as u32 % width, at as u32 / width);
        let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        if places
            .iter()
            .any(|place| place.at_px.distance(centre) < LEFT_ALONE_PX)
        {
            *id = *truth;
        }
    }
    mask
}

fn mask_of(studio: &DemoDriver<'_, '_>, frame: usize) -> Result<LabelMask> {
    let project = studio.session.project().context("no project is open")?;
    let frame_size = &project.frames[frame];
    let mask = project.masks.get(&frame).map(|mask| mask.runs.decode());
    Ok(mask.unwrap_or_else(|| LabelMask::empty(frame_size.width, frame_size.height)))
}

/// Callback that receives the running jobs about twenty times a second; `Break` stops the demo.
pub type ProgressSink<'w> = dyn FnMut(&[JobView]) -> ControlFlow<()> + 'w;

/// A session that runs commands one after another.
pub(super) struct DemoDriver<'s, 'w> {
    pub session: &'s mut Session,
    watch: &'s mut ProgressSink<'w>,
    /// Warnings of the session.
    pub warnings: Vec<String>,
}

impl<'s, 'w> DemoDriver<'s, 'w> {
    pub(super) fn new(session: &'s mut Session, watch: &'s mut ProgressSink<'w>) -> Self {
        Self {
            session,
            watch,
            warnings: Vec::new(),
        }
    }

    /// Runs a command until it is complete.
    pub(super) fn act(&mut self, command: Command) -> Result<()> {
        self.session.act(command)?;
        for event in self.session.settle(&mut *self.watch) {
            match event {
                Event::Failed { error, .. } => return Err(anyhow!(error)),
                Event::Stopped { .. } => return Err(Stopped.into()),
                Event::Warning(text) => self.warnings.push(text),
                _ => {}
            }
        }
        Ok(())
    }
}
