use glam::{DVec2, DVec3};

use super::wall::{BORDER, SIZE, camera, frame, paint, painted, pose, seen, sparse};
use crate::stereo::filter::{CompleteOptions, FilterOptions};
use crate::stereo::patchmatch::PatchMatchOptions;
use crate::stereo::{
    DepthEstimate, DepthStore, InMemoryDepthStore, Stage, StereoEngine, StereoOptions,
    StereoRequest, estimate_depths,
};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};

const WIDTH: usize = SIZE.0 as usize;

/// Returns a camera's noise: a grey level or two, different in every image.
fn noise(view: usize, pixel: usize) -> f32 {
    let mixed = (pixel as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (view as u64 + 1).wrapping_mul(0xD1B5_4A32_D192_ED03);
    let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (mixed >> 62) as f32 - 1.5
}

/// Returns whether a point is on the wall in the middle of the images, 50 × 40 pixels.
fn is_inside(x: DVec3) -> bool {
    x.x.abs() < 0.5 && x.y.abs() < 0.4
}

/// Returns the first view's depth after all steps of stereo, of a wall that has texture in some places only.
fn depth(has_texture: impl Fn(DVec3) -> bool, prior_weight: f32) -> DepthEstimate {
    let folder = tempfile::tempdir().unwrap();
    let shown = |view: usize, at: usize, x: DVec3| if has_texture(x) { paint(x) } else { 90.0 } + noise(view, at);
    let of_view = |view: usize| {
        frame(
            folder.path(),
            view,
            &painted(&camera(), &pose(view), |at, x| {
                shown(view, at, x).clamp(0.0, 255.0)
            }),
        )
    };
    let (frames, sparse): (Vec<Frame>, _) = ((0..3).map(of_view).collect(), sparse(&[0, 1, 2]));
    let request = StereoRequest {
        frames: &frames,
        views: &[0, 1, 2],
        sparse: &sparse,
        mask: &|_, _| None,
        engine: &StereoEngine::Cpu,
    };
    let patchmatch = PatchMatchOptions {
        coarsest_px: 40,
        prior_weight,
        ..PatchMatchOptions::default()
    };
    // Each view by itself: nothing is taken over from others.
    let complete = CompleteOptions {
        color_difference: 0.0,
        ..CompleteOptions::default()
    };
    let filter = FilterOptions {
        complete,
        ..FilterOptions::default()
    };
    let options = StereoOptions {
        max_side: SIZE.0,
        patchmatch,
        filter,
        ..StereoOptions::default()
    };
    let (store, depths) = (FrameStore::new(1 << 20), InMemoryDepthStore::default());
    estimate_depths(&request, &store, &depths, &options, &Progress::default()).unwrap();
    depths
        .load(0, Stage::Complete)
        .unwrap()
        .unwrap()
        .as_ref()
        .clone()
}

/// Counts pixels away from the borders: those with depth, those whose depth is right to a third of a pixel, and all.
fn counted(estimate: &DepthEstimate, counts: impl Fn(DVec3) -> bool) -> (usize, usize, usize) {
    let (mut known, mut right, mut all) = (0, 0, 0);
    for at in 0..estimate.depths.len() {
        let (x, y) = (at % WIDTH, at / WIDTH);
        let (place, truth) = seen(&pose(0), DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        let within = (BORDER..WIDTH - BORDER).contains(&x)
            && (BORDER..SIZE.1 as usize - BORDER).contains(&y);
        if within && counts(place) {
            let depth = f64::from(estimate.depths[at]);
            all += 1;
            known += usize::from(depth > 0.0);
            right += usize::from((depth / truth - 1.0).abs() < 0.02);
        }
    }
    (known, right, all)
}

#[test]
fn wall_without_texture_between_textured_borders_is_found() {
    let inside = |x: DVec3| is_inside(x);
    let (_, without, _) = counted(&depth(|x| !is_inside(x), 0.0), inside);
    let (known, right, all) = counted(
        &depth(|x| !is_inside(x), PatchMatchOptions::default().prior_weight),
        inside,
    );
    assert!(
        right * 100 >= all * 93 && known * 100 <= right * 105,
        "{right} right of {known} of {all}"
    );
    assert!(
        without * 2 <= all,
        "{without} of {all} by their texture alone"
    );
}

/// Where a surface ends in front of a background without texture, it is not continued.
#[test]
fn board_in_front_of_a_flat_background_keeps_its_border() {
    let beyond = |x: DVec3| x.x.abs() > 0.6 || x.y.abs() > 0.5;
    let board = depth(is_inside, PatchMatchOptions::default().prior_weight);
    let (known, _, all) = counted(&board, beyond);
    assert!(all > 1000 && known * 30 <= all, "{known} of {all}");
    let (_, right, all) = counted(&board, is_inside);
    assert!(right * 10 >= all * 9, "{right} of {all}");
}
