use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use anyhow::{Context, Result};

use super::choose::{Worth, most_worth};
use super::outline::Aim;
use super::user::{Clicks, RobotUser};
use super::{FrameByFrame, Goal, InteractOptions, InteractReport, Sequence};
use crate::engine::job::Progress;
use crate::masks::{LabelId, Segmenter, Tracker};
use crate::session::prepared::PreparedFrames;

/// Bytes of frames made ready for clicks.
const PREPARED_BYTES: usize = 256 << 20;

/// Plays a robot user who labels the first frame that shows anything, tracks, and then corrects where most is amiss,
/// which is carried anew up to the neighbouring anchors, until the sequence is good enough or twice as much work as clicking
/// every frame from nothing, which is counted first. A label that a visit left below [`InteractOptions::good_iou`], or did not
/// better, is left alone on that frame.
///
/// # Errors
/// When the truth shows no label, a frame cannot be read, segmenter or tracker fails, or on a stop.
pub fn interact(
    sequence: &Sequence,
    segmenter: &dyn Segmenter,
    tracker: &dyn Tracker,
    options: &InteractOptions,
    progress: &Progress,
) -> Result<InteractReport> {
    let first = sequence.truth.keys().copied().find(|&frame| !sequence.shown_on(frame).is_empty());
    let first = first.context("the true masks show no label; give masks that do")?;
    let alone = frame_by_frame(sequence, segmenter, options, progress)?;
    let begun = Instant::now();
    let prepared = PreparedFrames::new(PREPARED_BYTES);
    let most_clicks = 2 * alone.values().map(|alone| alone.clicks).sum::<usize>();
    let user = RobotUser::new(sequence, segmenter, &prepared, progress, options, 0, most_clicks);
    let mut game = Game::new(user, tracker, options);
    progress.stage("click")?;
    let failed = game.begin(first, &sequence.shown_on(first))?;
    while game.mean_iou < options.enough_iou && !game.user.is_spent() {
        progress.stage("click")?;
        progress.step(game.user.clicks(), most_clicks)?;
        let Some(worth) = game.next()? else { break };
        game.correct(worth)?;
    }
    game.corrected.remove(&first);
    let seconds = begun.elapsed().as_secs_f64();
    Ok(InteractReport {
        segmenter: segmenter.name().to_owned(),
        tracker: tracker.name().to_owned(),
        frames: sequence.truth.len(),
        labels: sequence.shown().len(),
        reached: game.goals.to_vec(),
        mean_iou: game.mean_iou,
        clicks: game.user.clicks(),
        corners: game.user.corners(),
        corrected: game.corrected.len(),
        seconds,
        frame_by_frame: alone.values().copied().sum(),
        failed_by_frame: failed.iter().filter_map(|frame| alone.get(frame)).copied().sum(),
    })
}

/// The work of one robot user with a tracker.
struct Game<'a> {
    user: RobotUser<'a>,
    tracker: &'a dyn Tracker,
    options: &'a InteractOptions,
    goals: [Goal; 3],
    mean_iou: f64,
    corrected: BTreeSet<usize>,
    aim: Aim,
    /// Labels on frames for which nothing more pays.
    left_alone: BTreeSet<(usize, LabelId)>,
    /// Labels on frames that were left alone once: they are no longer clicked on, only drawn.
    clicked_out: BTreeSet<(usize, LabelId)>,
}

impl<'a> Game<'a> {
    fn new(user: RobotUser<'a>, tracker: &'a dyn Tracker, options: &'a InteractOptions) -> Self {
        let goals = InteractReport::GOALS.map(|mean_iou| Goal { mean_iou, clicks: None });
        Self {
            user,
            tracker,
            options,
            goals,
            mean_iou: 0.0,
            corrected: BTreeSet::new(),
            aim: Aim::paying(options),
            left_alone: BTreeSet::new(),
            clicked_out: BTreeSet::new(),
        }
    }

    /// Labels a frame and tracks it; gives the frames on which that left a label below the IoU at which it is good.
    fn begin(&mut self, frame: usize, labels: &[LabelId]) -> Result<BTreeSet<usize>> {
        self.user.visit(frame, labels, Clicks::of(self.options), &self.aim)?;
        self.user.track(self.tracker)?;
        self.note()?;
        let ious = self.user.ious_by_label()?;
        let poor = ious.values().flatten().filter(|&(_, &iou)| iou < self.options.good_iou);
        Ok(poor.map(|(&of, _)| of).filter(|&of| of != frame).collect())
    }

    /// Where a correction is worth most; where none pays any longer, the user is content with less for each corner.
    fn next(&mut self) -> Result<Option<Worth>> {
        loop {
            let worth = most_worth(&self.user.ious_by_label()?, &self.user.anchors(), &self.left_alone);
            let half = self.aim.gain_beyond / 2.0;
            if worth.is_some() || half < self.options.least_gain {
                return Ok(worth);
            }
            self.aim = Aim { gain: self.aim.gain.min(half), gain_beyond: half, ..self.aim };
            self.left_alone.clear();
        }
    }

    /// Corrects a label on a frame, with it the other labels that are poor there, and carries them anew.
    fn correct(&mut self, worth: Worth) -> Result<()> {
        let Worth { frame, label, iou } = worth;
        let good_iou = self.options.good_iou;
        let clicks = match iou {
            _ if self.clicked_out.contains(&(frame, label)) => Clicks { good_iou, most: 0 },
            iou if iou < good_iou => Clicks::of(self.options),
            _ => Clicks { good_iou: 1.0, most: 1 },
        };
        let is_poor = |id: LabelId, iou: f64| iou < good_iou && !self.left_alone.contains(&(frame, id));
        let before = self.user.ious(frame)?;
        let is_meant = |(id, iou): &(&LabelId, &f64)| **id == label || is_poor(**id, **iou);
        let labels: Vec<LabelId> = before.iter().filter(is_meant).map(|(&id, _)| id).collect();
        let is_better = self.user.visit(frame, &labels, clicks, &self.aim)?;
        if is_better {
            self.corrected.insert(frame);
            self.user.retrack(self.tracker, frame, &labels)?;
        }
        let after = self.user.ious(frame)?;
        let iou = |id: &LabelId| after.get(id).copied().unwrap_or(1.0);
        let paid = |id: &LabelId| iou(id) >= good_iou && iou(id) - before[id] >= self.aim.gain_beyond;
        for label in labels.into_iter().filter(|id| !is_better || !paid(id)) {
            self.left_alone.insert((frame, label));
            self.clicked_out.insert((frame, label));
        }
        self.note()
    }

    /// Notes the mean IoU, and the goals that are reached now for the first time.
    fn note(&mut self) -> Result<()> {
        self.mean_iou = self.user.mean_iou()?;
        for goal in self.goals.iter_mut().filter(|goal| self.mean_iou >= goal.mean_iou) {
            goal.clicks.get_or_insert(self.user.clicks());
        }
        Ok(())
    }
}

/// Counts the clicks for every frame from nothing, without a tracker: nothing is carried on, so that good is good enough.
fn frame_by_frame(
    sequence: &Sequence,
    segmenter: &dyn Segmenter,
    options: &InteractOptions,
    progress: &Progress,
) -> Result<BTreeMap<usize, FrameByFrame>> {
    let prepared = PreparedFrames::new(PREPARED_BYTES);
    let aim = Aim::good(options);
    let mut all = BTreeMap::new();
    for (done, &frame) in sequence.truth.keys().enumerate() {
        progress.stage("click frame by frame")?;
        progress.step(done, sequence.truth.len())?;
        let turn = 1 + frame as u64;
        let mut user = RobotUser::new(sequence, segmenter, &prepared, progress, options, turn, usize::MAX);
        user.visit(frame, &sequence.shown_on(frame), Clicks::of(options), &aim)?;
        let failed = user.ious(frame)?.values().any(|&iou| iou < options.good_iou);
        all.insert(frame, FrameByFrame { frames: 1, clicks: user.clicks(), failed: usize::from(failed) });
    }
    Ok(all)
}
