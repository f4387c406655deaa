use super::wall::{SIZE, camera};
use crate::stereo::DepthEstimate;
use crate::stereo::filter::{SnapOptions, snapped};
use crate::stereo::patchmatch::{Texture, Tones};

const WIDTH: usize = SIZE.0 as usize;

/// Returns a strip of four columns at depth 1 in front of a wall at depth 2, too wide by `told` columns on the right.
fn strip(reported: usize) -> DepthEstimate {
    let mut estimate = DepthEstimate::empty(camera());
    estimate.normals.fill([0, 0, -127]);
    estimate.confidence.fill(255);
    for at in 0..estimate.depths.len() {
        estimate.depths[at] = if (70..74 + reported).contains(&(at % WIDTH)) {
            1.0
        } else {
            2.0
        };
    }
    estimate
}

/// Returns green in front of red, of one grey.
fn image(apart: f32) -> Texture {
    let count = WIDTH * SIZE.1 as usize;
    let chroma = |at: usize| {
        if (70..74).contains(&(at % WIDTH)) {
            [-apart, -apart]
        } else {
            [0.0, apart]
        }
    };
    let chroma = (0..count).map(chroma).collect();
    Texture::new(&Tones {
        width: WIDTH,
        height: SIZE.1 as usize,
        luma: vec![120.0; count],
        chroma,
    })
}

#[test]
fn border_moves_to_the_change_of_colour() {
    let (reported, options) = (strip(2), SnapOptions::default());
    assert_eq!(
        snapped(&reported, &image(60.0), &options).depths,
        strip(0).depths
    );
    assert_eq!(
        snapped(&reported, &image(0.0), &options).depths,
        reported.depths,
        "where colours do not differ, nothing moves"
    );
}
