use std::collections::BTreeSet;
use std::time::Instant;

use anyhow::{Context, Result};

use super::user::RobotUser;
use super::{FrameByFrame, Goal, InteractOptions, InteractReport, Sequence};
use crate::engine::job::Progress;
use crate::masks::{Segmenter, Tracker};
use crate::session::prepared::PreparedFrames;

/// Bytes of frames made ready for clicks.
const PREPARED_BYTES: usize = 256 << 20;

/// Plays a robot user who labels the first frame that shows anything, tracks, and then corrects the worst label on the
/// worst frame, which is carried anew up to the neighbouring anchors, until the sequence is good enough or the clicks
/// are used up. A label that a visit left below [`InteractOptions::good_iou`], or did not better, is left alone on that
/// frame. Clicking every frame from nothing is counted beside it.
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
    let begun = Instant::now();
    let prepared = PreparedFrames::new(PREPARED_BYTES);
    let most_clicks = options.most_clicks(sequence);
    let mut user = RobotUser::new(sequence, segmenter, &prepared, progress, most_clicks);
    let mut goals = InteractReport::GOALS.map(|mean_iou| Goal { mean_iou, clicks: None });
    let first = sequence.truth.keys().copied().find(|&frame| !sequence.shown_on(frame).is_empty());
    let first = first.context("the true masks show no label; give masks that do")?;
    progress.stage("click")?;
    user.visit(first, &sequence.shown_on(first), options.good_iou, options.visit_clicks)?;
    user.track(tracker)?;
    let mut mean_iou = user.mean_iou()?;
    note(&mut goals, mean_iou, user.clicks());
    let (mut corrected, mut left_alone) = (BTreeSet::new(), BTreeSet::new());
    while mean_iou < options.enough_iou && !user.is_spent() {
        progress.stage("click")?;
        progress.step(user.clicks(), most_clicks)?;
        let Some((frame, label, iou)) = user.worst(&left_alone)? else { break };
        let (good_iou, most) = if iou < options.good_iou { (options.good_iou, options.visit_clicks) } else { (1.0, 1) };
        let is_better = user.visit(frame, &[label], good_iou, most)?;
        if is_better {
            corrected.insert(frame);
            user.retrack(tracker, frame, label)?;
        }
        if !is_better || user.ious(frame)?.get(&label).is_some_and(|&iou| iou < options.good_iou) {
            left_alone.insert((frame, label));
        }
        mean_iou = user.mean_iou()?;
        note(&mut goals, mean_iou, user.clicks());
    }
    corrected.remove(&first);
    let seconds = begun.elapsed().as_secs_f64();
    Ok(InteractReport {
        segmenter: segmenter.name().to_owned(),
        tracker: tracker.name().to_owned(),
        frames: sequence.truth.len(),
        labels: sequence.shown().len(),
        reached: goals.to_vec(),
        mean_iou,
        clicks: user.clicks(),
        corrected: corrected.len(),
        seconds,
        frame_by_frame: frame_by_frame(sequence, segmenter, options, &prepared, progress)?,
    })
}

/// Notes the goals that are reached now for the first time.
fn note(goals: &mut [Goal], mean_iou: f64, clicks: usize) {
    for goal in goals.iter_mut().filter(|goal| mean_iou >= goal.mean_iou) {
        goal.clicks.get_or_insert(clicks);
    }
}

/// Counts the clicks for every frame from nothing, by the segmenter alone.
fn frame_by_frame(
    sequence: &Sequence,
    segmenter: &dyn Segmenter,
    options: &InteractOptions,
    prepared: &PreparedFrames,
    progress: &Progress,
) -> Result<FrameByFrame> {
    let mut all = FrameByFrame::default();
    for (done, &frame) in sequence.truth.keys().enumerate() {
        progress.stage("click frame by frame")?;
        progress.step(done, sequence.truth.len())?;
        let mut user = RobotUser::new(sequence, segmenter, prepared, progress, usize::MAX);
        user.visit(frame, &sequence.shown_on(frame), options.good_iou, options.lone_clicks)?;
        all.clicks += user.clicks();
        all.failed += usize::from(user.ious(frame)?.values().any(|&iou| iou < options.good_iou));
    }
    Ok(all)
}
