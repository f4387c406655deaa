use exif::{Exif, In, Reader, Tag, Value};

use super::{Frame, ImageSource};

/// Diagonal in millimetres of the 36 × 24 mm image that "35 mm" focal lengths refer to.
const DIAGONAL_35MM: f64 = 43.266_615_305_567_87;

/// Returns the focal length in pixels from the EXIF data of a frame's image file.
///
/// `None` if there is none, for videos and for files that cannot be read.
#[must_use]
pub fn exif_focal_px(frame: &Frame) -> Option<f64> {
    let ImageSource::File { path, .. } = &frame.image else {
        return None;
    };
    let mut reader = std::io::BufReader::new(ostra_core::disk::open_regular(path).ok()?);
    let exif = Reader::new().read_from_container(&mut reader).ok()?;
    focal_px(&exif, f64::from(frame.width), f64::from(frame.height))
}

/// Returns the focal length in pixels from the 35 mm equivalent focal length, else from the sensor's resolution.
fn focal_px(exif: &Exif, width: f64, height: f64) -> Option<f64> {
    let equivalent =
        number(exif, Tag::FocalLengthIn35mmFilm).map(|mm| mm * width.hypot(height) / DIAGONAL_35MM);
    let focal = equivalent.or_else(|| {
        let unit_mm = match number(exif, Tag::FocalPlaneResolutionUnit)? as u32 {
            2 => 25.4,
            3 => 10.0,
            4 => 1.0,
            _ => return None,
        };
        let recorded = number(exif, Tag::PixelXDimension).unwrap_or(width.max(height));
        let shrunk = width.max(height) / recorded;
        Some(
            number(exif, Tag::FocalLength)? * number(exif, Tag::FocalPlaneXResolution)? / unit_mm
                * shrunk,
        )
    });
    // Cameras may write invalid values: a lens does not see less than 2° or more than 170° across.
    focal.filter(|focal| (0.04..30.0).contains(&(focal / width.max(height))))
}

fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let field = exif.get_field(tag, In::PRIMARY)?;
    let value = match &field.value {
        Value::Rational(values) => values.first()?.to_f64(),
        value => f64::from(value.get_uint(0)?),
    };
    (value.is_finite() && value > 0.0).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns little-endian EXIF data with the entries in IFD0 or the EXIF IFD.
    fn exif(entries: &[(u16, Entry)]) -> Exif {
        let mut data = Vec::from(*b"II\x2a\0\x08\0\0\0");
        let exif_ifd = 8 + 2 + 12 + 4;
        data.extend(1u16.to_le_bytes());
        data.extend(entry(0x8769, 4, exif_ifd));
        data.extend(0u32.to_le_bytes());
        data.extend((entries.len() as u16).to_le_bytes());
        let mut rest = Vec::new();
        let after = exif_ifd + 2 + 12 * entries.len() as u32 + 4;
        for &(tag, value) in entries {
            match value {
                Entry::Short(value) => data.extend(entry(tag, 3, value.into())),
                Entry::Rational(over, under) => {
                    data.extend(entry(tag, 5, after + rest.len() as u32));
                    rest.extend(over.to_le_bytes());
                    rest.extend(under.to_le_bytes());
                }
            }
        }
        data.extend(0u32.to_le_bytes());
        data.extend(rest);
        Reader::new().read_raw(data).unwrap()
    }

    #[derive(Clone, Copy)]
    enum Entry {
        Short(u16),
        Rational(u32, u32),
    }

    fn entry(tag: u16, kind: u16, value: u32) -> Vec<u8> {
        [
            &tag.to_le_bytes()[..],
            &kind.to_le_bytes(),
            &1u32.to_le_bytes(),
            &value.to_le_bytes(),
        ]
        .concat()
    }

    #[test]
    fn focal_length_from_the_35_mm_equivalent() {
        let reported = exif(&[(0xa405, Entry::Short(26))]);
        let focal = focal_px(&reported, 4032.0, 3024.0).unwrap();
        assert!((focal - 3028.7).abs() < 0.1, "{focal}");
        assert_eq!(
            focal_px(&exif(&[(0xa405, Entry::Short(0))]), 4032.0, 3024.0),
            None,
            "0 means unknown"
        );
    }

    #[test]
    fn focal_length_from_the_sensor_resolution() {
        let reported = exif(&[
            (0x920a, Entry::Rational(50, 1)),
            (0xa002, Entry::Short(4000)),
            (0xa20e, Entry::Rational(400_000, 100)),
            (0xa210, Entry::Short(2)),
        ]);
        let focal = focal_px(&reported, 2000.0, 1000.0).unwrap();
        assert!((focal - 50.0 * 4000.0 / 25.4 * 0.5).abs() < 1e-9, "{focal}");
    }

    #[test]
    fn focal_length_is_unknown_without_resolution() {
        assert_eq!(
            focal_px(&exif(&[(0x920a, Entry::Rational(50, 1))]), 2000.0, 1000.0),
            None
        );
    }
}
