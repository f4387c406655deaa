use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use glam::DVec3;

use super::axis::Axis;
use super::body::{Body, BodyShape};
use super::extent::principal_axis;
use super::insertion::insertion_angle;
use super::medial::MedialCurve;
use super::point_sets::Meeting;
use super::trait_table::{Dimension, Trait, TraitRow};
use super::traits::{MeasureOptions, MeasuredLabel, points_of};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelTree};

/// Measures the angle (0–90 degrees) between two labels where they come closest, for each pair.
///
/// Each instance of the first label gives a row `angle_to_NAME`, where instance 1 has the most
/// points. The angle is the one to the closest instance of the second label. Where a ribbon leaves
/// a rod, it is the insertion angle that [`measure`](super::measure) also returns. The level and
/// the ground in the options have no effect.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if a label does not exist, has no large enough instance or has
/// no axis. The same error is returned if the labels of a pair are equal or nested. Returns
/// [`SceneError::Stopped`] if the job is stopped.
pub fn measure_angles(
    cloud: &LabelledCloud,
    pairs: &[[LabelId; 2]],
    options: &MeasureOptions,
    progress: &Progress,
) -> Result<Vec<TraitRow>, SceneError> {
    options.check()?;
    pairs
        .iter()
        .try_for_each(|&pair| check(&cloud.tree, pair))?;
    progress.stage("measure")?;
    let mut labels: BTreeMap<LabelId, MeasuredLabel> = BTreeMap::new();
    let mut rows = Vec::new();
    for (k, &pair) in pairs.iter().enumerate() {
        progress.step(k, pairs.len())?;
        for id in pair {
            if let Entry::Vacant(place) = labels.entry(id) {
                place.insert(with_pieces(cloud, id, options, progress)?);
            }
        }
        rows.extend(rows_of(
            &cloud.tree,
            pair.map(|id| &labels[&id]),
            options,
            progress,
        )?);
    }
    Ok(rows)
}

fn name(tree: &LabelTree, id: LabelId) -> &str {
    tree.get(id).map_or("", |label| label.name.as_str())
}

fn check(tree: &LabelTree, [a, b]: [LabelId; 2]) -> Result<(), SceneError> {
    let refuse = |text: String| Err(SceneError::Request(text));
    if let Some(missing) = [a, b].into_iter().find(|&id| tree.get(id).is_none()) {
        return refuse(format!(
            "there is no label {} to measure an angle of; choose two labels",
            missing.0
        ));
    }
    let [first, second] = [a, b].map(|id| name(tree, id));
    if a == b {
        return refuse(format!(
            "an angle needs two labels, and '{first}' was given twice; choose another one"
        ));
    }
    let holds = |outer: LabelId, inner: LabelId| tree.path(inner).contains(&outer);
    if holds(a, b) || holds(b, a) {
        let (part, whole) = if holds(a, b) {
            (second, first)
        } else {
            (first, second)
        };
        return refuse(format!(
            "'{part}' is a part of '{whole}'; an angle needs two labels without common points"
        ));
    }
    Ok(())
}

fn with_pieces(
    cloud: &LabelledCloud,
    id: LabelId,
    options: &MeasureOptions,
    progress: &Progress,
) -> Result<MeasuredLabel, SceneError> {
    let name = name(&cloud.tree, id);
    let refuse = |why: String| {
        Err(SceneError::Request(format!(
            "no angle can be computed for '{name}': {why}"
        )))
    };
    let points = points_of(cloud, id);
    if points.is_empty() {
        return refuse("it has no points in the cloud; fuse masks that show it".into());
    }
    let measured = MeasuredLabel::new(id, &points, options, progress)?;
    if measured.bodies.is_empty() {
        let least = options.min_points;
        return refuse(format!(
            "none of its parts has {least} points or more; fuse with smaller voxels"
        ));
    }
    Ok(measured)
}

fn rows_of(
    tree: &LabelTree,
    [a, b]: [&MeasuredLabel; 2],
    options: &MeasureOptions,
    progress: &Progress,
) -> Result<Vec<TraitRow>, SceneError> {
    let names = [a.id, b.id].map(|id| name(tree, id));
    let mut rows = Vec::new();
    for (k, body) in a.bodies.iter().enumerate() {
        let Some((other, meeting)) = nearest(body, &b.bodies, progress)? else {
            continue;
        };
        let Some((angle, how)) = angle([body, other], names, meeting, options.insertion_reach)
        else {
            continue;
        };
        let (points, name) = (
            body.points.len() + other.points.len(),
            format!("angle_to_{}", names[1]),
        );
        rows.push(Trait::new(name, angle, Dimension::Angle, how, points).row(tree, a.id, k + 1));
    }
    if !rows.is_empty() {
        return Ok(rows);
    }
    let is_round = |measured: &MeasuredLabel| {
        measured
            .bodies
            .iter()
            .all(|body| axis_near(body, DVec3::ZERO, 1.0).is_none())
    };
    let round = if is_round(a) { names[0] } else { names[1] };
    Err(SceneError::Request(format!(
        "no angle can be computed for '{round}': it has no clear direction, being about as broad as it is long"
    )))
}

/// Returns the closest body and the place where it is closest.
///
/// Among bodies that are about equally close, the longest wins: a culm rather than a crumb next to
/// it.
fn nearest<'a>(
    body: &Body,
    others: &'a [Body],
    progress: &Progress,
) -> Result<Option<(&'a Body, Meeting)>, SceneError> {
    let mut met = Vec::new();
    for other in others {
        progress.check()?;
        met.extend(Meeting::of(&body.points, &other.points).map(|meeting| (other, meeting)));
    }
    let least = met
        .iter()
        .map(|(_, meeting)| meeting.gap())
        .fold(f64::INFINITY, f64::min);
    met.retain(|(other, meeting)| meeting.gap() <= least + 0.5 * other.breadth());
    Ok(met
        .into_iter()
        .max_by(|(a, _), (b, _)| a.length().total_cmp(&b.length())))
}

/// Returns the angle in degrees and how it was measured.
fn angle(
    bodies: [&Body; 2],
    names: [&str; 2],
    meeting: Meeting,
    reach: f64,
) -> Option<(f64, String)> {
    let apart = if meeting.gap() > reach_of(bodies[0], reach) {
        "; they do not meet"
    } else {
        ""
    };
    let inserted = match bodies.map(|body| body.shape) {
        [BodyShape::Ribbon(_), BodyShape::Rod(_)] => Some((0, 1)),
        [BodyShape::Rod(_), BodyShape::Ribbon(_)] => Some((1, 0)),
        _ => None,
    };
    let leaves = |(sheet, rod): (usize, usize)| {
        let (angle, _) = insertion_angle(
            bodies[sheet],
            [(LabelId::NONE, bodies[rod])].into_iter(),
            reach,
        )?;
        let [sheet, rod] = [names[sheet], names[rod]];
        let how = format!(
            "angle between the axis of {rod} where {sheet} leaves it and the chord of the first part of the"
        );
        Some((angle, format!("{how} midrib of {sheet}, 0 to 90{apart}")))
    };
    inserted.and_then(leaves).or_else(|| {
        let axes = [
            axis_near(bodies[0], meeting.a, reach)?,
            axis_near(bodies[1], meeting.b, reach)?,
        ];
        let angle = axes[0].angle_between(axes[1]).to_degrees();
        let [first, second] = [0, 1].map(|k| axis_name(bodies[k], names[k]));
        Some((
            angle.min(180.0 - angle),
            format!("angle between {first} and {second}, 0 to 90{apart}"),
        ))
    })
}

/// Returns the length of the part of a body that gives its direction.
///
/// It is `reach`, or the breadth of a thicker body, limited to the body's length.
fn reach_of(body: &Body, reach: f64) -> f64 {
    reach
        .max(body.breadth())
        .min(body.length().max(f64::MIN_POSITIVE))
}

/// Returns the unit direction of a body near a point on it.
///
/// Returns `None` for a body that is as broad as it is long.
fn axis_near(body: &Body, at: DVec3, reach: f64) -> Option<DVec3> {
    let span = reach_of(body, reach);
    let about = |curve: &MedialCurve| {
        let middle = curve
            .nearest(at)
            .at
            .clamp(0.5 * span, (curve.length() - 0.5 * span).max(0.5 * span));
        Axis {
            x: curve.point_at(middle),
            along: curve.direction_about(middle, span),
        }
    };
    match (body.shape, &body.curve) {
        (BodyShape::Rod(breadths), Some(curve)) => Some(
            about(curve)
                .fitted(&body.points, 0.5 * breadths.median, 0.5 * span)
                .along,
        ),
        (BodyShape::Ribbon(_), Some(curve)) => Some(about(curve).along),
        _ => principal_axis(&body.points),
    }
}

fn axis_name(body: &Body, name: &str) -> String {
    match body.shape {
        BodyShape::Rod(_) => {
            format!("the axis of {name} (a cylinder fitted where they come nearest)")
        }
        BodyShape::Ribbon(_) => {
            format!("the chord of the midrib of {name} where they come nearest")
        }
        BodyShape::Lump => format!("the longest principal axis of {name}"),
    }
}
