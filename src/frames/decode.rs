//! Decoding of image and depth files into pixels.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::complete::{is_complete_jpeg, webp_frames_fit};
use super::frame::turn;
use super::header::{Content, Header, cannot_decode, cut_off, damaged, format_of, header_in, open};
use super::tiff_samples::WORKING_BYTES;
use super::tiff_samples::read_depth_samples;
use super::{DepthMap, FrameError, Image, Orientation};

// Nothing here may run on rayon's pool. A thread that waits there for parts of its own image could
// steal work that requests the same image from the cache, and wait for itself.

/// Grey value that replaces transparent pixels.
///
/// Their own colours are not shown: programs that cut out an object often leave the background's
/// colours under an alpha of 0.
const BEHIND: u8 = 128;

/// Distance in pixels up to which neighbours of a transparent pixel count as transparent, too.
///
/// Features on the edge of a cut-out object do not belong to a point on it.
const EDGE_PX: usize = 3;

/// Bytes that a decoder may allocate for a pixel: twice the size of 16-bit colours with alpha.
const WORKING_BYTES_PER_PIXEL: u64 = 16;

/// Returns an error if an image does not have the expected size, as shown; called before decoding.
pub(super) type CheckSize<'a> = &'a dyn Fn((u32, u32)) -> Result<(), FrameError>;

/// Decodes an image file and rotates it upright; transparent pixels become grey.
pub(super) fn decode_image(
    path: &Path,
    orientation: Orientation,
    check: CheckSize<'_>,
) -> Result<Image, FrameError> {
    let source = ImageFile::open(path, orientation, check)?;
    if source.header.content.is_float_color() {
        let Upright {
            size,
            values: pixels,
        } = source.read_float_colors()?;
        let pixels = pixels.into_iter().map(over_grey).collect();
        return Ok(Image {
            width: size.0,
            height: size.1,
            pixels,
        });
    }
    let pixels = source.read::<[u8; 3]>(|decoder| {
        let size = decoder.dimensions();
        match decoder.color_type() {
            ColorType::Rgb8 => {
                let mut pixels = vec![[0; 3]; size.0 as usize * size.1 as usize];
                decoder.read_image(bytemuck::cast_slice_mut(&mut pixels))?;
                Ok(pixels)
            }
            color if color.has_alpha() => {
                let image = DynamicImage::from_decoder(decoder)?.into_rgba8();
                Ok(image.pixels().map(|pixel| over_grey(pixel.0)).collect())
            }
            _ => {
                let image = DynamicImage::from_decoder(decoder)?.into_rgb8();
                Ok(bytemuck::cast_slice(image.as_raw()).to_vec())
            }
        }
    })?;
    let (width, height) = pixels.size;
    Ok(Image {
        width,
        height,
        pixels: pixels.values,
    })
}

/// Returns the value of white in an image with float colours, which is decoded for this.
pub(super) fn float_white(path: &Path) -> Result<f32, FrameError> {
    let source = ImageFile::open(path, Orientation::default(), &|_| Ok(()))?;
    let pixels = source.read(float_colors)?;
    white_of(&pixels.values).map_err(|what| FrameError::Invalid {
        path: path.into(),
        what,
    })
}

fn float_colors(decoder: Box<dyn ImageDecoder + '_>) -> image::ImageResult<Vec<[f32; 4]>> {
    let image = DynamicImage::from_decoder(decoder)?;
    Ok(match image {
        DynamicImage::ImageRgba32F(image) => image.pixels().map(|pixel| pixel.0).collect(),
        image => image
            .into_rgb32f()
            .pixels()
            .map(|pixel| [pixel[0], pixel[1], pixel[2], 1.0])
            .collect(),
    })
}

/// Returns which pixels of an upright image are opaque and not next to a transparent one.
///
/// `None` for an image that is opaque everywhere.
pub(super) fn opaque_pixels(
    path: &Path,
    orientation: Orientation,
    check: CheckSize<'_>,
) -> Result<Option<Vec<bool>>, FrameError> {
    let source = ImageFile::open(path, orientation, check)?;
    let is_opaque = |pixel: [u8; 4]| pixel[3] >= 128;
    let (size, opaque): (_, Vec<bool>) = match source.header.content {
        Content::ColorAlpha => {
            let opaque = source.read(|decoder| {
                let image = DynamicImage::from_decoder(decoder)?.into_rgba8();
                Ok(image.pixels().map(|pixel| is_opaque(pixel.0)).collect())
            })?;
            (opaque.size, opaque.values)
        }
        Content::FloatColorAlpha => {
            let Upright {
                size,
                values: pixels,
            } = source.read_float_colors()?;
            (size, pixels.into_iter().map(is_opaque).collect())
        }
        _ => return Ok(None),
    };
    if opaque.iter().all(|&opaque| opaque) {
        return Ok(None);
    }
    Ok(Some(shrunk(&opaque, size.0 as usize)))
}

/// Decodes a depth image to world units and rotates it upright; unknown values become 0.
pub(super) fn decode_depth(
    path: &Path,
    unit: f64,
    orientation: Orientation,
    check: CheckSize<'_>,
) -> Result<DepthMap, FrameError> {
    let source = ImageFile::open(path, orientation, check)?;
    let in_world = |value: f64| (value * unit) as f32;
    let depths = match (source.header.content, source.format) {
        (Content::Grey16 | Content::IntegerDepth | Content::FloatDepth, ImageFormat::Tiff) => {
            source.read_tiff(in_world)?
        }
        (Content::Grey16, _) => source.read(|decoder| {
            let (width, height) = decoder.dimensions();
            let mut steps = vec![0_u16; width as usize * height as usize];
            decoder.read_image(bytemuck::cast_slice_mut(&mut steps))?;
            let known = |step: u16| {
                if step == u16::MAX {
                    0.0
                } else {
                    in_world(step.into())
                }
            };
            Ok(steps.into_iter().map(known).collect())
        })?,
        _ => return Err(not_depth(path)),
    };
    let (width, height) = depths.size;
    Ok(DepthMap {
        width,
        height,
        depths: depths.values,
    })
}

/// Returns the error for an image that is given as depth but is not.
pub(super) fn not_depth(path: &Path) -> FrameError {
    let what = "depth must be a grey image of 16 bits (PNG or TIFF) or of floats (TIFF), and this one is not; \
                give the folder with the measured depth, not one drawn for viewing";
    FrameError::Invalid {
        path: path.into(),
        what: what.into(),
    }
}

fn over_grey([red, green, blue, alpha]: [u8; 4]) -> [u8; 3] {
    let (share, rest) = (
        u32::from(alpha),
        u32::from(BEHIND) * (255 - u32::from(alpha)),
    );
    [red, green, blue].map(|value| ((u32::from(value) * share + rest + 127) / 255) as u8)
}

/// Returns the pixels with only opaque ones within [`EDGE_PX`] rows and columns.
fn shrunk(opaque: &[bool], width: usize) -> Vec<bool> {
    let mut in_rows = vec![false; opaque.len()];
    for (row, out) in opaque
        .chunks_exact(width)
        .zip(in_rows.chunks_exact_mut(width))
    {
        for (x, out) in out.iter_mut().enumerate() {
            *out = row[x.saturating_sub(EDGE_PX)..width.min(x + EDGE_PX + 1)]
                .iter()
                .all(|&opaque| opaque);
        }
    }
    let height = opaque.len() / width.max(1);
    let whole = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        (y.saturating_sub(EDGE_PX)..height.min(y + EDGE_PX + 1)).all(|y| in_rows[y * width + x])
    };
    (0..opaque.len()).map(whole).collect()
}

/// An image file after its header was read and checked.
struct ImageFile<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    format: ImageFormat,
    header: Header,
    orientation: Orientation,
}

/// Values of an image's pixels, rotated upright.
struct Upright<T> {
    size: (u32, u32),
    values: Vec<T>,
}

impl<'a> ImageFile<'a> {
    fn open(
        path: &'a Path,
        orientation: Orientation,
        check: CheckSize<'_>,
    ) -> Result<Self, FrameError> {
        let mut reader = open(path)?;
        let format = format_of(&mut reader, path)?;
        let header = header_in(&mut reader, format, path)?;
        check(orientation.shown_size(header.width, header.height))?;
        let io = |reason| FrameError::io(path, reason);
        let complete = match format {
            ImageFormat::Jpeg => is_complete_jpeg(&mut reader).map_err(io)?,
            ImageFormat::WebP
                if !webp_frames_fit(&mut reader, header.width, header.height).map_err(io)? =>
            {
                return Err(damaged(
                    path,
                    &"its frames have another size than its header",
                ));
            }
            _ => true,
        };
        if !complete {
            return Err(cut_off(path));
        }
        std::io::Seek::rewind(&mut reader).map_err(io)?;
        Ok(Self {
            path,
            reader,
            format,
            header,
            orientation,
        })
    }

    fn read<T: Copy + Default>(
        mut self,
        decode: impl FnOnce(Box<dyn ImageDecoder + '_>) -> image::ImageResult<Vec<T>>,
    ) -> Result<Upright<T>, FrameError> {
        let pixels = u64::from(self.header.width) * u64::from(self.header.height);
        let mut limits = Limits::default();
        limits.max_alloc = Some(pixels * WORKING_BYTES_PER_PIXEL + WORKING_BYTES as u64);
        let mut images = ImageReader::with_format(&mut self.reader, self.format);
        images.limits(limits);
        let decoded = images.into_decoder().and_then(|decoder| {
            // The size was checked by the header; a decoder that finds another one must not run.
            if decoder.dimensions() != (self.header.width, self.header.height) {
                return Err(std::io::Error::other("it has two sizes").into());
            }
            decode(Box::new(decoder))
        });
        match decoded {
            Ok(values) => Ok(self.upright(values)),
            Err(error) => Err(cannot_decode(
                &mut self.reader,
                self.path,
                self.format,
                &error,
            )),
        }
    }

    /// Returns the size as shown and the pixels of an image with float colours.
    fn read_float_colors(self) -> Result<Upright<[u8; 4]>, FrameError> {
        let path = self.path;
        let pixels = self.read(float_colors)?;
        let bytes = to_bytes(&pixels.values).map_err(|what| FrameError::Invalid {
            path: path.into(),
            what,
        })?;
        Ok(Upright {
            size: pixels.size,
            values: bytes,
        })
    }

    fn read_tiff(mut self, in_world: impl Fn(f64) -> f32) -> Result<Upright<f32>, FrameError> {
        let pixels = self.header.width as usize * self.header.height as usize;
        let values = read_depth_samples(&mut self.reader, pixels)
            .map_err(|error| damaged(self.path, &error))?;
        if values.len() != pixels {
            return Err(cut_off(self.path));
        }
        Ok(self.upright(values.into_iter().map(in_world).collect()))
    }

    fn upright<T: Copy + Default>(&self, values: Vec<T>) -> Upright<T> {
        let (width, height) = (self.header.width, self.header.height);
        let values = turn(values, width, height, self.orientation);
        Upright {
            size: self.orientation.shown_size(width, height),
            values,
        }
    }
}

/// Maximum relative overshoot of colours of resampled images; they are clamped.
const TOLERANCE: f32 = 0.1;

/// Possible values of white in an image with float colours.
const WHITES: [f32; 3] = [1.0, 255.0, 65535.0];

/// Converts colours and alpha to bytes.
///
/// The format does not define white: it is the smallest of [`WHITES`] that no colour exceeds by
/// much, and likewise for the alpha.
///
/// # Errors
///
/// What is wrong and what to do, if a value is not a finite number, negative, or larger than all of
/// them.
fn to_bytes(pixels: &[[f32; 4]]) -> Result<Vec<[u8; 4]>, String> {
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

/// Returns the value of white.
///
/// # Errors
///
/// As [`to_bytes`].
fn white_of(pixels: &[[f32; 4]]) -> Result<f32, String> {
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
