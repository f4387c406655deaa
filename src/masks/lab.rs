//! Conversion from sRGB to CIE Lab (D65), in f32.

use std::sync::LazyLock;

use rayon::prelude::*;

use ostra_frames::Image;

const CURVE_STEPS: usize = 4096;

static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|value| {
        let value = value as f32 / 255.0;
        if value <= 0.040_45 {
            value / 12.92
        } else {
            ((value + 0.055) / 1.055).powf(2.4)
        }
    })
});

/// The cube-root curve of Lab, sampled over 0–1.
static CURVE: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..=CURVE_STEPS)
        .map(|step| {
            let value = step as f32 / CURVE_STEPS as f32;
            if value > 0.008_856 {
                value.cbrt()
            } else {
                7.787 * value + 16.0 / 116.0
            }
        })
        .collect()
});

/// Converts an image to CIE Lab: L 0–100, a and b about −100 to 100.
pub(crate) fn lab_of(image: &Image) -> Vec<[f32; 3]> {
    image
        .pixels
        .par_iter()
        .with_min_len(4096)
        .map(|&pixel| lab_of_pixel(pixel))
        .collect()
}

/// Converts one sRGB pixel to CIE Lab.
#[inline]
pub fn lab_of_pixel(pixel: [u8; 3]) -> [f32; 3] {
    let curve = &*CURVE;
    let bend = |value: f32| {
        let at = (value * CURVE_STEPS as f32).clamp(0.0, CURVE_STEPS as f32 - 1.0);
        let low = at as usize;
        curve[low] + (curve[low + 1] - curve[low]) * (at - low as f32)
    };
    let [r, g, b] = pixel.map(|channel| LINEAR[usize::from(channel)]);
    let x = bend((0.412_456 * r + 0.357_576 * g + 0.180_437 * b) / 0.950_47);
    let y = bend(0.212_673 * r + 0.715_152 * g + 0.072_175 * b);
    let z = bend((0.019_334 * r + 0.119_192 * g + 0.950_304 * b) / 1.088_83);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Returns the squared Euclidean distance of two Lab colours (ΔE 1976, squared).
#[inline]
pub fn squared_difference(a: [f32; 3], b: [f32; 3]) -> f32 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_colours_have_their_lab_values() {
        let image = Image {
            width: 3,
            height: 1,
            pixels: vec![[255, 255, 255], [255, 0, 0], [0, 0, 0]],
        };
        let lab = lab_of(&image);
        let expected = [[100.0, 0.0, 0.0], [53.24, 80.09, 67.20], [0.0, 0.0, 0.0]];
        for (found, expected) in lab.iter().zip(expected) {
            assert!(
                squared_difference(*found, expected).sqrt() < 0.3,
                "{found:?} instead of {expected:?}"
            );
        }
    }
}
