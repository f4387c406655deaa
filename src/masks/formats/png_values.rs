use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use png::{BitDepth, ColorType, Decoder, Limits, Transformations};

use super::files::{invalid, io_error};
use crate::engine::disk;
use crate::masks::{LabelId, LabelMask, MaskError};

/// More pixels than any camera's picture has; a header that claims more is damaged.
const MAX_PIXELS: u64 = 1 << 28;
/// With more different values than this behind a mask's transparency, they are an image and not labels.
const MAX_LABELS_IN_COLOR: usize = 96;

/// A PNG's pixels as they are stored: no palette applied, nothing scaled.
pub(in crate::masks) struct PngValues {
    width: u32,
    height: u32,
    pixels: Pixels,
    /// The alpha channel.
    alpha: Option<Vec<u16>>,
}

enum Pixels {
    /// Palette places or grey values of 1 to 16 bits.
    Values(Vec<u16>),
    /// Red, green, blue.
    Colors(Vec<[u8; 3]>),
}

/// How values are written.
pub(super) enum Stored {
    /// 8-bit places in a palette of red, green, blue triples.
    Palette(Vec<u8>),
    /// 8-bit grey.
    Grey,
    /// 16-bit grey, high byte first.
    Grey16,
}

/// The bytes of a picture and how they are to be read.
struct Packed {
    width: u32,
    height: u32,
    color: ColorType,
    depth: BitDepth,
    line_size: usize,
    bytes: Vec<u8>,
    /// Red, green, blue of each place.
    palette: Vec<u8>,
}

/// What transparency did to a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::masks) enum AlphaUse {
    /// There is none, or it is the same everywhere and says nothing.
    Ignored,
    /// Pixels with ids were transparent and got none.
    Cleared,
    /// The opaque pixels are one object, cut out of an image or of a plain colour.
    CutOut,
}

impl AlphaUse {
    /// What the user should know; reads on from a number of masks.
    pub(in crate::masks) fn warning(self) -> Option<&'static str> {
        match self {
            Self::Ignored => None,
            Self::Cleared => Some("masks have transparent pixels; those got no label"),
            Self::CutOut => Some("masks are cut-outs; pixels with an alpha above half became label 1"),
        }
    }
}

/// A mask, and how its transparency was read.
pub(in crate::masks) struct ReadMask {
    pub mask: LabelMask,
    pub alpha: AlphaUse,
}

impl PngValues {
    /// Reads a PNG of any kind; when `expected` gives a frame (name, width, height), one of another size is refused by
    /// its header.
    pub(in crate::masks) fn read(path: &Path, expected: Option<(&str, u32, u32)>) -> Result<Self, MaskError> {
        let file = disk::open_regular(path).map_err(io_error(path))?;
        let packed = decode(path, BufReader::new(file), expected)?;
        let channels = packed.color.samples();
        let alpha = matches!(packed.color, ColorType::GrayscaleAlpha | ColorType::Rgba)
            .then(|| packed.samples().chunks_exact(channels).map(|pixel| pixel[channels - 1]).collect());
        let pixels = match packed.color {
            ColorType::Indexed => Pixels::Values(packed.places_or_greys()),
            ColorType::Grayscale => Pixels::Values(packed.samples()),
            ColorType::GrayscaleAlpha => {
                Pixels::Values(packed.samples().chunks_exact(2).map(|pixel| pixel[0]).collect())
            }
            ColorType::Rgb | ColorType::Rgba => Pixels::Colors(packed.colors()),
        };
        Ok(Self { width: packed.width, height: packed.height, pixels, alpha })
    }

    /// Columns and rows.
    pub(in crate::masks) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The pixels as ids: palette places and grey values are ids; colours are looked up in `ids_of_colors` (black = 0
    /// unless listed), and where there is none, an image without any real colour is read as grey. Transparency that
    /// differs between pixels removes the ids below half of the highest alpha; when what it leaves is an image or one
    /// white area, the mask is the opaque part.
    pub(in crate::masks) fn into_ids(
        self,
        path: &Path,
        ids_of_colors: Option<&BTreeMap<[u8; 3], LabelId>>,
    ) -> Result<ReadMask, MaskError> {
        let (width, height) = self.size();
        let opaque = self.opaque();
        let cut_out = ids_of_colors.is_none() && opaque.as_ref().is_some_and(|opaque| self.is_cut_out(opaque));
        if let Some(opaque) = opaque.as_ref().filter(|_| cut_out) {
            let ids = opaque.iter().map(|&opaque| LabelId(u16::from(opaque))).collect();
            return Ok(ReadMask { mask: LabelMask { width, height, ids }, alpha: AlphaUse::CutOut });
        }
        let visible = |at: usize| opaque.as_ref().is_none_or(|opaque| opaque[at]);
        let mut ids: Vec<LabelId> = match self.pixels {
            Pixels::Values(values) => values.into_iter().map(LabelId).collect(),
            Pixels::Colors(colors) => {
                let found = colors.iter().enumerate().map(|(at, color)| match visible(at) {
                    true => id_of_color(*color, ids_of_colors),
                    // A colour that is not seen need not be a label's.
                    false => Ok(id_of_color(*color, ids_of_colors).unwrap_or_default()),
                });
                found.collect::<Result<_, _>>().map_err(|what| invalid(path, what))?
            }
        };
        let mut alpha = AlphaUse::Ignored;
        for (at, id) in ids.iter_mut().enumerate() {
            if *id != LabelId::NONE && !visible(at) {
                alpha = AlphaUse::Cleared;
                *id = LabelId::NONE;
            }
        }
        Ok(ReadMask { mask: LabelMask { width, height, ids }, alpha })
    }

    /// Which pixels are opaque; `None` when transparency is the same everywhere.
    fn opaque(&self) -> Option<Vec<bool>> {
        let alpha = self.alpha.as_ref()?;
        let (lowest, highest) = (alpha.iter().min()?, alpha.iter().max()?);
        (lowest != highest).then(|| alpha.iter().map(|alpha| alpha > &(highest / 2)).collect())
    }

    /// Whether the opaque pixels show one object instead of ids: all white, or as many values as an image has.
    fn is_cut_out(&self, opaque: &[bool]) -> bool {
        let visible = || opaque.iter().enumerate().filter(|(_, opaque)| **opaque).map(|(at, _)| at);
        let value = |at: usize| match &self.pixels {
            Pixels::Values(values) => [values[at]; 3],
            Pixels::Colors(colors) => colors[at].map(u16::from),
        };
        let is_white = |at: usize| matches!(value(at), [255, 255, 255] | [u16::MAX, ..]);
        if visible().all(is_white) {
            return true;
        }
        let mut different = BTreeSet::new();
        visible().any(|at| different.insert(value(at)) && different.len() > MAX_LABELS_IN_COLOR)
    }
}

/// Encodes rows of values as PNG: fast, with light compression.
pub(super) fn encode_png(width: u32, height: u32, stored: Stored, pixels: &[u8]) -> Result<Vec<u8>, MaskError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_compression(png::Compression::Fastest);
    let depth = if matches!(stored, Stored::Grey16) { BitDepth::Sixteen } else { BitDepth::Eight };
    encoder.set_depth(depth);
    if let Stored::Palette(colors) = stored {
        encoder.set_color(ColorType::Indexed);
        encoder.set_palette(colors);
    } else {
        encoder.set_color(ColorType::Grayscale);
    }
    let write = |encoder: png::Encoder<'_, _>| encoder.write_header()?.write_image_data(pixels);
    write(encoder).map_err(|error| MaskError::Request(format!("a mask cannot be written as PNG ({error})")))?;
    Ok(bytes)
}

fn id_of_color(color: [u8; 3], listed: Option<&BTreeMap<[u8; 3], LabelId>>) -> Result<LabelId, String> {
    let [red, green, blue] = color;
    match listed {
        Some(listed) => listed.get(&color).copied().or((color == [0; 3]).then_some(LabelId::NONE)).ok_or_else(|| {
            format!("its colour #{red:02x}{green:02x}{blue:02x} is no label's in labels.json; add it there")
        }),
        None if red == green && green == blue => Ok(LabelId(u16::from(red))),
        None => Err("is a colour image, not a mask; save label ids as grey or palette values, or put a labels.json \
                     with the labels' colours next to it"
            .into()),
    }
}

fn decode(path: &Path, file: BufReader<File>, expected: Option<(&str, u32, u32)>) -> Result<Packed, MaskError> {
    let broken = |error: png::DecodingError| invalid(path, format!("is not a readable PNG ({error}); save it anew"));
    let limits = Limits { bytes: 4 * MAX_PIXELS as usize };
    let mut decoder = Decoder::new_with_limits(file, limits);
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(broken)?;
    let (width, height) = reader.info().size();
    if let Some((name, want_width, want_height)) = expected
        && (width, height) != (want_width, want_height)
    {
        return Err(invalid(path, size_fault((width, height), name, (want_width, want_height))));
    }
    let size = reader.output_buffer_size().filter(|_| u64::from(width) * u64::from(height) <= MAX_PIXELS);
    let size =
        size.ok_or_else(|| invalid(path, format!("claims {width}×{height} pixels; it is damaged, save it anew")))?;
    let palette = reader.info().palette.as_deref().unwrap_or_default().to_vec();
    let mut bytes = vec![0; size];
    let layout = reader.next_frame(&mut bytes).map_err(broken)?;
    if (layout.width, layout.height) != (width, height) {
        return Err(invalid(path, "is an animation; save the mask as a plain PNG"));
    }
    let (color, depth) = (layout.color_type, layout.bit_depth);
    Ok(Packed { width, height, color, depth, line_size: layout.line_size, bytes, palette })
}

/// What is wrong with a mask that does not fit its frame.
pub(super) fn size_fault(has: (u32, u32), frame: &str, needs: (u32, u32)) -> String {
    let turned = match has == (needs.1, needs.0) {
        true => " (sides swapped: the image is shown turned by its EXIF orientation, the mask is not)",
        false => "",
    };
    format!(
        "is {}×{} pixels, its frame '{frame}' is {}×{}{turned}; save the mask at the frame's size",
        has.0, has.1, needs.0, needs.1
    )
}

impl Packed {
    /// All samples, row by row, channels side by side.
    fn samples(&self) -> Vec<u16> {
        let per_row = self.width as usize * self.color.samples();
        let rows = self.bytes.chunks_exact(self.line_size.max(1)).take(self.height as usize);
        let mut samples = Vec::with_capacity(per_row * self.height as usize);
        for row in rows {
            match self.depth {
                BitDepth::Sixteen => {
                    samples.extend(row.chunks_exact(2).map(|two| u16::from_be_bytes([two[0], two[1]])));
                }
                BitDepth::Eight => samples.extend(row.iter().map(|&byte| u16::from(byte))),
                BitDepth::One | BitDepth::Two | BitDepth::Four => {
                    samples.extend((0..per_row).map(|at| sub_byte(row, at, self.depth as usize)));
                }
            }
        }
        samples
    }

    /// The places in the palette, which are ids. Programs that make files small store black and white images with a
    /// palette of greys in any order: where black is not the first, the greys are the values.
    fn places_or_greys(&self) -> Vec<u16> {
        let places = self.samples();
        let grey = |place: u16| match self.palette.get(3 * usize::from(place)..)? {
            [red, green, blue, ..] if red == green && green == blue => Some(u16::from(*red)),
            _ => None,
        };
        let used: BTreeSet<u16> = places.iter().copied().collect();
        let greys: Option<BTreeMap<u16, u16>> = used.iter().map(|&place| Some((place, grey(place)?))).collect();
        match greys {
            Some(greys)
                if greys.iter().any(|(&place, &grey)| place != 0 && grey == 0)
                    && greys.values().any(|&grey| grey == 255) =>
            {
                places.into_iter().map(|place| greys[&place]).collect()
            }
            _ => places,
        }
    }

    /// Colours in 8 bits a channel; alpha is left out.
    fn colors(&self) -> Vec<[u8; 3]> {
        let shift = if self.depth == BitDepth::Sixteen { 8 } else { 0 };
        let samples = self.samples();
        let pixels = samples.chunks_exact(self.color.samples());
        pixels.map(|pixel| [0, 1, 2].map(|channel| (pixel[channel] >> shift) as u8)).collect()
    }
}

/// Sample `at` of a row of samples of 1, 2 or 4 bits, first in the highest bits.
fn sub_byte(row: &[u8], at: usize, bits: usize) -> u16 {
    let first_bit = at * bits;
    let shift = 8 - bits - first_bit % 8;
    u16::from(row[first_bit / 8] >> shift & ((1 << bits) - 1))
}
