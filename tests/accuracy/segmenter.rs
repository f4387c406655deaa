//! Tests of the built-in segmenter with a simulated user, on real videos with ground truth.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ostra_core::job::Progress;
use ostra_eval::simulated_click::next_click;
use ostra_frames::Image;
use ostra_masks::graph_cut::BuiltinSegmenter;
use ostra_masks::{Prompt, Region, SegmentRequest, Segmenter};
use rayon::prelude::*;

use crate::data::data_dir;

/// Maximum number of clicks.
const CAP: usize = 20;

/// Returns the image and ground-truth paths of the first, middle and last frame of every clip.
fn frames(root: &Path) -> Vec<(PathBuf, PathBuf)> {
    let mut frames = Vec::new();
    for clip in sorted(&root.join("JPEGImages")) {
        let images = sorted(&clip);
        for at in [0, images.len() / 2, images.len() - 1] {
            let truth = root
                .join("Annotations")
                .join(clip.file_name().unwrap())
                .join(format!("{at:05}.png"));
            frames.push((images[at].clone(), truth));
        }
    }
    frames
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    paths
}

/// Returns the IoU after each click into the largest error.
///
/// The last value fills the list up to `CAP`.
fn play((image, truth): &(PathBuf, PathBuf)) -> Vec<f64> {
    let image = image::open(image).unwrap().to_rgb8();
    let (width, height) = image.dimensions();
    let image = Arc::new(Image {
        width,
        height,
        pixels: image.pixels().map(|pixel| pixel.0).collect(),
    });
    let truth = image::open(truth).unwrap().to_luma8();
    let truth = Region {
        width,
        height,
        inside: truth.pixels().map(|pixel| pixel.0[0] > 127).collect(),
    };
    let frame = BuiltinSegmenter
        .prepare(&image, None, &Progress::default())
        .unwrap();
    let (mut prompt, mut answer, mut ious) =
        (Prompt::default(), Region::empty(width, height), Vec::new());
    while let Some(click) = next_click(&truth, &answer).filter(|_| ious.len() < CAP) {
        prompt.clicks.push(click);
        let previous = (prompt.clicks.len() > 1).then_some(&answer);
        let request = SegmentRequest {
            prompt: &prompt,
            previous,
            taken: None,
        };
        answer = frame.segment(&request, &Progress::default()).unwrap();
        ious.push(iou(&truth, &answer));
    }
    ious.resize(CAP, *ious.last().unwrap());
    ious
}

fn iou(a: &Region, b: &Region) -> f64 {
    let pairs = || a.inside.iter().zip(&b.inside);
    let both = pairs().filter(|(a, b)| **a && **b).count();
    both as f64 / pairs().filter(|(a, b)| **a || **b).count() as f64
}

fn simulated_user_needs_few_clicks_and_no_click_lowers_the_mean() {
    let data = data_dir();
    let runs: Vec<Vec<f64>> = frames(&data.join("davis2016"))
        .par_iter()
        .map(play)
        .collect();
    let count = runs.len() as f64;
    let clicks: Vec<Option<usize>> = runs
        .iter()
        .map(|ious| ious.iter().position(|&iou| iou >= 0.85))
        .collect();
    let to_goal = clicks
        .iter()
        .map(|at| at.map_or(CAP, |at| at + 1) as f64)
        .sum::<f64>()
        / count;
    let failed = clicks.iter().filter(|at| at.is_none()).count();
    let means: Vec<f64> = (0..CAP)
        .map(|after| runs.iter().map(|ious| ious[after]).sum::<f64>() / count)
        .collect();
    println!(
        "clicks to 0.85: {to_goal:.2}, {failed} of {count} failed; mean IoU after each click {means:.3?}"
    );
    assert!(
        to_goal <= 10.5 && failed <= 5,
        "{to_goal} clicks, {failed} failed"
    );
    assert!(means[2] >= 0.70 && means[CAP - 1] >= 0.88, "{means:?}");
    assert!(
        means.is_sorted(),
        "a further click lowers the mean: {means:?}"
    );
}

crate::registry::tests! {
    Data(&["davis2016"]) => simulated_user_needs_few_clicks_and_no_click_lowers_the_mean;
}
