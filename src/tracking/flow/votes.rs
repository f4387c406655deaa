//! Label votes by small patches of frames with known masks.
//!
//! The errors that remain between true neighbours are outlines that neither neighbour shows. With
//! true masks on every second frame of `bmx-trees`, the others have a mean J of 0.785 (`libby`
//! 0.921, the other five videos 0.958 to 0.991). J is 0.46 to 0.73 where twigs one or two pixels
//! wide pass in front of the rider.
//!
//! Tried without gain: patches along the background's motion, which the twigs follow (0.783; 0.774
//! within 8 px), a search twice as wide (0.780), and the shape that both neighbours predict by flow
//! and by the object's motion (0.783). (`cargo bench --bench flow -- --every 2`)

use glam::{Affine2, Vec2};
use rayon::prelude::*;
use wide::f32x8;

use super::plane::{Flow, Plane, corners};
use super::tracked_image::TrackedImage;
use ostra_masks::cut::PixelWindow;

/// Half width of a patch: pixels from its centre to its side.
const HALF: usize = 2;
/// Binomial weights across a patch, and their sum.
const BELL: [f32; 2 * HALF + 1] = [1.0, 4.0, 6.0, 4.0, 1.0];
const BELL_SUM: f32 = 16.0;
/// Standard deviation of the colour difference between patches, in Lab units.
const SPREAD: f32 = 6.0;
/// Weight of a and b relative to lightness.
const CHROMA: f32 = 1.5;
/// Standard deviation of the distance weight, as a share of the reach.
const NEAR: f32 = 0.67;
/// Total weight of similar patches at which a vote counts half.
const FEW: f32 = 0.1;
/// Margin added to the share on both sides before the odds are taken.
const UNCERTAIN: f32 = 0.05;
/// Rows of pixels that are processed together.
const BAND: usize = 16;
const LANES: usize = 8;

/// An image with a known mask, and where to search in it.
pub(super) struct VoteSource<'a> {
    pub image: &'a TrackedImage,
    /// Degree to which each pixel belongs to the object, 0–1.
    pub share: &'a Plane,
    /// Approximate position of a pixel in this image.
    pub way: Displacement<'a>,
    /// Search radius around that position in each direction, in pixels.
    pub reach: usize,
    /// Weight of the image's patches.
    pub weight: f32,
}

/// Mapping of pixels to another image.
#[derive(Clone, Copy)]
pub(super) enum Displacement<'a> {
    Flow(&'a Flow),
    Motion(Affine2),
}

impl Displacement<'_> {
    fn place(self, at: Vec2) -> Vec2 {
        match self {
            Self::Flow(flow) => at + flow.sample(at),
            Self::Motion(motion) => motion.transform_point2(at),
        }
    }
}

/// The vote of patches with known labels for one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Vote {
    /// Share of the object, 0–1.
    pub share: f32,
    /// Total weight of the patches that resemble the pixel's.
    pub alike: f32,
}

impl Vote {
    /// Returns the log-odds that the pixel is the object's; near 0 without similar patches.
    pub fn odds(self) -> f32 {
        let known = self.alike / (self.alike + FEW);
        known * ((self.share + UNCERTAIN) / (1.0 - self.share + UNCERTAIN)).ln()
    }
}

/// Computes each pixel's vote from similar patches of the sources, row by row.
///
/// The motion need not be exact for a thin part to be recovered: among the patches near its assumed
/// origin, those that show the part resemble it.
///
/// Method: Rousseau, Habas, Studholme, "A supervised patch-based approach for human brain
/// labeling", IEEE Transactions on Medical Imaging, 2011.
pub(super) fn votes(
    image: &TrackedImage,
    window: PixelWindow,
    sources: &[VoteSource<'_>],
) -> Vec<Vote> {
    let (width, height) = (window.width().next_multiple_of(LANES), window.height());
    let target = WindowPlanes::of(image, window, HALF, Displacement::Motion(Affine2::IDENTITY));
    let seen: Vec<WindowPlanes<4>> = sources
        .iter()
        .map(|source| WindowPlanes::of_source(source, window))
        .collect();
    let (mut shares, mut weights) = (vec![0.0f32; width * height], vec![0.0f32; width * height]);
    let bands = shares
        .par_chunks_mut(width * BAND)
        .zip(weights.par_chunks_mut(width * BAND));
    bands.enumerate().for_each(|(band, (shares, weights))| {
        let mut work = PatchSums::new(width, shares, weights);
        for (source, seen) in sources.iter().zip(&seen) {
            work.add(source, &target, seen, band * BAND);
        }
    });
    let rows = shares.chunks_exact(width).zip(weights.chunks_exact(width));
    let pixels = rows.flat_map(|(shares, weights)| shares.iter().zip(weights).take(window.width()));
    pixels
        .map(|(share, &alike)| Vote {
            share: share / alike.max(f32::MIN_POSITIVE),
            alike,
        })
        .collect()
}

/// Planes of a window with a margin: L, a, b and, for a source, the object's share.
struct WindowPlanes<const N: usize> {
    width: usize,
    values: [Vec<f32>; N],
}

impl WindowPlanes<3> {
    /// Samples an image at the pixels of a window and its margin.
    fn of(image: &TrackedImage, window: PixelWindow, margin: usize, way: Displacement<'_>) -> Self {
        Self::seen(image, window, margin, way, |at| weighed(image.lab[at]))
    }
}

impl WindowPlanes<4> {
    /// Samples a source as far as it is searched.
    fn of_source(source: &VoteSource<'_>, window: PixelWindow) -> Self {
        Self::seen(
            source.image,
            window,
            HALF + source.reach,
            source.way,
            |at| {
                let [l, a, b] = weighed(source.image.lab[at]);
                [l, a, b, source.share.values[at]]
            },
        )
    }
}

impl<const N: usize> WindowPlanes<N> {
    fn seen(
        image: &TrackedImage,
        window: PixelWindow,
        margin: usize,
        way: Displacement<'_>,
        values: impl Fn(usize) -> [f32; N] + Sync,
    ) -> Self {
        let width = window.width().next_multiple_of(LANES) + 2 * margin;
        let height = window.height() + 2 * margin;
        let corner = Vec2::new(window.left as f32, window.top as f32) - margin as f32;
        let pixel = |at: usize| {
            let at = way.place(corner + Vec2::new((at % width) as f32, (at / width) as f32));
            let (corner, weights) = corners(at, image.width, image.height);
            let mut seen = [0.0; N];
            for (at, weight) in corner.into_iter().zip(weights) {
                seen.iter_mut()
                    .zip(values(at))
                    .for_each(|(seen, value)| *seen += weight * value);
            }
            seen
        };
        let seen: Vec<[f32; N]> = (0..width * height)
            .into_par_iter()
            .with_min_len(4096)
            .map(pixel)
            .collect();
        Self {
            width,
            values: std::array::from_fn(|channel| seen.iter().map(|seen| seen[channel]).collect()),
        }
    }

    /// Returns a row of one plane, starting at column `x`.
    fn row(&self, channel: usize, x: usize, y: usize) -> &[f32] {
        &self.values[channel][y * self.width + x..(y + 1) * self.width]
    }
}

fn weighed([l, a, b]: [f32; 3]) -> [f32; 3] {
    [l, CHROMA * a, CHROMA * b]
}

/// Sums of a band of rows, and scratch buffers.
struct PatchSums<'a> {
    width: usize,
    shares: &'a mut [f32],
    weights: &'a mut [f32],
    /// Squared differences of pixels, with the margin of a patch.
    differences: Vec<f32>,
    column: Vec<f32>,
}

impl<'a> PatchSums<'a> {
    fn new(width: usize, shares: &'a mut [f32], weights: &'a mut [f32]) -> Self {
        let (wide, rows) = (width + 2 * HALF, shares.len() / width);
        Self {
            width,
            shares,
            weights,
            differences: vec![0.0; wide * (rows + 2 * HALF)],
            column: vec![0.0; wide],
        }
    }

    /// Adds the patches of a source to the rows from `top` on.
    fn add(
        &mut self,
        source: &VoteSource<'_>,
        target: &WindowPlanes<3>,
        seen: &WindowPlanes<4>,
        top: usize,
    ) {
        let (reach, weight) = (source.reach, source.weight);
        let spread = NEAR * reach.max(1) as f32;
        for dy in 0..=2 * reach {
            for dx in 0..=2 * reach {
                let away = Vec2::new(dx as f32, dy as f32) - reach as f32;
                self.compare(target, seen, top, dx, dy);
                let gain = weight.ln() - away.length_squared() / (2.0 * spread * spread);
                self.weigh(seen, top, dx, dy, gain);
            }
        }
    }

    /// Computes squared differences to the pixels `dx` columns and `dy` rows further on.
    fn compare(
        &mut self,
        target: &WindowPlanes<3>,
        seen: &WindowPlanes<4>,
        top: usize,
        dx: usize,
        dy: usize,
    ) {
        let wide = self.width + 2 * HALF;
        for (y, out) in self.differences.chunks_exact_mut(wide).enumerate() {
            let [l, a, b] = [0, 1, 2].map(|channel| &target.row(channel, 0, top + y)[..wide]);
            let [other_l, other_a, other_b] =
                [0, 1, 2].map(|channel| &seen.row(channel, dx, top + y + dy)[..wide]);
            for (x, out) in out.iter_mut().enumerate() {
                let (l, a, b) = (l[x] - other_l[x], a[x] - other_a[x], b[x] - other_b[x]);
                *out = l * l + a * a + b * b;
            }
        }
    }

    /// Adds the weights and weighted shares of the patches at offset (`dx`, `dy`).
    ///
    /// `gain` is the log-weight of an identical patch.
    fn weigh(&mut self, seen: &WindowPlanes<4>, top: usize, dx: usize, dy: usize, gain: f32) {
        let wide = self.width + 2 * HALF;
        let scale = f32x8::splat(-1.0 / (2.0 * SPREAD * SPREAD * BELL_SUM * BELL_SUM));
        let gain = f32x8::splat(gain);
        let sums = self
            .shares
            .chunks_exact_mut(self.width)
            .zip(self.weights.chunks_exact_mut(self.width));
        for (y, (share_sums, weight_sums)) in sums.enumerate() {
            let rows: [&[f32]; BELL.len()] =
                std::array::from_fn(|k| &self.differences[(y + k) * wide..][..wide]);
            for (x, out) in self.column[..wide].iter_mut().enumerate() {
                *out = (0..BELL.len()).map(|k| BELL[k] * rows[k][x]).sum();
            }
            let shares = &seen.row(3, dx + HALF, top + y + dy + HALF)[..self.width];
            let sums = share_sums
                .chunks_exact_mut(LANES)
                .zip(weight_sums.chunks_exact_mut(LANES));
            for (x, (share_sums, weight_sums)) in sums.enumerate() {
                let x = x * LANES;
                let sum = (0..BELL.len()).fold(f32x8::ZERO, |sum, k| {
                    eight(&self.column[x + k..]).mul_add(f32x8::splat(BELL[k]), sum)
                });
                let weight = sum.mul_add(scale, gain).exp();
                let share = weight.mul_add(eight(&shares[x..]), eight(share_sums));
                share_sums.copy_from_slice(&share.to_array());
                weight_sums.copy_from_slice(&(eight(weight_sums) + weight).to_array());
            }
        }
    }
}

fn eight(values: &[f32]) -> f32x8 {
    let values: [f32; LANES] = std::array::from_fn(|k| values[k]);
    f32x8::from(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_core::image::ImageSize;
    use ostra_frames::Image;

    const WIDTH: usize = 45;
    const HEIGHT: usize = 35;
    const WHOLE: PixelWindow = PixelWindow {
        left: 0,
        top: 0,
        right: WIDTH,
        bottom: HEIGHT,
    };

    /// Draws a red pole two pixels wide in front of a textured wall, or hidden behind it.
    fn image(pole: usize, is_hidden: bool) -> TrackedImage {
        let color = |x: usize, y: usize| {
            let grain = ((x / 2 * 7349) ^ (y / 2 * 9151)).wrapping_mul(0x9E37_79B1) >> 9 & 63;
            let is_pole = (pole..pole + 2).contains(&x) && !is_hidden;
            if is_pole {
                [180, 60, 50]
            } else {
                [70 + grain as u8; 3]
            }
        };
        let pixels = (0..WIDTH * HEIGHT)
            .map(|at| color(at % WIDTH, at / WIDTH))
            .collect();
        TrackedImage::new(
            &Image {
                width: WIDTH as u32,
                height: HEIGHT as u32,
                pixels,
            },
            ImageSize::new(WIDTH, HEIGHT),
        )
    }

    fn share(pole: Option<usize>) -> Plane {
        let inside = |x: usize| pole.is_some_and(|pole| (pole..pole + 2).contains(&x));
        Plane::from_fn(WIDTH, HEIGHT, |x, _| f32::from(u8::from(inside(x))))
    }

    fn source<'a>(image: &'a TrackedImage, share: &'a Plane, reach: usize) -> VoteSource<'a> {
        VoteSource {
            image,
            share,
            way: Displacement::Motion(Affine2::IDENTITY),
            reach,
            weight: 1.0,
        }
    }

    /// Counts the pixels with positive odds on and off the pole at column 21.
    fn found(votes: &[Vote]) -> (usize, usize) {
        let is_pole = |at: usize| (21..23).contains(&(at % WIDTH));
        let inside: Vec<usize> = (0..votes.len())
            .filter(|&at| votes[at].odds() > 0.0)
            .collect();
        let own = inside.iter().filter(|&&at| is_pole(at)).count();
        (own, inside.len() - own)
    }

    #[test]
    fn thin_pole_is_found_although_the_motion_is_off_by_more_than_its_width() {
        let (before, now) = (image(18, false), image(21, false));
        let share = share(Some(18));
        assert_eq!(
            found(&votes(&now, WHOLE, &[source(&before, &share, 4)])),
            (2 * HEIGHT, 0)
        );
        let (own, others) = found(&votes(&now, WHOLE, &[source(&before, &share, 0)]));
        assert!(
            own == 0 && others > 0,
            "where nothing is searched, it stays: {own} and {others}"
        );
    }

    #[test]
    fn flow_gives_the_search_position() {
        let (before, now) = (image(12, false), image(21, false));
        let share = share(Some(12));
        let flow = Flow {
            width: WIDTH,
            height: HEIGHT,
            vectors: vec![Vec2::new(-9.0, 0.0); WIDTH * HEIGHT],
        };
        let sources = [VoteSource {
            way: Displacement::Flow(&flow),
            ..source(&before, &share, 1)
        }];
        assert_eq!(found(&votes(&now, WHOLE, &sources)), (2 * HEIGHT, 0));
    }

    #[test]
    fn pole_hidden_in_one_source_is_found_in_the_other() {
        let (hidden, shown, now) = (image(0, true), image(23, false), image(21, false));
        let (none, there) = (share(None), share(Some(23)));
        let sources = [source(&hidden, &none, 4), source(&shown, &there, 4)];
        assert_eq!(found(&votes(&now, WHOLE, &sources)), (2 * HEIGHT, 0));
        let blind = votes(&now, WHOLE, &sources[..1]);
        let middle = blind[HEIGHT / 2 * WIDTH + 21];
        assert!(
            middle.odds().abs() < 0.1,
            "nothing like it was seen: {middle:?}"
        );
    }

    #[test]
    fn source_weight_scales_its_votes() {
        let (before, now) = (image(21, false), image(21, false));
        let (none, there) = (share(None), share(Some(21)));
        let mut sources = [source(&before, &none, 1), source(&before, &there, 1)];
        sources[1].weight = 3.0;
        let vote = votes(&now, WHOLE, &sources)[HEIGHT / 2 * WIDTH + 21];
        assert!((vote.share - 0.75).abs() < 0.01, "{vote:?}");
    }

    #[test]
    fn votes_in_a_window_equal_those_of_the_whole_image() {
        let (before, now) = (image(18, false), image(21, false));
        let share = share(Some(18));
        let whole = votes(&now, WHOLE, &[source(&before, &share, 3)]);
        let part = PixelWindow {
            left: 14,
            top: 9,
            right: 33,
            bottom: 31,
        };
        let of_part = votes(&now, part, &[source(&before, &share, 3)]);
        assert_eq!(of_part.len(), part.width() * part.height());
        for (vote, at) in of_part.iter().zip(part.places(WIDTH)) {
            assert!(
                (vote.share - whole[at].share).abs() < 1e-4
                    && (vote.alike - whole[at].alike).abs() < 1e-3
            );
        }
    }
}
