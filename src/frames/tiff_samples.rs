use std::fs::File;
use std::io::{BufReader, Read, Seek};

use tiff::TiffResult;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{SampleFormat, Tag};

/// Bytes besides the pixels that a decoder may allocate: strips, tiles and tables of their offsets.
pub(super) const WORKING_BYTES: usize = 64 << 20;

/// Returns the variant of a TIFF for a message; `None` if it is unknown.
pub(super) fn variant_of(reader: &mut BufReader<File>) -> Option<String> {
    reader.rewind().ok()?;
    let mut decoder = Decoder::new(&mut *reader).ok()?;
    let bits = decoder
        .find_tag_unsigned_vec::<u16>(Tag::BitsPerSample)
        .ok()
        .flatten()
        .unwrap_or_default();
    let bits = bits.first().copied().unwrap_or(1);
    let samples = decoder
        .find_tag_unsigned::<u16>(Tag::SamplesPerPixel)
        .ok()
        .flatten()
        .unwrap_or(1);
    let kind = match sample_format(&mut decoder) {
        SampleFormat::IEEEFP => "floats",
        SampleFormat::Int => "signed integers",
        _ => "integers",
    };
    let photometric = decoder
        .find_tag_unsigned::<u16>(Tag::PhotometricInterpretation)
        .ok()
        .flatten();
    let compression = decoder
        .find_tag_unsigned::<u16>(Tag::Compression)
        .ok()
        .flatten()
        .unwrap_or(1);
    let what = match photometric {
        Some(3) => format!("a colour palette of {bits} bits"),
        Some(5) => format!("CMYK colours of {bits} bits"),
        Some(6) => format!("YCbCr colours of {bits} bits"),
        Some(8..=10) => format!("Lab colours of {bits} bits"),
        _ if samples > 1 => format!("{samples} bands of {bits}-bit {kind}"),
        _ => format!("one band of {bits}-bit {kind}"),
    };
    Some(if compression == 1 {
        what
    } else {
        format!("{what} (compression {compression})")
    })
}

/// Returns the values of a TIFF with one channel of depth, row by row; unknown values are 0.
pub(super) fn read_depth_samples(reader: impl Read + Seek, pixels: usize) -> TiffResult<Vec<f64>> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = pixels.saturating_mul(size_of::<f64>());
    limits.intermediate_buffer_size = limits.decoding_buffer_size.saturating_add(WORKING_BYTES);
    limits.ifd_value_size = WORKING_BYTES;
    let known = |value: f64| {
        if value.is_finite() && value > 0.0 {
            value
        } else {
            0.0
        }
    };
    Ok(
        match Decoder::new(reader)?.with_limits(limits).read_image()? {
            DecodingResult::U16(values) => below(values, u16::MAX),
            DecodingResult::U32(values) => below(values, u32::MAX),
            DecodingResult::I16(values) => below(values, i16::MAX),
            DecodingResult::I32(values) => below(values, i32::MAX),
            DecodingResult::F16(values) => values
                .into_iter()
                .map(|value| known(value.to_f64()))
                .collect(),
            DecodingResult::F32(values) => values
                .into_iter()
                .map(|value| known(value.into()))
                .collect(),
            DecodingResult::F64(values) => values.into_iter().map(known).collect(),
            _ => Vec::new(),
        },
    )
}

/// Returns integers as depth; `unknown`, the largest one, becomes 0.
///
/// Negative values are unknown, too.
fn below<T: Copy + Into<f64> + PartialEq>(values: Vec<T>, unknown: T) -> Vec<f64> {
    values
        .into_iter()
        .map(|value| {
            if value == unknown {
                0.0
            } else {
                value.into().max(0.0)
            }
        })
        .collect()
}

pub(super) fn sample_format(decoder: &mut Decoder<impl Read + Seek>) -> SampleFormat {
    let formats = decoder
        .find_tag_unsigned_vec::<u16>(Tag::SampleFormat)
        .ok()
        .flatten()
        .unwrap_or_default();
    formats.first().map_or(SampleFormat::Uint, |&format| {
        SampleFormat::from_u16(format).unwrap_or(SampleFormat::Void)
    })
}
