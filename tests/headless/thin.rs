//! Tests the thin-structure tool on the synthetic scene.
//!
//! Three points along a blade or culm must give its ground-truth pixels.

use std::collections::VecDeque;
use std::time::Instant;

use glam::DVec2;
use ostra_eval::synthetic::{RenderedView, Scene, SceneOptions};
use ostra_masks::{LabelId, LabelMask, Region, squared_depth_in, trace};

/// Returns the number of steps from `start` to each reachable pixel of the region.
///
/// Gaps of one pixel are crossed.
fn steps_from(region: &Region, start: usize) -> Vec<Option<u32>> {
    let (width, height) = (i64::from(region.width), i64::from(region.height));
    let mut steps = vec![None; region.inside.len()];
    steps[start] = Some(0);
    let mut open = VecDeque::from([(start, 0)]);
    while let Some((at, step)) = open.pop_front() {
        let (x, y) = (at as i64 % width, at as i64 / width);
        for (u, v) in (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (x + dx, y + dy))) {
            let next = (v * width + u) as usize;
            if u >= 0
                && v >= 0
                && u < width
                && v < height
                && region.inside[next]
                && steps[next].is_none()
            {
                steps[next] = Some(step + 1);
                open.push_back((next, step + 1));
            }
        }
    }
    steps
}

/// Returns points along a connected region from end to end; `None` if it is not connected.
fn along(region: &Region, count: usize) -> Option<Vec<DVec2>> {
    let start = region.inside.iter().position(|&inside| inside)?;
    let farthest = |steps: &[Option<u32>]| (0..steps.len()).max_by_key(|&at| steps[at]);
    let steps = steps_from(region, farthest(&steps_from(region, start))?);
    let last = steps[farthest(&steps)?]?;
    if steps.iter().flatten().count() < region.area() {
        return None;
    }
    let depth = squared_depth_in(region);
    let point = |k: usize| {
        let wanted =
            (f64::from(last) * (0.02 + 0.96 * k as f64 / (count - 1) as f64)).round() as u32;
        let near = |at: &usize| steps[*at].is_some_and(|step| step.abs_diff(wanted) <= 1);
        let at = (0..steps.len()).filter(near).max_by_key(|&at| depth[at])?;
        let width = region.width as usize;
        Some(DVec2::new(
            (at % width) as f64 + 0.5,
            (at / width) as f64 + 0.5,
        ))
    };
    (0..count).map(point).collect()
}

/// Returns the long, connected parts of the plant: blades, and culms with their sheaths.
fn parts(scene: &Scene, mask: &LabelMask) -> Vec<(String, Region)> {
    let named = |wanted: &'static str| {
        scene
            .tree()
            .iter()
            .filter(move |label| label.name.ends_with(wanted))
    };
    let blades = named("blade").map(|label| (label.name.clone(), mask.region(label.id)));
    let green: Vec<LabelId> = named("sheath").map(|label| label.id).collect();
    let stems = scene
        .tree()
        .iter()
        .filter(|label| label.name.starts_with("stem "));
    let culms = stems.map(|stem| {
        let own = mask.region(stem.id);
        let mut all = own.clone();
        for &sheath in &green {
            let sheath = mask.region(sheath);
            let mut touching = sheath.dilated(1.5);
            touching.intersect(&own);
            if !touching.is_empty() {
                all.unite(&sheath);
            }
        }
        (stem.name.clone(), all)
    });
    blades
        .chain(culms)
        .filter(|(_, region)| region.area() >= 250)
        .collect()
}

fn score(scene: &Scene, view: &RenderedView, scores: &mut Vec<f64>) {
    for (name, truth) in parts(scene, &view.mask) {
        let Some(points) = along(&truth, 3) else {
            continue;
        };
        let began = Instant::now();
        let found = trace(&view.image, &points).unwrap();
        let iou = found.iou(&truth);
        println!(
            "{name}: IoU {iou:.3} of {} px, {:.0} ms",
            truth.area(),
            began.elapsed().as_secs_f64() * 1e3
        );
        scores.push(iou);
    }
}

#[test]
fn three_points_trace_a_blade_or_culm_of_the_synthetic_plant() {
    let scene = Scene::build(&SceneOptions::default()).unwrap();
    let mut scores = Vec::new();
    for at in [0, 8, 16, 23] {
        score(&scene, &scene.render(&scene.views()[at]), &mut scores);
    }
    scores.sort_by(f64::total_cmp);
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    let median = scores[scores.len() / 2];
    println!(
        "{} blades and culms by three points: IoU mean {mean:.3}, median {median:.3}",
        scores.len()
    );
    assert!(scores.len() >= 20, "{}", scores.len());
    assert!(
        mean >= 0.75 && median >= 0.84,
        "mean {mean:.3}, median {median:.3}"
    );
}

/// Returns the middle of the first, the middle and the last row of a region.
fn upright(region: &Region) -> Option<[DVec2; 3]> {
    let rows: Vec<u32> = (0..region.height)
        .filter(|&y| (0..region.width).any(|x| region.at(x, y)))
        .collect();
    let middle = |y: u32| {
        let inside: Vec<f64> = (0..region.width)
            .filter(|&x| region.at(x, y))
            .map(f64::from)
            .collect();
        DVec2::new(
            inside.iter().sum::<f64>() / inside.len() as f64,
            f64::from(y),
        ) + 0.5
    };
    Some([
        middle(*rows.first()?),
        middle(rows[rows.len() / 2]),
        middle(*rows.last()?),
    ])
}

#[test]
fn long_culm_in_a_large_image_is_traced_interactively() {
    let options = SceneOptions {
        width: 1280,
        height: 720,
        ..SceneOptions::default()
    };
    let scene = Scene::build(&options).unwrap();
    let view = scene.render(&scene.views()[12]);
    let culms = parts(&scene, &view.mask)
        .into_iter()
        .filter(|(name, _)| name.starts_with("stem"));
    let longest = culms
        .filter_map(|(_, truth)| upright(&truth))
        .max_by(|a, b| (a[2].y - a[0].y).total_cmp(&(b[2].y - b[0].y)));
    let points = longest.unwrap();
    let began = Instant::now();
    let found = trace(&view.image, &points).unwrap();
    let (length, ms) = (
        points[0].distance(points[2]),
        began.elapsed().as_secs_f64() * 1e3,
    );
    println!(
        "a culm of {length:.0} px in 1280 × 720: {} px in {ms:.0} ms",
        found.area()
    );
    assert!(
        length > 380.0 && found.area() > 1000,
        "{length:.0} px long, {} px",
        found.area()
    );
    assert!(ms < 1000.0, "{ms:.0} ms");
}
