use pulp::Simd;

use super::plane::{Hypothesis, Transfer, WORST};
use super::posed_image::{ROUNDING, Texture};
use super::window::{FLAT_VARIANCE, NOISE, PADDED, Patch, SupportWindow, TAPS};

/// The bits of the sum of this and a byte are this number's bits plus the byte.
const COUNTING: f32 = 8_388_608.0;
/// Chromas count as equal up to this sum of differences (noise and JPEG artefacts), 0–255 each.
pub const SAME_CHROMA: f32 = 10.0;
/// Additional difference at which they count as completely different.
pub const CHROMA_RANGE: f32 = 40.0;
/// Cost of a flat patch that is flat in the source too: less than that of texture without
/// similarity, more than that of similar texture.
pub const FLAT_COST: f32 = 0.6;
/// Added to this cost where the source shows texture instead.
pub const UNLIKE_COST: f32 = 0.7;

impl Patch {
    /// Returns `1 − NCC` between a patch and its projection to a source image by its plane, 0–2.
    ///
    /// The weights are bilateral as in J. Schönberger et al., *Pixelwise View Selection for
    /// Unstructured Multi-View Stereo*, ECCV 2016. The cost is [`WORST`] if the source does not see the
    /// centre. A little noise is added to both variances, so that flat patches correlate with nothing.
    /// They are distinguished by the chroma difference of the centre, which does not change with the
    /// light, and counts less the more texture a patch has. Where a patch without texture lies on a
    /// surface that is known from the surroundings, lack of correlation is no evidence against it;
    /// texture in the source is.
    #[inline(always)]
    pub fn cost<S: Simd>(
        &self,
        simd: S,
        window: &SupportWindow,
        hypothesis: Hypothesis,
        transfer: &Transfer,
        texture: &Texture,
    ) -> f32 {
        let Hypothesis { plane, x, y } = hypothesis;
        let homography = &transfer.homography(plane, x, y);
        let [u, v, z] = homography[0];
        let (right, bottom) = (texture.last_column(), texture.last_row());
        // Without branches between the conditions.
        let is_inside =
            (u >= 0.0) & (v >= 0.0) & (u <= right * z) & (v <= bottom * z) & (z >= 1e-6);
        if !is_inside {
            return WORST;
        }
        let mut places = TapPositions {
            texels: [0; PADDED],
            share_x: [0.0; PADDED],
            share_y: [0.0; PADDED],
        };
        locate(simd, window, homography, texture, &mut places);
        let mut quads = [0u32; PADDED];
        for (quad, &texel) in quads.iter_mut().zip(&places.texels).take(TAPS) {
            *quad = texture.quads[texel as usize];
        }
        let scale = 1.0 / z;
        let chroma = texture.chroma_at(u * scale, v * scale);
        let off = (chroma[0] - self.chroma[0]).abs() + (chroma[1] - self.chroma[1]).abs();
        correlate(simd, self, &quads, &places, off)
    }
}

/// Texels between which the taps lie: the index of the upper left one, and the distance towards the
/// right and lower one.
struct TapPositions {
    texels: [u32; PADDED],
    share_x: [f32; PADDED],
    share_y: [f32; PADDED],
}

/// Computes the positions of all taps.
#[inline(always)]
fn locate<S: Simd>(
    simd: S,
    window: &SupportWindow,
    [at, right, down]: &[[f32; 3]; 3],
    texture: &Texture,
    places: &mut TapPositions,
) {
    let (x0, y0, z0) = (
        simd.splat_f32s(at[0]),
        simd.splat_f32s(at[1]),
        simd.splat_f32s(at[2]),
    );
    let (x1, y1, z1) = (
        simd.splat_f32s(right[0]),
        simd.splat_f32s(right[1]),
        simd.splat_f32s(right[2]),
    );
    let (x2, y2, z2) = (
        simd.splat_f32s(down[0]),
        simd.splat_f32s(down[1]),
        simd.splat_f32s(down[2]),
    );
    let last_x = simd.splat_f32s(texture.last_column());
    let last_y = simd.splat_f32s(texture.last_row());
    let (one, least) = (simd.splat_f32s(1.0), simd.splat_f32s(1e-6));
    let width = texture.width as u32;
    let (width, uncounted) = (
        simd.splat_u32s(width),
        simd.splat_u32s(ROUNDING.to_bits().wrapping_mul(width + 1)),
    );
    let ((dx, _), (dy, _)) = (S::as_simd_f32s(&window.dx), S::as_simd_f32s(&window.dy));
    let (texels, _) = S::as_mut_simd_u32s(&mut places.texels);
    let (share_x, _) = S::as_mut_simd_f32s(&mut places.share_x);
    let (share_y, _) = S::as_mut_simd_f32s(&mut places.share_y);
    for k in 0..TAPS.div_ceil(S::F32_LANES) {
        let x = mul_add(simd, dy[k], x2, mul_add(simd, dx[k], x1, x0));
        let y = mul_add(simd, dy[k], y2, mul_add(simd, dx[k], y1, y0));
        let z = mul_add(simd, dy[k], z2, mul_add(simd, dx[k], z1, z0));
        let scale = simd.div_f32s(one, simd.max_f32s(z, least));
        let (column, part_x) = split(simd, simd.mul_f32s(x, scale), last_x);
        let (row, part_y) = split(simd, simd.mul_f32s(y, scale), last_y);
        (share_x[k], share_y[k]) = (part_x, part_y);
        texels[k] = simd.sub_u32s(simd.add_u32s(simd.mul_u32s(row, width), column), uncounted);
    }
}

/// Returns `a · b + c`, rounded twice: if fused, processors and graphics cards would differ.
#[inline(always)]
fn mul_add<S: Simd>(simd: S, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
    simd.add_f32s(simd.mul_f32s(a, b), c)
}

/// Splits a position, clamped to the image, into the texel below it and the share of the way to the next.
///
/// The texel is given as the bits of [`ROUNDING`] plus its index.
#[inline(always)]
fn split<S: Simd>(simd: S, at: S::f32s, last: S::f32s) -> (S::u32s, S::f32s) {
    let at = simd.min_f32s(simd.max_f32s(at, simd.splat_f32s(0.0)), last);
    let rounding = simd.splat_f32s(ROUNDING);
    let counted = simd.add_f32s(simd.sub_f32s(at, simd.splat_f32s(0.5)), rounding);
    (
        simd.transmute_u32s_f32s(counted),
        simd.sub_f32s(at, simd.sub_f32s(counted, rounding)),
    )
}

/// Returns [`COUNTING`] plus the integers in the lowest 8 bits as floats.
#[inline(always)]
fn counted<S: Simd>(simd: S, bits: S::u32s) -> S::f32s {
    let byte = simd.and_u32s(bits, simd.splat_u32s(0xFF));
    simd.transmute_f32s_u32s(simd.or_u32s(byte, simd.splat_u32s(COUNTING.to_bits())))
}

/// Returns `1 − NCC` of a patch with bilinear samples, plus the cost of its chroma difference.
#[inline(always)]
fn correlate<S: Simd>(
    simd: S,
    patch: &Patch,
    quads: &[u32; PADDED],
    places: &TapPositions,
    chroma_off: f32,
) -> f32 {
    let (quads, _) = S::as_simd_u32s(quads);
    let (share_x, _) = S::as_simd_f32s(&places.share_x);
    let (share_y, _) = S::as_simd_f32s(&places.share_y);
    let ((weights, _), (weighted, _)) = (
        S::as_simd_f32s(&patch.weights),
        S::as_simd_f32s(&patch.weighted),
    );
    let (by_8, by_16, by_24) = (simd.splat_u32s(8), simd.splat_u32s(16), simd.splat_u32s(24));
    let (zero, counting) = (simd.splat_f32s(0.0), simd.splat_f32s(COUNTING));
    let (mut mean, mut square, mut cross) = (zero, zero, zero);
    for k in 0..TAPS.div_ceil(S::F32_LANES) {
        let (a, b) = (
            counted(simd, quads[k]),
            counted(simd, simd.wrapping_dyn_shr_u32s(quads[k], by_8)),
        );
        let c = counted(simd, simd.wrapping_dyn_shr_u32s(quads[k], by_16));
        let d = counted(simd, simd.wrapping_dyn_shr_u32s(quads[k], by_24));
        let above = mul_add(
            simd,
            share_x[k],
            simd.sub_f32s(b, a),
            simd.sub_f32s(a, counting),
        );
        let below = mul_add(
            simd,
            share_x[k],
            simd.sub_f32s(d, c),
            simd.sub_f32s(c, counting),
        );
        let value = mul_add(simd, share_y[k], simd.sub_f32s(below, above), above);
        let heavy = simd.mul_f32s(weights[k], value);
        mean = simd.add_f32s(mean, heavy);
        square = mul_add(simd, heavy, value, square);
        cross = mul_add(simd, weighted[k], value, cross);
    }
    let (mean, square) = (simd.reduce_sum_f32s(mean), simd.reduce_sum_f32s(square));
    let cross = simd.reduce_sum_f32s(cross);
    let variance = (square - mean * mean).max(0.0);
    let other = ((chroma_off - SAME_CHROMA) * (1.0 / CHROMA_RANGE)).clamp(0.0, 1.0);
    let color = patch.color_weight * other;
    let unlike =
        1.0 + color - cross * (1.0 / ((patch.variance + NOISE) * (variance + NOISE)).sqrt());
    let texture = (variance - NOISE).max(0.0);
    let flat = FLAT_COST + color + UNLIKE_COST * (texture * (1.0 / (texture + FLAT_VARIANCE)));
    unlike.min(flat + (1.0 - patch.flatness) * WORST).min(WORST)
}
