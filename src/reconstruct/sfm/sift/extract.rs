use super::borders::Content;
use super::descriptor::SUPPORT;
use super::keypoint::{SiftFeatures, SiftKeypoint};
use super::octave::Octave;
use super::options::SiftOptions;
use super::pyramid::{bases, level_sigma};
use super::refine::Extremum;
use super::shrink::shrunk;
use super::strongest::Strongest;
use glam::Vec2;

/// SIFT features of a grey picture (`width · height` values in 0..1, row by row), where `mask` (one value per pixel) is
/// true, everywhere without it; none whose surroundings touch a near-black bar at a side of the picture. Above
/// `max_features` the strongest stay. Empty where the lengths do not fit the size or
/// the options are out of range. Runs on rayon's threads; the result does not depend on how many there are.
///
/// D. Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV 2004.
#[must_use]
pub fn extract_sift(
    grey: &[f32],
    width: usize,
    height: usize,
    mask: Option<&[bool]>,
    options: &SiftOptions,
) -> SiftFeatures {
    let fits = grey.len() == width * height && mask.is_none_or(|mask| mask.len() == grey.len());
    if !fits || width.min(height) < SMALLEST_SIDE || !(1..=8).contains(&options.scales) {
        return SiftFeatures::default();
    }
    let (picture, pixel_size) = shrunk(grey, width, height, options.max_side as usize);
    let content = Content::of(grey, width, height);
    let allowed = |keypoint: &SiftKeypoint| {
        let [x, y] = [keypoint.at_px.x as usize, keypoint.at_px.y as usize];
        let pixel = y.min(height - 1) * width + x.min(width - 1);
        mask.is_none_or(|mask| mask[pixel])
            && content.holds(keypoint.at_px, SUPPORT * keypoint.scale_px)
    };
    let mut strongest = Strongest::new(options.max_features);
    let mut find = |octave: Octave, index: i32| {
        let keypoint = |extremum: &Extremum| {
            Some(keypoint(extremum, index, pixel_size, options)).filter(allowed)
        };
        octave.find(&keypoint, &mut strongest);
    };
    let coarser = bases(&picture, options)
        .into_iter()
        .enumerate()
        .skip(options.first_octave.max(0) as usize);
    for (octave, base) in coarser.rev() {
        find(Octave::of(base, options), octave as i32);
    }
    if options.first_octave < 0 {
        find(Octave::doubled(&picture, options), -1);
    }
    strongest.into_features()
}

/// Shortest side of a picture in pixels that is looked at.
const SMALLEST_SIDE: usize = 16;

/// A keypoint in pixels of the original picture, of which one pixel worked on spans `width` by `height`; without angle.
fn keypoint(
    extremum: &Extremum,
    octave: i32,
    [width, height]: [f32; 2],
    options: &SiftOptions,
) -> SiftKeypoint {
    let step = (octave as f32).exp2();
    SiftKeypoint {
        at_px: Vec2::new(
            (extremum.x * step + 0.5) * width,
            (extremum.y * step + 0.5) * height,
        ),
        scale_px: level_sigma(extremum.scale, options.scales) * step * (width * height).sqrt(),
        angle: 0.0,
    }
}
