use std::collections::BTreeMap;
use std::iter::{once, successors};

use anyhow::Result;

use super::aim::Aim;
use super::user::{Clicks, RobotUser, by_label, mean_over_labels};
use super::{FrameByFrame, InteractOptions, InteractReport, Sequence};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, Segmenter};
use ostra_session::PreparedFrames;

/// Counts the clicks for every frame from nothing, without a tracker, by the rules of [`super::interact`]: to a mean IoU
/// of 0.90. Nothing is carried on, so that what is good is drawn finer only where other frames leave that mean short.
///
/// # Errors
/// When a frame cannot be read, the segmenter fails, or on a stop.
pub fn frame_by_frame(
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
