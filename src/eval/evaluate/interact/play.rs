use std::collections::{BTreeMap, BTreeSet};
use std::iter::{once, successors};
use std::time::Instant;

use anyhow::{Context, Result};

use super::options::Aim;
use super::user::{Clicks, IousByLabel, LabellingSetup, RobotUser, by_label, mean_over_labels};
use super::{FrameByFrame, Goal, InteractOptions, InteractReport, Sequence};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, Segmenter, Tracker};
use ostra_session::PreparedFrames;

/// Capacity of the cache of frames prepared for clicks, in bytes.
const PREPARED_BYTES: usize = 256 << 20;

/// Simulates a user who labels a sequence by clicking, tracking and correcting.
///
/// The user labels the first frame that shows a label and tracks it. Then the user corrects where
/// most is wrong, and the corrected labels are tracked again up to the neighbouring keyframes. The
/// work ends when the mean IoU is high enough, when no correction pays, or at twice the clicks of
/// the frame-by-frame baseline. That baseline is counted first.
///
/// A label is left alone on a frame if a visit left it below [`InteractOptions::good_iou`] or
/// gained less than a corner must. When the required gain is lowered, such a label is only drawn,
/// not clicked.
///
/// # Errors
/// Returns an error if the ground truth has no label, if a frame cannot be read, if the segmenter
/// or tracker fails, or if stopped.
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
    let setup = LabellingSetup {
        sequence,
        segmenter,
        prepared: &prepared,
        progress,
        options,
    };
    let alone = frame_by_frame(&setup)?;
    let begun = Instant::now();
    let most_clicks = 2 * alone.values().map(|alone| alone.clicks).sum::<usize>();
    let user = RobotUser::new(setup, 0, most_clicks);
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

/// The state of a simulated user with a tracker.
struct Game<'a> {
    user: RobotUser<'a>,
    tracker: &'a dyn Tracker,
    options: &'a InteractOptions,
    goals: [Goal; 3],
    mean_iou: f64,
    corrected: BTreeSet<usize>,
    aim: Aim,
    /// Labels on frames for which no further correction pays.
    left_alone: BTreeSet<(usize, LabelId)>,
    /// Labels on frames that were left alone before; they are only drawn, not clicked.
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

    /// Labels the first frame and tracks it.
    ///
    /// Returns the other frames on which a label is not good after that.
    fn begin(&mut self, first: usize, labels: &[LabelId]) -> Result<BTreeSet<usize>> {
        let requested = labels
            .iter()
            .map(|&label| (label, Clicks::of(self.options)))
            .collect();
        let before = self.user.ious(first)?;
        self.user.visit(first, &requested, &self.aim)?;
        self.leave(first, &requested, &before)?;
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

    /// Returns the best correction; if none pays, the required gain per corner is lowered.
    fn next(&mut self) -> Result<Option<Worth>> {
        loop {
            let worth = next_correction(
                &self.user.ious_by_label()?,
                &self.user.keyframes(),
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

    /// Corrects a label and the other poor labels on its frame, and tracks them again.
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
        let requested: BTreeMap<LabelId, Clicks> =
            meant.map(|(&id, &iou)| (id, clicks(id, iou))).collect();
        if self.user.visit(frame, &requested, &self.aim)? {
            self.corrected.insert(frame);
            let labels: Vec<LabelId> = requested.keys().copied().collect();
            self.user.retrack(self.tracker, frame, &labels)?;
        }
        self.leave(frame, &requested, &before)?;
        self.note()
    }

    /// Records which labels of a visited frame are left alone.
    ///
    /// These are the labels that are not good yet or gained less than a corner must.
    fn leave(
        &mut self,
        frame: usize,
        requested: &BTreeMap<LabelId, Clicks>,
        before: &BTreeMap<LabelId, f64>,
    ) -> Result<()> {
        let after = self.user.ious(frame)?;
        let iou = |of: &BTreeMap<LabelId, f64>, id| of.get(&id).copied().unwrap_or(1.0);
        for &id in requested.keys() {
            let (was, is) = (iou(before, id), iou(&after, id));
            if is < self.options.good_iou || is - was < self.aim.price_beyond {
                self.left_alone.insert((frame, id));
                self.clicked_out.insert((frame, id));
            }
        }
        Ok(())
    }

    /// Records the mean IoU and the goals that are reached for the first time.
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

/// Counts the clicks to label every frame from scratch, without a tracker.
///
/// The rules are those of [`interact`], up to a mean IoU of 0.90. Masks are not tracked here. Good
/// labels are therefore refined only while other frames keep the mean below that.
///
/// # Errors
/// Returns an error if a frame cannot be read, if the segmenter fails, or if stopped.
fn frame_by_frame(setup: &LabellingSetup<'_>) -> Result<BTreeMap<usize, FrameByFrame>> {
    let LabellingSetup {
        sequence,
        progress,
        options,
        ..
    } = *setup;
    let of_frame = |frame: usize| RobotUser::new(*setup, 1 + frame as u64, usize::MAX);
    let mut users: Vec<(usize, RobotUser<'_>)> = sequence
        .truth
        .keys()
        .map(|&frame| (frame, of_frame(frame)))
        .collect();
    let first = Aim {
        price_beyond: f64::INFINITY,
        ..Aim::of(options)
    };
    let finer = successors(Some(Aim::of(options)), |aim| {
        aim.lowered(options.least_price)
    });
    progress.stage("click frame by frame")?;
    'rounds: for (round, aim) in once(first).chain(finer).enumerate() {
        let clicks = if round == 0 {
            Clicks::of(options)
        } else {
            Clicks::NONE
        };
        for at in 0..users.len() {
            if round > 0 && mean_iou(&users)? >= InteractReport::GOALS[1] {
                break 'rounds;
            }
            progress.step(at, users.len())?;
            let (frame, user) = &mut users[at];
            let requested: BTreeMap<LabelId, Clicks> = sequence
                .shown_on(*frame)
                .into_iter()
                .map(|label| (label, clicks))
                .collect();
            user.visit(*frame, &requested, &aim)?;
        }
    }
    let counted = users.into_iter().map(|(frame, user)| {
        let failed = user
            .ious(frame)?
            .values()
            .any(|&iou| iou < options.good_iou);
        Ok((
            frame,
            FrameByFrame {
                frames: 1,
                clicks: user.clicks(),
                failed: usize::from(failed),
            },
        ))
    });
    counted.collect()
}

/// Returns the mean IoU over the sequence; each user has labelled one frame.
fn mean_iou(users: &[(usize, RobotUser<'_>)]) -> Result<f64> {
    let ious = by_label(
        users
            .iter()
            .map(|(frame, user)| Ok((*frame, user.ious(*frame)?))),
    )?;
    Ok(mean_over_labels(ious))
}

/// A correction of a label on a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Worth {
    /// Frame number.
    pub frame: usize,
    /// The label.
    pub label: LabelId,
    /// IoU of the label on the frame, below 1.
    pub iou: f64,
}

/// Returns the correction with the highest expected gain.
///
/// Candidates are the intervals between keyframes. The interval with the largest total error of a
/// label is chosen, and in it the frame in the middle of the error. If there is no error between
/// keyframes, the keyframe with the lowest IoU is chosen. Entries of `left_alone` are skipped.
fn next_correction(
    ious: &IousByLabel,
    keyframes: &BTreeSet<usize>,
    left_alone: &BTreeSet<(usize, LabelId)>,
) -> Option<Worth> {
    let is_open =
        |worth: &Worth| worth.iou < 1.0 && !left_alone.contains(&(worth.frame, worth.label));
    let lack = |stretch: &[Worth]| stretch.iter().map(|worth| 1.0 - worth.iou).sum::<f64>();
    let (mut poorest, mut widest): (Option<Worth>, Option<(f64, Worth)>) = (None, None);
    for (&label, of) in ious {
        let all: Vec<Worth> = of
            .iter()
            .map(|(&frame, &iou)| Worth { frame, label, iou })
            .collect();
        let at_keyframes = all
            .iter()
            .filter(|worth| keyframes.contains(&worth.frame) && is_open(worth));
        poorest = at_keyframes
            .chain(&poorest)
            .min_by(|a, b| a.iou.total_cmp(&b.iou))
            .copied();
        for stretch in all.split(|worth| keyframes.contains(&worth.frame)) {
            let all = lack(stretch);
            if all > widest.map_or(0.0, |(most, _)| most) {
                let middle = middle_of(stretch);
                let open = stretch.iter().filter(|worth| is_open(worth));
                let nearest = open.min_by_key(|worth| worth.frame.abs_diff(middle));
                widest = nearest.map(|&worth| (all, worth)).or(widest);
            }
        }
    }
    widest.map(|(_, worth)| worth).or(poorest)
}

/// Returns the frame at which half of the total error of a label is reached.
fn middle_of(stretch: &[Worth]) -> usize {
    let half = stretch.iter().map(|worth| 1.0 - worth.iou).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    let middle = stretch.iter().find(|worth| {
        sum += 1.0 - worth.iou;
        sum >= half
    });
    middle.map_or(0, |worth| worth.frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LABEL: LabelId = LabelId(1);

    fn chosen(ious: &[f64], keyframes: &[usize], left_alone: &[usize]) -> Option<usize> {
        let ious = BTreeMap::from([(LABEL, ious.iter().copied().enumerate().collect())]);
        let left_alone = left_alone.iter().map(|&frame| (frame, LABEL)).collect();
        next_correction(&ious, &keyframes.iter().copied().collect(), &left_alone)
            .map(|worth| worth.frame)
    }

    #[test]
    fn middle_of_the_largest_total_error_precedes_one_poor_frame() {
        let ious = [1.0, 0.1, 0.9, 1.0, 0.7, 0.6, 0.6, 0.7, 0.9];
        assert_eq!(chosen(&ious, &[0, 3], &[]), Some(6));
        assert_eq!(
            chosen(&ious, &[0, 3], &[6]),
            Some(5),
            "the nearest that is not left alone"
        );
        assert_eq!(
            chosen(&ious, &[0, 3, 6], &[]),
            Some(1),
            "a keyframe parts stretches"
        );
    }

    #[test]
    fn keyframes_come_last_and_correct_frames_never() {
        assert_eq!(chosen(&[0.8, 1.0, 0.7, 1.0], &[0, 2], &[]), Some(2));
        assert_eq!(chosen(&[0.8, 1.0, 0.7, 1.0], &[0, 2], &[2]), Some(0));
        assert_eq!(chosen(&[0.8, 0.99, 0.7], &[0, 2], &[]), Some(1));
        assert_eq!(chosen(&[1.0, 1.0], &[0], &[]), None);
        assert_eq!(chosen(&[0.5, 0.5], &[0], &[0, 1]), None);
        assert_eq!(
            next_correction(&BTreeMap::new(), &BTreeSet::new(), &BTreeSet::new()),
            None
        );
    }

    #[test]
    fn label_with_the_largest_error_comes_first() {
        let of = |ious: [f64; 3]| ious.into_iter().enumerate().collect::<BTreeMap<_, _>>();
        let ious = BTreeMap::from([
            (LABEL, of([1.0, 0.5, 0.5])),
            (LabelId(2), of([1.0, 0.4, 0.4])),
        ]);
        let worth = next_correction(&ious, &BTreeSet::from([0]), &BTreeSet::new()).unwrap();
        assert_eq!(
            worth,
            Worth {
                frame: 1,
                label: LabelId(2),
                iou: 0.4
            }
        );
    }
}
