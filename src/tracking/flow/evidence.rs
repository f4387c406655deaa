use glam::{Affine2, Vec2};

use super::change::FrameChange;
use super::memory::Recalled;
use super::object::{Evidence, Prediction, SHAPE, TrackedObject};
use super::options::FlowOptions;
use super::plane::{Plane, median};
use super::votes::{Displacement, Vote, VoteSource, votes};
use ostra_masks::cut::PixelWindow;
use ostra_masks::{LabelMask, Region, squared_distance_to};

/// Odds of a pixel outside the object's reach.
const NEVER: f32 = -6.0;
/// Largest log-odds from flow and from motion.
const MOST_FLOW: f32 = 3.0;
const MOST_MOTION: f32 = 1.5;
/// Added to the measured spread of the object's and the background's motion, in pixels.
const OBJECT_SPREAD_PX: f32 = 0.7;
const BACKGROUND_SPREAD_PX: f32 = 0.5;
/// Search radii for similar patches around the position from flow and from motion, in pixels.
const FLOW_REACH: usize = 3;
const OBJECT_REACH: usize = 4;
/// Share of pixels that follow neither motion.
const MIN_EVIDENCE: f32 = 0.05;

/// Observations of the next frame and its neighbours.
pub(super) struct FrameEvidence<'a> {
    pub change: &'a FrameChange,
    pub beyond: Option<&'a FrameAhead<'a>>,
    pub recalled: Option<&'a Recalled>,
}

/// Combines flow, position, colours, motion, memory and neighbouring patches into odds.
pub(super) fn evidence(
    object: &TrackedObject,
    prediction: &Prediction,
    &FrameEvidence {
        change,
        beyond,
        recalled,
    }: &FrameEvidence<'_>,
    options: &FlowOptions,
) -> Evidence {
    let (width, height) = (change.next.width, change.next.height);
    let reach = options.reach * object.area().sqrt() + 4.0;
    let Some(window) = window_of(&prediction.expected, reach) else {
        return no_evidence();
    };
    let distances = distances(&prediction.expected, window);
    let fade = object.area().sqrt() / 10.0 + 2.0;
    let (first, last) = object.color_odds();
    let motion = motion_odds(prediction, change);
    debug_assert!(window.right <= width && window.bottom <= height);
    let motion: Vec<f32> = window
        .places(width)
        .map(|at| {
            change.reliable.values[at]
                * motion(Vec2::new((at % width) as f32, (at / width) as f32), at)
        })
        .collect();
    let shape_weight = options.shape_weight * object.nearness();
    let memory = recalled.map(|recalled| recalled.odds(object.id));
    let votes = beyond.and_then(|beyond| votes_of_both(object, prediction, change, beyond, window));
    let odds = window
        .places(width)
        .enumerate()
        .zip(distances)
        .zip(&motion)
        .map(|(((nth, at), distance), motion)| {
            if distance > reach {
                return NEVER;
            }
            let trust = prediction.trust.values[at];
            let reliable = change.reliable.values[at];
            let expected = prediction.expected.values[at];
            let flow = ((trust + 0.02) / (1.0 - trust + 0.02))
                .ln()
                .clamp(-MOST_FLOW, MOST_FLOW);
            let place = if expected > SHAPE {
                expected
            } else {
                (-distance / fade).max(-4.0)
            };
            let bin = usize::from(change.next.bins[at]);
            let shape = if expected > SHAPE {
                shape_weight * expected
            } else {
                0.0
            };
            options.flow_weight * reliable * flow
                - (options.uncertainty_weight - shape) * (1.0 - reliable)
                + options.place_weight * place
                + options.first_color_weight * first[bin]
                + options.last_color_weight * last[bin]
                + options.motion_weight * motion
                + votes
                    .as_ref()
                    .map_or(0.0, |votes| options.vote_weight * votes[nth].odds())
                + memory.as_ref().map_or(0.0, |odds| {
                    options.memory_weight
                        * odds(Vec2::new((at % width) as f32, (at / width) as f32))
                })
        });
    let odds = odds.collect();
    Evidence {
        window,
        odds,
        motion,
    }
}

/// Returns the evidence for an object that is expected nowhere.
fn no_evidence() -> Evidence {
    Evidence {
        window: PixelWindow {
            left: 0,
            top: 0,
            right: 0,
            bottom: 0,
        },
        odds: Vec::new(),
        motion: Vec::new(),
    }
}

/// Computes the votes of patches in the last frame and in the frame ahead.
///
/// Patches are searched around the positions given by flow and by the object's current motion.
/// Returns `None` if the mask ahead does not show the object, because it may not have been tracked
/// there.
fn votes_of_both(
    object: &TrackedObject,
    prediction: &Prediction,
    change: &FrameChange,
    beyond: &FrameAhead<'_>,
    window: PixelWindow,
) -> Option<Vec<Vote>> {
    let there = beyond.mask.region(object.id);
    if there.is_empty() {
        return None;
    }
    let own = Plane::of_mask(change.next.width, change.next.height, &object.mask().inside);
    let share_beyond = Plane::of_mask(change.next.width, change.next.height, &there.inside);
    let last = |way, reach| VoteSource {
        image: &change.last,
        share: &own,
        way,
        reach,
        weight: 2.0 * (1.0 - beyond.share),
    };
    let next = |way, reach| VoteSource {
        image: &beyond.change.next,
        share: &share_beyond,
        way,
        reach,
        weight: 2.0 * beyond.share,
    };
    let sources = [
        last(Displacement::Flow(&change.backward), FLOW_REACH),
        last(
            Displacement::Motion(prediction.motion.inverse()),
            OBJECT_REACH,
        ),
        next(Displacement::Flow(&beyond.change.forward), FLOW_REACH),
        next(Displacement::Motion(prediction.motion), OBJECT_REACH),
    ];
    Some(votes(&change.next, window, &sources))
}

/// Returns the window within reach of the expected shape; `None` if nothing is expected.
fn window_of(expected: &Plane, reach: f32) -> Option<PixelWindow> {
    let (width, height) = (expected.width, expected.height);
    let mut found: Option<PixelWindow> = None;
    for (at, _) in expected
        .values
        .iter()
        .enumerate()
        .filter(|(_, value)| **value > SHAPE)
    {
        let (x, y) = (at % width, at / width);
        let window = found.get_or_insert(PixelWindow {
            left: x,
            top: y,
            right: x + 1,
            bottom: y + 1,
        });
        window.left = window.left.min(x);
        window.right = window.right.max(x + 1);
        window.bottom = y + 1;
    }
    let reach = reach.ceil() as usize + 1;
    found.map(|window| PixelWindow {
        left: window.left.saturating_sub(reach),
        top: window.top.saturating_sub(reach),
        right: (window.right + reach).min(width),
        bottom: (window.bottom + reach).min(height),
    })
}

/// Returns the distance in pixels of each window pixel from the expected shape.
fn distances(expected: &Plane, window: PixelWindow) -> Vec<f32> {
    let inside = window
        .places(expected.width)
        .map(|at| expected.values[at] > SHAPE)
        .collect();
    let region = Region {
        width: window.width() as u32,
        height: window.height() as u32,
        inside,
    };
    squared_distance_to(&region)
        .into_iter()
        .map(|squared| (squared as f32).sqrt())
        .collect()
}

/// Returns the log-odds per pixel of moving like the object; 0 if both motions are alike.
fn motion_odds<'a>(
    prediction: &Prediction,
    change: &'a FrameChange,
) -> impl Fn(Vec2, usize) -> f32 + use<'a> {
    let back: Affine2 = prediction.motion.inverse();
    let off_object = move |at: Vec2, place: usize| {
        (back.transform_point2(at) - at).distance(change.backward.vectors[place])
    };
    let background = change.background;
    let off_background = move |at: Vec2, place: usize| {
        background.map_or(0.0, |motion| {
            motion
                .displacement(at)
                .distance(change.backward.vectors[place])
        })
    };
    let width = change.next.width;
    let own = prediction
        .warped
        .values
        .iter()
        .enumerate()
        .filter(|(_, value)| **value > 0.5);
    let own: Vec<(Vec2, usize)> = own
        .map(|(at, _)| (Vec2::new((at % width) as f32, (at / width) as f32), at))
        .collect();
    let object_spread = median(own.iter().map(|&(p, at)| off_object(p, at))) + OBJECT_SPREAD_PX;
    let apart = median(own.iter().map(|&(p, at)| off_background(p, at)));
    let weight = ((apart - 2.0 * change.background_noise - 0.5) / 1.5).clamp(0.0, 1.0);
    let background_spread = change.background_noise + BACKGROUND_SPREAD_PX;
    move |at, place| {
        if weight == 0.0 {
            return 0.0;
        }
        let own = (-off_object(at, place) / object_spread).exp() + MIN_EVIDENCE;
        let other = (-off_background(at, place) / background_spread).exp() + MIN_EVIDENCE;
        weight * (own / other).ln().clamp(-MOST_MOTION, MOST_MOTION)
    }
}

/// The frame after the next and its mask.
///
/// The mask is the keyframe's own, or comes from the keyframe on that side.
pub(super) struct FrameAhead<'a> {
    /// Flow from the next frame to this one.
    pub change: &'a FrameChange,
    pub mask: LabelMask,
    /// Weight of its mask relative to the last frame's, 0–1.
    pub share: f32,
}
