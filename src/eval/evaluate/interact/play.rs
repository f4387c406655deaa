use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use anyhow::{Context, Result};

use super::aim::Aim;
use super::alone::frame_by_frame;
use super::choose::{Worth, most_worth};
use super::user::{Clicks, RobotUser};
use super::{Goal, InteractOptions, InteractReport, Sequence};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, Segmenter, Tracker};
use ostra_session::PreparedFrames;

/// Bytes of frames made ready for clicks.
const PREPARED_BYTES: usize = 256 << 20;

/// Plays a robot user who labels the first frame that shows anything, tracks, and then corrects where most is amiss,
/// which is carried anew up to the neighbouring anchors, until the sequence is good enough or twice as much work as clicking
/// every frame from nothing, which is counted first. A label that a visit left below [`InteractOptions::good_iou`], or bettered
/// by less than a corner must, is left alone on that frame until less is asked of each corner, and then only drawn.
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
    let first = sequence
        .truth
        .keys()
        .copied()
        .find(|&frame| !sequence.shown_on(frame).is_empty());
    let first = first.context("the true masks show no label; give masks that do")?;
    let prepared = PreparedFrames::new(PREPARED_BYTES);
    let alone = frame_by_frame(sequence, segmenter, &prepared, options, progress)?;
    let begun = Instant::now();
    let most_clicks = 2 * alone.values().map(|alone| alone.clicks).sum::<usize>();
    let user = RobotUser::new(
        sequence,
        segmenter,
        &prepared,
        progress,
        options,
        0,
        most_clicks,
    );
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
        failed_by_frame: failed
            .iter()
            .filter_map(|frame| alone.get(frame))
            .copied()
            .sum(),
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
        let goals = InteractReport::GOALS.map(|mean_iou| Goal {
            mean_iou,
            clicks: None,
        });
        Self {
            user,
            tracker,
            options,
            goals,
            mean_iou: 0.0,
            corrected: BTreeSet::new(),
            aim: Aim::of(options),
            left_alone: BTreeSet::new(),
            clicked_out: BTreeSet::new(),
        }
    }

    /// Labels the first frame and tracks it; gives the others on which that left a label below the IoU at which it is good.
    fn begin(&mut self, first: usize, labels: &[LabelId]) -> Result<BTreeSet<usize>> {
        let asked = labels
            .iter()
            .map(|&label| (label, Clicks::of(self.options)))
            .collect();
        let before = self.user.ious(first)?;
        self.user.visit(first, &asked, &self.aim)?;
        self.leave(first, &asked, &before)?;
        self.user.track(self.tracker)?;
        self.note()?;
        let ious = self.user.ious_by_label()?;
        let poor = ious
            .values()
            .flatten()
            .filter(|&(_, &iou)| iou < self.options.good_iou);
        Ok(poor
            .map(|(&frame, _)| frame)
            .filter(|&frame| frame != first)
            .collect())
    }

    /// Where a correction is worth most; where none pays any longer, the user is content with less for each corner.
    fn next(&mut self) -> Result<Option<Worth>> {
        loop {
            let worth = most_worth(
                &self.user.ious_by_label()?,
                &self.user.anchors(),
                &self.left_alone,
            );
            let lowered = self.aim.lowered(self.options.least_price);
            let (None, Some(aim)) = (worth, lowered) else {
                return Ok(worth);
            };
            self.aim = aim;
            self.left_alone.clear();
        }
    }

    /// Corrects a label on a frame, with it the other labels that are poor there, and carries them anew.
    fn correct(&mut self, worth: Worth) -> Result<()> {
        let Worth { frame, label, .. } = worth;
        let good_iou = self.options.good_iou;
        let before = self.user.ious(frame)?;
        let is_meant = |id: LabelId, iou: f64| {
            id == label || iou < good_iou && !self.left_alone.contains(&(frame, id))
        };
        let clicks = |id: LabelId, iou: f64| match self.clicked_out.contains(&(frame, id)) {
            true => Clicks::NONE,
            false if iou < good_iou => Clicks::of(self.options),
            false => Clicks::ONE,
        };
        let meant = before.iter().filter(|&(&id, &iou)| is_meant(id, iou));
        let asked: BTreeMap<LabelId, Clicks> =
            meant.map(|(&id, &iou)| (id, clicks(id, iou))).collect();
        if self.user.visit(frame, &asked, &self.aim)? {
            self.corrected.insert(frame);
            let labels: Vec<LabelId> = asked.keys().copied().collect();
            self.user.retrack(self.tracker, frame, &labels)?;
        }
        self.leave(frame, &asked, &before)?;
        self.note()
    }

    /// Notes which labels of a visited frame are to be left alone: those that are not good yet, or gained less than a corner must.
    fn leave(
        &mut self,
        frame: usize,
        asked: &BTreeMap<LabelId, Clicks>,
        before: &BTreeMap<LabelId, f64>,
    ) -> Result<()> {
        let after = self.user.ious(frame)?;
        let iou = |of: &BTreeMap<LabelId, f64>, id| of.get(&id).copied().unwrap_or(1.0);
        for &id in asked.keys() {
            let (was, is) = (iou(before, id), iou(&after, id));
            if is < self.options.good_iou || is - was < self.aim.price_beyond {
                self.left_alone.insert((frame, id));
                self.clicked_out.insert((frame, id));
            }
        }
        Ok(())
    }

    /// Notes the mean IoU, and the goals that are reached now for the first time.
    fn note(&mut self) -> Result<()> {
        self.mean_iou = self.user.mean_iou()?;
        for goal in self
            .goals
            .iter_mut()
            .filter(|goal| self.mean_iou >= goal.mean_iou)
        {
            goal.clicks.get_or_insert(self.user.clicks());
        }
        Ok(())
    }
}
