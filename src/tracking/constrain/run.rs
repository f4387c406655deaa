use std::collections::{BTreeMap, BTreeSet};

use super::account::Account;
use super::options::ConstrainOptions;
use super::walk::{Answer, Found, Walk};
use crate::carry::Witnesses;
use ostra_core::job::{Progress, Stopped};
use ostra_masks::{
    Direction, LabelId, MaskError, RunMask, TrackRequest, TrackedFrame, Tracker, WalkedFrame,
    merged,
};

/// A tracking run of one walk or two; where two come by, they are merged.
pub struct Run<'a> {
    pub tracker: &'a dyn Tracker,
    pub request: &'a TrackRequest,
    pub geometry: (&'a Witnesses<'a>, &'a ConstrainOptions),
    pub progress: &'a Progress,
}

/// An answer of the walk forwards, kept until the walk backwards comes by.
struct Kept {
    runs: RunMask,
    confidence: BTreeMap<LabelId, f32>,
    steps: usize,
}

impl Run<'_> {
    /// Tracks; what geometry did and the tracker's warnings.
    pub fn track(&self, emit: &mut dyn FnMut(TrackedFrame)) -> Result<Vec<String>, MaskError> {
        let (forward, backward) = (
            self.targets(Direction::Forward),
            self.targets(Direction::Backward),
        );
        let total = forward.len() + backward.len();
        let (mut account, mut done) = (Account::default(), 0);
        let mut kept: BTreeMap<usize, Kept> = BTreeMap::new();
        let mut hand_on =
            |frame: usize, walked: WalkedFrame, preliminary: bool| -> Result<(), Stopped> {
                emit(TrackedFrame {
                    frame,
                    mask: walked.mask,
                    confidence: walked.confidence,
                    preliminary,
                });
                done += 1;
                self.progress.step(done.min(total), total)
            };
        let first = self.walk(
            Direction::Forward,
            &forward,
            &mut account,
            &mut |Answer {
                      frame,
                      walked,
                      steps,
                  }| {
                if backward.contains(&frame) {
                    let runs = RunMask::encode(&walked.mask);
                    kept.insert(
                        frame,
                        Kept {
                            runs,
                            confidence: walked.confidence.clone(),
                            steps,
                        },
                    );
                }
                hand_on(frame, walked, backward.contains(&frame))
            },
        );
        let first = unless_stopped(first)?;
        let second = self.walk(
            Direction::Backward,
            &backward,
            &mut account,
            &mut |Answer {
                      frame,
                      walked,
                      steps,
                  }| {
                let met = kept.remove(&frame).map(|kept| kept.met_by(&walked, steps));
                hand_on(frame, met.unwrap_or(walked), false)
            },
        );
        let second = unless_stopped(second)?;
        // The walk backwards did not reach them.
        for (
            frame,
            Kept {
                runs, confidence, ..
            },
        ) in kept
        {
            hand_on(
                frame,
                WalkedFrame {
                    mask: runs.decode(),
                    confidence,
                },
                false,
            )?;
        }
        let mut lines = account.lines(&self.request.frames);
        for ended in [first, second] {
            match ended {
                Err(error) if done == 0 => return Err(error),
                ended => lines.extend(ended.unwrap_or_else(|error| vec![error.to_string()])),
            }
        }
        Ok(lines)
    }

    /// The frames asked for that have an anchor on the side that a walk comes from.
    fn targets(&self, way: Direction) -> BTreeSet<usize> {
        let TrackRequest {
            anchors,
            from,
            to,
            direction,
            ..
        } = self.request;
        let is_walked = *direction == Direction::Both || *direction == way;
        let is_reached = |frame: &usize| match way {
            Direction::Backward => anchors.range(frame..).next().is_some(),
            _ => anchors.range(..frame).next().is_some(),
        };
        let others = (*from..=*to).filter(|frame| is_walked && !anchors.contains_key(frame));
        others.filter(is_reached).collect()
    }

    fn walk(
        &self,
        way: Direction,
        targets: &BTreeSet<usize>,
        account: &mut Account,
        found: &mut Found<'_>,
    ) -> Result<Vec<String>, MaskError> {
        if targets.is_empty() {
            return Ok(Vec::new());
        }
        let request = TrackRequest {
            direction: way,
            ..self.request.clone()
        };
        Walk::new(
            self.tracker,
            request,
            targets.clone(),
            self.geometry,
            self.progress,
        )
        .follow(account, found)
    }
}

/// A stop ends all; where one walk fails, the other may still answer.
fn unless_stopped(
    ended: Result<Vec<String>, MaskError>,
) -> Result<Result<Vec<String>, MaskError>, Stopped> {
    match ended {
        Err(MaskError::Stopped(stopped)) => Err(stopped),
        ended => Ok(ended),
    }
}

impl Kept {
    /// Merged with what the other walk says, `steps` after it began.
    fn met_by(self, other: &WalkedFrame, steps: usize) -> WalkedFrame {
        let nearness = steps as f32 / (steps + self.steps) as f32;
        merged(
            &WalkedFrame {
                mask: self.runs.decode(),
                confidence: self.confidence,
            },
            other,
            nearness,
        )
    }
}
