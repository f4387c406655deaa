use std::collections::{BTreeMap, BTreeSet};
use std::io::BufReader;
use std::path::Path;

use png::{BitDepth, ColorType};

use super::files::{invalid, io_error};
use super::frame_matching::MaskFrame;
use super::png_decode::{PngPixels, Stored, decode};
use crate::{LabelId, LabelMask, MaskError, RunMask};
use ostra_core::disk;

/// Maximum number of different visible values in a mask with transparency.
///
/// With more values, the pixels are an image and not labels.
const MAX_LABELS_IN_COLOR: usize = 96;

/// Pixels of a PNG as stored, without applying a palette or scaling.
pub(crate) struct PngValues {
    width: u32,
    height: u32,
    pixels: PngPixels,
    /// Alpha of each pixel, from a channel, a transparent colour or palette entries.
    alpha: Option<Vec<u16>>,
    /// Value of white.
    white: u16,
    /// Whether the only values are black and white, stored as 0 and 1.
    is_bilevel: bool,
}

/// Effect of transparency on a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AlphaUse {
    /// There is no transparency, or it is uniform and carries no information.
    Ignored,
    /// Pixels with ids were transparent and became unlabelled.
    Cleared,
    /// The opaque pixels are one object, cut out of an image or of white.
    CutOut,
    /// The opaque pixels are all black: a black cut-out, or background of a mask without labels.
    BlackCutOut,
}

impl AlphaUse {
    /// Returns the warning for the user, which continues a sentence after a number of masks.
    pub(crate) fn warning(self) -> Option<&'static str> {
        match self {
            Self::Ignored => None,
            Self::Cleared => Some("masks have transparent pixels; those got no label"),
            Self::CutOut | Self::BlackCutOut => {
                Some("masks are cut-outs; pixels with an alpha above half became label 1")
            }
        }
    }

    /// Returns whether the mask is label 1 where the file is opaque.
    pub(crate) fn is_cut_out(self) -> bool {
        matches!(self, Self::CutOut | Self::BlackCutOut)
    }
}

/// A mask and how its file was read.
pub(crate) struct ReadMask {
    pub mask: LabelMask,
    pub how: HowRead,
}

/// How the values of a file became ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct HowRead {
    pub alpha: AlphaUse,
    /// Whether the only values are black and white, stored as 0 and 1.
    pub is_bilevel: bool,
    /// Whether indices into a grey palette were read as ids although the greys differ.
    pub has_other_greys: bool,
}

impl HowRead {
    /// Returns warnings for the user, each continuing a sentence after a number of masks.
    pub(crate) fn warnings(self) -> impl Iterator<Item = &'static str> {
        let greys = "masks have a palette of greys that are not its places; the places were read as label ids, not the \
                     greys (save the masks as plain greyscale to use those)";
        self.alpha
            .warning()
            .into_iter()
            .chain(self.has_other_greys.then_some(greys))
    }
}

/// Corrects cut-outs by comparing all masks of a folder.
///
/// Black next to transparent pixels is background when other masks have labels. A white mask
/// without transparency is a cut-out of the whole frame when others are cut-outs.
pub(crate) fn reconcile_cut_outs<'r>(
    masks: impl Iterator<Item = (&'r mut RunMask, &'r mut HowRead)>,
) {
    let mut masks: Vec<_> = masks.collect();
    let has_labels = |mask: &RunMask| mask.runs.iter().any(|run| run.0 != LabelId::NONE);
    let is_labelled = masks
        .iter()
        .any(|(mask, how)| how.alpha != AlphaUse::BlackCutOut && has_labels(mask));
    let has_cut_outs = masks.iter().any(|(_, how)| how.alpha == AlphaUse::CutOut);
    for (mask, how) in &mut masks {
        if how.alpha == AlphaUse::BlackCutOut && is_labelled {
            **mask = RunMask::empty(mask.width, mask.height);
            how.alpha = AlphaUse::Ignored;
        }
        if has_cut_outs && matches!(mask.runs[..], [(LabelId(255 | u16::MAX), _)]) {
            **mask = mask.map_ids(|_| LabelId(1));
            how.alpha = AlphaUse::CutOut;
        }
    }
}

impl PngValues {
    /// Reads a PNG of any type, checking its header against the size of the `expected` frame.
    pub(crate) fn read(path: &Path, expected: Option<&MaskFrame<'_>>) -> Result<Self, MaskError> {
        let file = disk::open_regular(path).map_err(io_error(path))?;
        let packed = decode(path, BufReader::new(file), expected)?;
        let pixels = match packed.color {
            ColorType::Indexed => packed.by_palette(),
            ColorType::Grayscale => PngPixels::Greys(packed.samples()),
            ColorType::GrayscaleAlpha => PngPixels::Greys(
                packed
                    .samples()
                    .chunks_exact(2)
                    .map(|pixel| pixel[0])
                    .collect(),
            ),
            ColorType::Rgb | ColorType::Rgba => PngPixels::Colors(packed.colors()),
        };
        let white = if packed.depth == BitDepth::Sixteen {
            u16::MAX
        } else {
            (1 << packed.depth as u16) - 1
        };
        let is_bilevel = packed.depth == BitDepth::One
            || (packed.color == ColorType::Indexed && packed.is_bilevel());
        let alpha = packed.alpha();
        Ok(Self {
            width: packed.width,
            height: packed.height,
            pixels,
            alpha,
            white,
            is_bilevel,
        })
    }

    /// Returns the width and height in pixels.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Converts the pixels to ids.
    ///
    /// Palette indices and grey values are ids. Colours are looked up in `ids_of_colors`, where
    /// black is 0 unless listed. Without that list, an image whose colours are all grey is read as
    /// grey.
    ///
    /// When transparency differs between pixels, ids with an alpha of at most half of the highest
    /// are removed. When the opaque part is an image, or a single white or black area, the mask is
    /// the opaque part. See [`reconcile_cut_outs`] for several masks.
    pub(crate) fn into_ids(
        self,
        path: &Path,
        ids_of_colors: Option<&BTreeMap<[u8; 3], LabelId>>,
    ) -> Result<ReadMask, MaskError> {
        let (width, height) = self.size();
        let opaque = self.opaque();
        let is_bilevel = self.is_bilevel;
        let how = |alpha, has_other_greys| HowRead {
            alpha,
            is_bilevel,
            has_other_greys,
        };
        let unlisted = opaque.as_ref().filter(|_| ids_of_colors.is_none());
        if let Some((opaque, alpha)) =
            unlisted.and_then(|opaque| Some((opaque, self.cut_out(opaque)?)))
        {
            let ids = opaque
                .iter()
                .map(|&opaque| LabelId(u16::from(opaque)))
                .collect();
            return Ok(ReadMask {
                mask: LabelMask { width, height, ids },
                how: how(alpha, false),
            });
        }
        let visible = |at: usize| opaque.as_ref().is_none_or(|opaque| opaque[at]);
        let mut other_greys = false;
        let mut ids: Vec<LabelId> = match self.pixels {
            PngPixels::Greys(values) => values.into_iter().map(LabelId).collect(),
            PngPixels::Indices {
                ids,
                has_other_greys,
                ..
            } => {
                other_greys = has_other_greys && ids_of_colors.is_none();
                ids.into_iter().map(LabelId).collect()
            }
            PngPixels::Colors(colors) => ids_of_pixels(&colors, self.white, ids_of_colors, visible)
                .map_err(|what| invalid(path, what))?,
        };
        let mut alpha = AlphaUse::Ignored;
        for (at, id) in ids.iter_mut().enumerate() {
            if *id != LabelId::NONE && !visible(at) {
                alpha = AlphaUse::Cleared;
                *id = LabelId::NONE;
            }
        }
        Ok(ReadMask {
            mask: LabelMask { width, height, ids },
            how: how(alpha, other_greys),
        })
    }

    /// Returns which pixels are opaque; `None` when transparency is uniform.
    ///
    /// In an image of one value that is fully transparent, no pixel is opaque. It is a frame
    /// without the object of a cut-out.
    fn opaque(&self) -> Option<Vec<bool>> {
        let alpha = self.alpha.as_ref()?;
        let (lowest, highest) = (alpha.iter().min()?, alpha.iter().max()?);
        let shows_nothing =
            *highest == 0 && (1..alpha.len()).all(|at| self.color(at) == self.color(0));
        (lowest != highest || shows_nothing)
            .then(|| alpha.iter().map(|alpha| alpha > &(highest / 2)).collect())
    }

    /// Returns the colour of a pixel, or its value three times.
    fn color(&self, at: usize) -> [u16; 3] {
        match &self.pixels {
            PngPixels::Greys(ids) | PngPixels::Indices { ids, .. } => [ids[at]; 3],
            PngPixels::Colors(colors) => colors[at],
        }
    }

    /// Returns a cut-out if the opaque pixels show one object instead of ids.
    ///
    /// They do when they are all white, all black, or have as many values as an image. Palette
    /// indices are ids unless all visible palette entries have one colour.
    fn cut_out(&self, opaque: &[bool]) -> Option<AlphaUse> {
        let mut visible = opaque
            .iter()
            .enumerate()
            .filter(|(_, opaque)| **opaque)
            .map(|(at, _)| self.color(at));
        let first = visible.next()?;
        let (color, white) = match &self.pixels {
            PngPixels::Indices { color, .. } => (*color, 255),
            _ => (
                visible.clone().all(|color| color == first).then_some(first),
                self.white,
            ),
        };
        match color {
            Some(color) if color == [white; 3] => return Some(AlphaUse::CutOut),
            Some([0, 0, 0]) => return Some(AlphaUse::BlackCutOut),
            _ => {}
        }
        let mut different = BTreeSet::new();
        let is_image = !matches!(self.pixels, PngPixels::Indices { .. })
            && visible
                .any(|color| different.insert(color) && different.len() > MAX_LABELS_IN_COLOR);
        is_image.then_some(AlphaUse::CutOut)
    }
}

/// Encodes rows of values as a PNG with light, fast compression.
pub(super) fn encode_png(
    width: u32,
    height: u32,
    stored: Stored,
    pixels: &[u8],
) -> Result<Vec<u8>, MaskError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_compression(png::Compression::Fastest);
    let depth = if matches!(stored, Stored::Grey16) {
        BitDepth::Sixteen
    } else {
        BitDepth::Eight
    };
    encoder.set_depth(depth);
    if let Stored::Palette(colors) = stored {
        encoder.set_color(ColorType::Indexed);
        encoder.set_palette(colors);
    } else {
        encoder.set_color(ColorType::Grayscale);
    }
    let write = |encoder: png::Encoder<'_, _>| encoder.write_header()?.write_image_data(pixels);
    write(encoder).map_err(|error| {
        MaskError::Request(format!("a mask cannot be written as PNG ({error})"))
    })?;
    Ok(bytes)
}

/// Returns the ids of coloured pixels.
///
/// In 16 bits, greys that cannot come from scaling an 8-bit image are ids.
fn ids_of_pixels(
    colors: &[[u16; 3]],
    white: u16,
    listed: Option<&BTreeMap<[u8; 3], LabelId>>,
    visible: impl Fn(usize) -> bool,
) -> Result<Vec<LabelId>, String> {
    let is_wide = white == u16::MAX;
    let mut seen = colors
        .iter()
        .enumerate()
        .filter(|(at, _)| visible(*at))
        .map(|(_, color)| color);
    let are_ids = is_wide
        && seen
            .clone()
            .all(|[red, green, blue]| red == green && green == blue)
        && seen.any(|[value, ..]| value % 257 != 0);
    let listed = listed.filter(|_| !are_ids);
    let shift = if is_wide { 8 } else { 0 };
    let found = colors
        .iter()
        .enumerate()
        .map(|(at, color)| match visible(at) {
            true => id_of_color(*color, shift, listed),
            // An invisible colour does not have to belong to a label.
            false => Ok(id_of_color(*color, shift, listed).unwrap_or_default()),
        });
    found.collect()
}

/// Returns the id of a colour, which has `shift` bits more than 8 per channel.
fn id_of_color(
    color: [u16; 3],
    shift: u32,
    listed: Option<&BTreeMap<[u8; 3], LabelId>>,
) -> Result<LabelId, String> {
    let narrow = color.map(|value| (value >> shift) as u8);
    match listed {
        Some(listed) => listed.get(&narrow).copied().or((narrow == [0; 3]).then_some(LabelId::NONE)).ok_or_else(|| {
            let [red, green, blue] = narrow;
            format!("its colour #{red:02x}{green:02x}{blue:02x} is not the colour of a label in labels.json; add it there")
        }),
        None if color[0] == color[1] && color[1] == color[2] => Ok(LabelId(color[0])),
        None => Err("is a colour image, not a mask; save label ids as grey or palette values, or put a labels.json \
                     with the labels' colours next to it"
            .into()),
    }
}
