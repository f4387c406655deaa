/// Colours of resampled images go beyond their range by up to this part of it; they are clamped.
const TOLERANCE: f32 = 0.1;

/// What white can be in an image whose colours are floats.
const WHITES: [f32; 3] = [1.0, 255.0, 65535.0];

/// Converts colours and alpha to bytes. The format does not say what white is: it is the smallest of [`WHITES`] that
/// no colour exceeds by much, and likewise for the alpha.
///
/// # Errors
/// What is wrong and what to do, where a value is not a finite number, negative or larger than all of them.
pub(super) fn to_bytes(pixels: &[[f32; 4]]) -> Result<Vec<[u8; 4]>, String> {
    let (white, opaque) = (
        white_of(pixels)?,
        range_of(pixels.iter().map(|pixel| pixel[3]))?,
    );
    let byte = |value: f32, full: f32| (value / full * 255.0).round() as u8; // `as` clamps
    let bytes = |&[red, green, blue, alpha]: &[f32; 4]| {
        [
            byte(red, white),
            byte(green, white),
            byte(blue, white),
            byte(alpha, opaque),
        ]
    };
    Ok(pixels.iter().map(bytes).collect())
}

/// The value of white.
///
/// # Errors
/// As [`to_bytes`].
pub(super) fn white_of(pixels: &[[f32; 4]]) -> Result<f32, String> {
    range_of(pixels.iter().flat_map(|pixel| pixel[..3].iter().copied()))
}

fn range_of(values: impl Iterator<Item = f32>) -> Result<f32, String> {
    let (mut least, mut most) = (0.0_f32, 0.0_f32);
    for value in values {
        if !value.is_finite() {
            return Err(refused("one of them is not a finite number"));
        }
        (least, most) = (least.min(value), most.max(value));
    }
    let white = WHITES
        .into_iter()
        .find(|white| most <= white * (1.0 + TOLERANCE));
    match white {
        Some(white) if least >= -TOLERANCE * white => Ok(white),
        _ => Err(refused(&format!("they go from {least} to {most}"))),
    }
}

fn refused(why: &str) -> String {
    format!(
        "colours as floats must go from 0 to 1, 255 or 65535, but {why}; convert the image to a PNG of 8 or 16 bits with \
         the program that made it"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_is_found_from_the_range_and_other_ranges_are_refused() {
        let grey = |value: f32| [[0.0, 0.0, 0.0, 1.0], [value, value, value, 1.0]];
        for (value, white) in [
            (0.5, 1.0),
            (1.05, 1.0),
            (2.0, 255.0),
            (260.0, 255.0),
            (300.0, 65535.0),
            (0.0, 1.0),
        ] {
            assert_eq!(white_of(&grey(value)), Ok(white), "{value}");
        }
        assert_eq!(to_bytes(&grey(51.0)).unwrap()[1], [51, 51, 51, 255]);
        assert_eq!(to_bytes(&grey(0.2)).unwrap()[1], [51, 51, 51, 255]);
        assert_eq!(to_bytes(&grey(1.05)).unwrap()[1], [255; 4]);
        for value in [f32::NAN, f32::INFINITY, -0.5, 80_000.0] {
            assert!(to_bytes(&grey(value)).is_err(), "{value}");
        }
    }
}
