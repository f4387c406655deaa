use std::collections::BTreeMap;

use super::forest::Components;
use super::graph::Graph;
use super::odometry::Tried;
use super::scan::Scan;
use crate::sfm::Outcome;

/// Tells what became of each scan.
pub fn account(
    scans: &[Scan],
    tried: &[Tried],
    graph: &Graph,
    outcomes: &mut BTreeMap<usize, Outcome>,
) {
    let components = Components::new(scans.len(), graph.holding().map(|link| link.scans));
    let size = |scan: usize| {
        (0..scans.len())
            .filter(|&other| components.of(other) == components.of(scan))
            .count()
    };
    for (at, scan) in scans.iter().enumerate() {
        let outcome = if graph.poses[at].is_some() {
            registered(at, graph)
        } else {
            match size(at) {
                1 => unlike(at, scans, tried),
                frames => Outcome::Apart { frames },
            }
        };
        outcomes.insert(scan.frame, outcome);
    }
}

fn registered(at: usize, graph: &Graph) -> Outcome {
    let own = graph.holding().filter(|link| link.scans.contains(&at));
    let mut consistent: Vec<f64> = own.map(|link| link.agreement.consistent).collect();
    consistent.sort_unstable_by(f64::total_cmp);
    let median = consistent.get(consistent.len() / 2).copied().unwrap_or(0.0);
    Outcome::Registered {
        neighbours: consistent.len(),
        consistent: median,
    }
}

/// The frame that agrees most with one that agrees with none.
fn unlike(at: usize, scans: &[Scan], tried: &[Tried]) -> Outcome {
    let other = |[a, b]: [usize; 2]| if a == at { b } else { a };
    let nearest = tried
        .iter()
        .filter(|(pair, _)| pair.contains(&at))
        .filter_map(|(pair, result)| {
            Some((
                scans[other(*pair)].frame,
                result.as_ref().err()?.as_ref()?.consistent,
            ))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1));
    Outcome::Unlike { nearest }
}

/// Why no two frames were put together, in words.
#[must_use]
pub fn why_no_start(outcomes: &BTreeMap<usize, Outcome>) -> String {
    let count = |is: fn(&Outcome) -> bool| outcomes.values().filter(|outcome| is(outcome)).count();
    let (all, no_depth) = (
        outcomes.len(),
        count(|outcome| matches!(outcome, Outcome::NoDepth { .. })),
    );
    let no_camera = count(|outcome| matches!(outcome, Outcome::NoIntrinsics));
    if no_camera == all {
        return "the depth camera is not known; give --intrinsics FX,FY,CX,CY or --cameras, or --method sfm".into();
    }
    let unreadable: Vec<&String> = outcomes
        .values()
        .filter_map(|outcome| {
            if let Outcome::Unreadable { why } = outcome {
                Some(why)
            } else {
                None
            }
        })
        .collect();
    if let Some(why) = unreadable.first().filter(|_| unreadable.len() + 1 >= all) {
        return format!("{} of {all} frames cannot be read: {why}", unreadable.len());
    }
    format!(
        "no two of {all} frames agree in depth and picture ({no_depth} have too little depth, {no_camera} no known camera); \
         check the depth unit, the intrinsics and that each depth belongs to its picture, or give --method sfm"
    )
}
