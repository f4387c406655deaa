//! Decoding of PNG files to stored values, before their meaning is known.

use super::files::invalid;
use super::frame_matching::MaskFrame;
use crate::MaskError;
use crate::run_mask::MAX_PIXELS;
use png::{BitDepth, ColorType, Decoder, Limits, Transformations};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Describes why the size of a mask does not fit its frame.
pub(super) fn size_fault(width: u32, height: u32, frame: &MaskFrame<'_>) -> String {
    let turned = match (width, height) == (frame.height, frame.width) {
        true => {
            " (sides swapped: the image is shown turned by its EXIF orientation, the mask is not)"
        }
        false => "",
    };
    format!(
        "is {width}×{height} pixels, its frame '{}' is {}×{}{turned}; save the mask at the frame's size",
        frame.name, frame.width, frame.height
    )
}

pub(super) enum PngPixels {
    /// Grey values of 1 to 16 bits.
    Greys(Vec<u16>),
    /// Values with a palette.
    Indices {
        ids: Vec<u16>,
        /// Common colour of all palette entries that are not fully transparent, if any.
        color: Option<[u16; 3]>,
        /// Whether the palette holds greys that differ from their indices.
        has_other_greys: bool,
    },
    /// Red, green and blue.
    Colors(Vec<[u16; 3]>),
}

/// Storage of values in a PNG.
pub(super) enum Stored {
    /// 8-bit indices into a palette of red, green, blue triples.
    Palette(Vec<u8>),
    /// 8-bit grey.
    Grey,
    /// 16-bit grey, high byte first.
    Grey16,
}

/// Decoded bytes of an image and their layout.
pub(super) struct Packed {
    pub width: u32,
    pub height: u32,
    pub color: ColorType,
    pub depth: BitDepth,
    line_size: usize,
    bytes: Vec<u8>,
    /// Red, green and blue of each palette entry.
    palette: Vec<u8>,
    /// Content of the tRNS chunk.
    ///
    /// It holds the alpha of each palette entry, or the samples of the transparent colour.
    transparency: Option<Vec<u8>>,
}

pub(super) fn decode(
    path: &Path,
    file: BufReader<File>,
    expected: Option<&MaskFrame<'_>>,
) -> Result<Packed, MaskError> {
    let broken = |error: png::DecodingError| {
        invalid(
            path,
            format!("is not a readable PNG ({error}); save it again"),
        )
    };
    let limits = Limits {
        bytes: 4 * MAX_PIXELS as usize,
    };
    let mut decoder = Decoder::new_with_limits(file, limits);
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(broken)?;
    let (width, height) = reader.info().size();
    if let Some(frame) = expected
        && (width, height) != (frame.width, frame.height)
    {
        return Err(invalid(path, size_fault(width, height, frame)));
    }
    let size = reader
        .output_buffer_size()
        .filter(|_| u64::from(width) * u64::from(height) <= MAX_PIXELS);
    let size = size.ok_or_else(|| {
        invalid(
            path,
            format!("claims {width}×{height} pixels; it is damaged, save it again"),
        )
    })?;
    let palette = reader
        .info()
        .palette
        .as_deref()
        .unwrap_or_default()
        .to_vec();
    let transparency = reader.info().trns.as_deref().map(<[u8]>::to_vec);
    let mut bytes = vec![0; size];
    let layout = reader.next_frame(&mut bytes).map_err(broken)?;
    if (layout.width, layout.height) != (width, height) {
        return Err(invalid(
            path,
            "is an animation; save the mask as a plain PNG",
        ));
    }
    let (color, depth) = (layout.color_type, layout.bit_depth);
    Ok(Packed {
        width,
        height,
        color,
        depth,
        line_size: layout.line_size,
        bytes,
        palette,
        transparency,
    })
}

impl Packed {
    /// Returns all samples row by row, with interleaved channels.
    pub fn samples(&self) -> Vec<u16> {
        let per_row = self.width as usize * self.color.samples();
        let rows = self
            .bytes
            .chunks_exact(self.line_size.max(1))
            .take(self.height as usize);
        let mut samples = Vec::with_capacity(per_row * self.height as usize);
        for row in rows {
            match self.depth {
                BitDepth::Sixteen => {
                    samples.extend(
                        row.chunks_exact(2)
                            .map(|two| u16::from_be_bytes([two[0], two[1]])),
                    );
                }
                BitDepth::Eight => samples.extend(row.iter().map(|&byte| u16::from(byte))),
                BitDepth::One | BitDepth::Two | BitDepth::Four => {
                    samples.extend((0..per_row).map(|at| sub_byte(row, at, self.depth as usize)));
                }
            }
        }
        samples
    }

    /// Returns the alpha of every pixel, from a channel or the tRNS chunk.
    pub fn alpha(&self) -> Option<Vec<u16>> {
        let channels = self.color.samples();
        match self.color {
            ColorType::GrayscaleAlpha | ColorType::Rgba => Some(
                self.samples()
                    .chunks_exact(channels)
                    .map(|pixel| pixel[channels - 1])
                    .collect(),
            ),
            ColorType::Indexed => {
                let transparency = self.transparency.as_ref()?;
                let alpha = |place: u16| {
                    transparency
                        .get(usize::from(place))
                        .copied()
                        .map_or(255, u16::from)
                };
                Some(self.samples().into_iter().map(alpha).collect())
            }
            ColorType::Grayscale | ColorType::Rgb => {
                let transparency = self.transparency.as_ref()?;
                let key: Vec<u16> = match self.depth {
                    BitDepth::Sixteen => transparency
                        .chunks_exact(2)
                        .map(|two| u16::from_be_bytes([two[0], two[1]]))
                        .collect(),
                    _ => transparency.iter().map(|&byte| u16::from(byte)).collect(),
                };
                let alpha = |pixel: &[u16]| if pixel == key { 0 } else { 255 };
                Some(self.samples().chunks_exact(channels).map(alpha).collect())
            }
        }
    }

    /// Returns the values of a palette that holds only greys.
    fn greys(&self) -> Option<Vec<u16>> {
        let grey = |color: &[u8; 3]| {
            (color[0] == color[1] && color[1] == color[2]).then_some(u16::from(color[0]))
        };
        self.palette.as_chunks().0.iter().map(grey).collect()
    }

    /// Returns whether the palette holds exactly black and white.
    pub fn is_bilevel(&self) -> bool {
        let is_bilevel = |greys: &[u16]| [0, 255].iter().all(|grey| greys.contains(grey));
        self.greys().is_some_and(|greys| {
            is_bilevel(&greys) && greys.iter().all(|grey| [0, 255].contains(grey))
        })
    }

    /// Returns the values of an image with a palette, normally the palette indices as ids.
    ///
    /// Programs that optimise file size store black and white images with a grey palette in any
    /// order, which may differ from file to file. In a grey palette with black and white where
    /// black is not first, the greys are therefore the values. They become 0 and 1 when there are
    /// only black and white. The whole palette decides, because a frame without the object uses
    /// only part of it.
    pub fn by_palette(&self) -> PngPixels {
        let places = self.samples();
        let color = self.visible_color();
        let greys = self.greys().unwrap_or_default();
        let is_reordered = greys.first().is_some_and(|&first| first != 0)
            && greys.contains(&0)
            && greys.contains(&255);
        if !is_reordered {
            let has_other_greys =
                !self.is_bilevel() && (0..).zip(&greys).any(|(place, &grey)| place != grey);
            return PngPixels::Indices {
                ids: places,
                color,
                has_other_greys,
            };
        }
        let is_bilevel = self.is_bilevel();
        let value = |place: u16| match greys.get(usize::from(place)) {
            Some(&grey) if is_bilevel => u16::from(grey != 0),
            Some(&grey) => grey,
            None => place,
        };
        PngPixels::Indices {
            ids: places.into_iter().map(value).collect(),
            color,
            has_other_greys: false,
        }
    }

    /// Returns the common colour of all palette entries that are not fully transparent, if any.
    fn visible_color(&self) -> Option<[u16; 3]> {
        let transparency = self.transparency.as_deref()?;
        let is_visible = |at: usize| transparency.get(at).is_none_or(|&alpha| alpha > 0);
        let colors = self.palette.as_chunks::<3>().0.iter().enumerate();
        let mut visible = colors
            .filter(|(at, _)| is_visible(*at))
            .map(|(_, color)| color);
        let first = visible.next()?;
        visible
            .all(|color| color == first)
            .then(|| first.map(u16::from))
    }

    /// Returns the stored colours without alpha.
    pub fn colors(&self) -> Vec<[u16; 3]> {
        self.samples()
            .chunks_exact(self.color.samples())
            .map(|pixel| [pixel[0], pixel[1], pixel[2]])
            .collect()
    }
}

/// Returns sample `at` of a row of 1-, 2- or 4-bit samples, the first in the highest bits.
pub(super) fn sub_byte(row: &[u8], at: usize, bits: usize) -> u16 {
    let first_bit = at * bits;
    let shift = 8 - bits - first_bit % 8;
    u16::from(row[first_bit / 8] >> shift & ((1 << bits) - 1))
}
