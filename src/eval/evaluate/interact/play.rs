use std::collections::{BTreeMap, BTreeSet};
use std::iter::{once, successors};
use std::time::Instant;

use anyhow::{Context, Result};

use super::hand::Aim;
use super::user::{Clicks, IousByLabel, RobotUser, by_label, mean_over_labels};
use super::{FrameByFrame, Goal, InteractOptions, InteractReport, Sequence};
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

/// Counts the clicks for every frame from nothing, without a tracker, by the rules of [`interact`]: to a mean IoU
/// of 0.90. Nothing is carried on, so that what is good is drawn finer only where other frames leave that mean short.
///
/// # Errors
/// When a frame cannot be read, the segmenter fails, or on a stop.
fn frame_by_frame(
    sequence: &Sequence,
    segmenter: &dyn Segmenter,
    prepared: &PreparedFrames,
    options: &InteractOptions,
    progress: &Progress,
) -> Result<BTreeMap<usize, FrameByFrame>> {
    let of_frame = |frame: usize| {
        RobotUser::new(
            sequence,
            segmenter,
            prepared,
            progress,
            options,
            1 + frame as u64,
            usize::MAX,
        )
    };
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
            let asked: BTreeMap<LabelId, Clicks> = sequence
                .shown_on(*frame)
                .into_iter()
                .map(|label| (label, clicks))
                .collect();
            user.visit(*frame, &asked, &aim)?;
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

/// Mean IoU over the sequence of which each user has labelled a frame.
fn mean_iou(users: &[(usize, RobotUser<'_>)]) -> Result<f64> {
    let ious = by_label(
        users
            .iter()
            .map(|(frame, user)| Ok((*frame, user.ious(*frame)?))),
    )?;
    Ok(mean_over_labels(ious))
}

/// A label on a frame that is worth a correction.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Worth {
    /// Frame number.
    pub frame: usize,
    /// The label.
    pub label: LabelId,
    /// Its IoU there, below 1.
    pub iou: f64,
}

/// Where a correction is likely to mend most, as a user sees who goes through the film: of all stretches between anchors
/// the one over which a label lacks most, there the frame in the middle of what it lacks. Where nothing is amiss between
/// anchors, the poorest anchor. Those in `left_alone` are passed over.
fn most_worth(
    ious: &IousByLabel,
    anchors: &BTreeSet<usize>,
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
        let at_anchors = all
            .iter()
            .filter(|worth| anchors.contains(&worth.frame) && is_open(worth));
        poorest = at_anchors
            .chain(&poorest)
            .min_by(|a, b| a.iou.total_cmp(&b.iou))
            .copied();
        for stretch in all.split(|worth| anchors.contains(&worth.frame)) {
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

/// The frame before which a label lacks as much as after it.
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

    fn chosen(ious: &[f64], anchors: &[usize], left_alone: &[usize]) -> Option<usize> {
        let ious = BTreeMap::from([(LABEL, ious.iter().copied().enumerate().collect())]);
        let left_alone = left_alone.iter().map(|&frame| (frame, LABEL)).collect();
        most_worth(&ious, &anchors.iter().copied().collect(), &left_alone).map(|worth| worth.frame)
    }

    #[test]
    fn the_middle_of_the_widest_lack_comes_before_one_poor_frame() {
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
            "an anchor parts stretches"
        );
    }

    #[test]
    fn anchors_come_last_and_what_is_right_never() {
        assert_eq!(chosen(&[0.8, 1.0, 0.7, 1.0], &[0, 2], &[]), Some(2));
        assert_eq!(chosen(&[0.8, 1.0, 0.7, 1.0], &[0, 2], &[2]), Some(0));
        assert_eq!(chosen(&[0.8, 0.99, 0.7], &[0, 2], &[]), Some(1));
        assert_eq!(chosen(&[1.0, 1.0], &[0], &[]), None);
        assert_eq!(chosen(&[0.5, 0.5], &[0], &[0, 1]), None);
        assert_eq!(
            most_worth(&BTreeMap::new(), &BTreeSet::new(), &BTreeSet::new()),
            None
        );
    }

    #[test]
    fn the_label_that_lacks_most_goes_first() {
        let of = |ious: [f64; 3]| ious.into_iter().enumerate().collect::<BTreeMap<_, _>>();
        let ious = BTreeMap::from([
            (LABEL, of([1.0, 0.5, 0.5])),
            (LabelId(2), of([1.0, 0.4, 0.4])),
        ]);
        let worth = most_worth(&ious, &BTreeSet::from([0]), &BTreeSet::new()).unwrap();
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
