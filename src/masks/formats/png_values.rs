use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use png::{BitDepth, ColorType, Decoder, Limits, Transformations};

use super::files::{invalid, io_error};
use crate::{LabelId, LabelMask, MaskError, RunMask};
use ostra_core::disk;

/// More pixels than any camera's picture has; a header that claims more is damaged.
const MAX_PIXELS: u64 = 1 << 28;
/// With more different values than this behind a mask's transparency, they are an image and not labels.
const MAX_LABELS_IN_COLOR: usize = 96;

/// A PNG's pixels as they are stored: no palette applied, nothing scaled.
pub(crate) struct PngValues {
    width: u32,
    height: u32,
    pixels: Pixels,
    /// The alpha channel, or what a transparent colour or palette place makes of it.
    alpha: Option<Vec<u16>>,
    /// The value of white.
    white: u16,
    /// Whether the only values are black and white, stored as 0 and 1.
    is_bilevel: bool,
}

enum Pixels {
    /// Grey values of 1 to 16 bits.
    Greys(Vec<u16>),
    /// Values by a palette.
    Places {
        ids: Vec<u16>,
        /// The colour of all places that are not fully transparent, where they have the same.
        color: Option<[u16; 3]>,
        /// Whether the palette is of greys that are not the places.
        has_other_greys: bool,
    },
    /// Red, green, blue.
    Colors(Vec<[u16; 3]>),
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
    /// The content of the tRNS chunk: alpha of each palette place, or the samples of the transparent colour.
    transparency: Option<Vec<u8>>,
}

/// What transparency did to a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AlphaUse {
    /// There is none, or it is the same everywhere and says nothing.
    Ignored,
    /// Pixels with ids were transparent and got none.
    Cleared,
    /// The opaque pixels are one object, cut out of an image or of white.
    CutOut,
    /// The opaque pixels are all black: a black cut-out, or the background of a mask without labels.
    BlackCutOut,
}

impl AlphaUse {
    /// What the user should know; reads on from a number of masks.
    pub(crate) fn warning(self) -> Option<&'static str> {
        match self {
            Self::Ignored => None,
            Self::Cleared => Some("masks have transparent pixels; those got no label"),
            Self::CutOut | Self::BlackCutOut => {
                Some("masks are cut-outs; pixels with an alpha above half became label 1")
            }
        }
    }

    /// Whether the mask is label 1 where the file is opaque.
    pub(crate) fn is_cut_out(self) -> bool {
        matches!(self, Self::CutOut | Self::BlackCutOut)
    }
}

/// A mask, and how its file was read.
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
    /// Whether places in a palette of greys were read as ids, although the greys are other values.
    pub has_other_greys: bool,
}

impl HowRead {
    /// What the user should know; each reads on from a number of masks.
    pub(crate) fn warnings(self) -> impl Iterator<Item = &'static str> {
        let greys = "masks have a palette of greys that are not its places; the places were read as label ids, not the \
                     greys (save the masks as plain greyscale to use those)";
        self.alpha
            .warning()
            .into_iter()
            .chain(self.has_other_greys.then_some(greys))
    }
}

/// Decides from all masks of a folder what one alone does not show: black next to transparent pixels is background
/// where other masks have labels, and a white mask without transparency is a cut-out of the whole frame where others
/// are cut-outs.
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
    /// Reads a PNG of any kind; when `expected` gives a frame (name, width, height), one of another size is refused by
    /// its header.
    pub(crate) fn read(path: &Path, expected: Option<(&str, u32, u32)>) -> Result<Self, MaskError> {
        let file = disk::open_regular(path).map_err(io_error(path))?;
        let packed = decode(path, BufReader::new(file), expected)?;
        let pixels = match packed.color {
            ColorType::Indexed => packed.by_palette(),
            ColorType::Grayscale => Pixels::Greys(packed.samples()),
            ColorType::GrayscaleAlpha => Pixels::Greys(
                packed
                    .samples()
                    .chunks_exact(2)
                    .map(|pixel| pixel[0])
                    .collect(),
            ),
            ColorType::Rgb | ColorType::Rgba => Pixels::Colors(packed.colors()),
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

    /// Columns and rows.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The pixels as ids: palette places and grey values are ids; colours are looked up in `ids_of_colors` (black = 0
    /// unless listed), and where there is none, an image without any real colour is read as grey. Transparency that
    /// differs between pixels removes the ids below half of the highest alpha; when what it leaves is an image, or one
    /// white or black area, the mask is the opaque part. See [`reconcile_cut_outs`] for several masks.
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
            Pixels::Greys(values) => values.into_iter().map(LabelId).collect(),
            Pixels::Places {
                ids,
                has_other_greys,
                ..
            } => {
                other_greys = has_other_greys && ids_of_colors.is_none();
                ids.into_iter().map(LabelId).collect()
            }
            Pixels::Colors(colors) => ids_of_pixels(&colors, self.white, ids_of_colors, visible)
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

    /// Which pixels are opaque; `None` when transparency is the same everywhere. In an image of one value that is
    /// transparent everywhere no pixel is: the frame of a cut-out object that is not in it.
    fn opaque(&self) -> Option<Vec<bool>> {
        let alpha = self.alpha.as_ref()?;
        let (lowest, highest) = (alpha.iter().min()?, alpha.iter().max()?);
        let shows_nothing =
            *highest == 0 && (1..alpha.len()).all(|at| self.color(at) == self.color(0));
        (lowest != highest || shows_nothing)
            .then(|| alpha.iter().map(|alpha| alpha > &(highest / 2)).collect())
    }

    /// The colour of a pixel, or its value three times.
    fn color(&self, at: usize) -> [u16; 3] {
        match &self.pixels {
            Pixels::Greys(ids) | Pixels::Places { ids, .. } => [ids[at]; 3],
            Pixels::Colors(colors) => colors[at],
        }
    }

    /// Whether the opaque pixels show one object instead of ids: all white, all black, or as many values as an image
    /// has. The places of a palette are ids unless its visible places have one colour.
    fn cut_out(&self, opaque: &[bool]) -> Option<AlphaUse> {
        let mut visible = opaque
            .iter()
            .enumerate()
            .filter(|(_, opaque)| **opaque)
            .map(|(at, _)| self.color(at));
        let first = visible.next()?;
        let (color, white) = match &self.pixels {
            Pixels::Places { color, .. } => (*color, 255),
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
        let is_image = !matches!(self.pixels, Pixels::Places { .. })
            && visible
                .any(|color| different.insert(color) && different.len() > MAX_LABELS_IN_COLOR);
        is_image.then_some(AlphaUse::CutOut)
    }
}

/// Encodes rows of values as PNG: fast, with light compression.
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

/// The ids of coloured pixels. In 16 bits, greys that no 8-bit image gives when it is scaled are ids.
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
            // A colour that is not seen need not be a label's.
            false => Ok(id_of_color(*color, shift, listed).unwrap_or_default()),
        });
    found.collect()
}

/// The id of a colour, of which `shift` bits are more than 8 a channel.
fn id_of_color(
    color: [u16; 3],
    shift: u32,
    listed: Option<&BTreeMap<[u8; 3], LabelId>>,
) -> Result<LabelId, String> {
    let narrow = color.map(|value| (value >> shift) as u8);
    match listed {
        Some(listed) => listed.get(&narrow).copied().or((narrow == [0; 3]).then_some(LabelId::NONE)).ok_or_else(|| {
            let [red, green, blue] = narrow;
            format!("its colour #{red:02x}{green:02x}{blue:02x} is no label's in labels.json; add it there")
        }),
        None if color[0] == color[1] && color[1] == color[2] => Ok(LabelId(color[0])),
        None => Err("is a colour image, not a mask; save label ids as grey or palette values, or put a labels.json \
                     with the labels' colours next to it"
            .into()),
    }
}

fn decode(
    path: &Path,
    file: BufReader<File>,
    expected: Option<(&str, u32, u32)>,
) -> Result<Packed, MaskError> {
    let broken = |error: png::DecodingError| {
        invalid(
            path,
            format!("is not a readable PNG ({error}); save it anew"),
        )
    };
    let limits = Limits {
        bytes: 4 * MAX_PIXELS as usize,
    };
    let mut decoder = Decoder::new_with_limits(file, limits);
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(broken)?;
    let (width, height) = reader.info().size();
    if let Some((name, want_width, want_height)) = expected
        && (width, height) != (want_width, want_height)
    {
        return Err(invalid(
            path,
            size_fault((width, height), name, (want_width, want_height)),
        ));
    }
    let size = reader
        .output_buffer_size()
        .filter(|_| u64::from(width) * u64::from(height) <= MAX_PIXELS);
    let size = size.ok_or_else(|| {
        invalid(
            path,
            format!("claims {width}×{height} pixels; it is damaged, save it anew"),
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

/// What is wrong with a mask that does not fit its frame.
pub(super) fn size_fault(has: (u32, u32), frame: &str, needs: (u32, u32)) -> String {
    let turned = match has == (needs.1, needs.0) {
        true => {
            " (sides swapped: the image is shown turned by its EXIF orientation, the mask is not)"
        }
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

    /// The alpha of every pixel: a channel, or as the tRNS chunk gives it.
    fn alpha(&self) -> Option<Vec<u16>> {
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

    /// The greys of a palette that holds nothing else.
    fn greys(&self) -> Option<Vec<u16>> {
        let grey = |color: &[u8; 3]| {
            (color[0] == color[1] && color[1] == color[2]).then_some(u16::from(color[0]))
        };
        self.palette.as_chunks().0.iter().map(grey).collect()
    }

    /// Whether the palette holds black and white and nothing else.
    fn is_bilevel(&self) -> bool {
        let is_bilevel = |greys: &[u16]| [0, 255].iter().all(|grey| greys.contains(grey));
        self.greys().is_some_and(|greys| {
            is_bilevel(&greys) && greys.iter().all(|grey| [0, 255].contains(grey))
        })
    }

    /// Values by the palette: its places, which are ids. Programs that make files small store black and white images
    /// with a palette of greys in any order, and not the same in each: where the palette has black but not first, the
    /// greys are the values, 0 and 1 where there are only black and white. The whole palette decides, since a frame
    /// without the object uses less of it.
    fn by_palette(&self) -> Pixels {
        let places = self.samples();
        let color = self.visible_color();
        let greys = self.greys().unwrap_or_default();
        let is_reordered = greys.first().is_some_and(|&first| first != 0)
            && greys.contains(&0)
            && greys.contains(&255);
        if !is_reordered {
            let has_other_greys =
                !self.is_bilevel() && (0..).zip(&greys).any(|(place, &grey)| place != grey);
            return Pixels::Places {
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
        Pixels::Places {
            ids: places.into_iter().map(value).collect(),
            color,
            has_other_greys: false,
        }
    }

    /// The colour of all palette places that are not fully transparent, where they have the same.
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

    /// Colours as they are stored; alpha is left out.
    fn colors(&self) -> Vec<[u16; 3]> {
        self.samples()
            .chunks_exact(self.color.samples())
            .map(|pixel| [pixel[0], pixel[1], pixel[2]])
            .collect()
    }
}

/// Sample `at` of a row of samples of 1, 2 or 4 bits, first in the highest bits.
fn sub_byte(row: &[u8], at: usize, bits: usize) -> u16 {
    let first_bit = at * bits;
    let shift = 8 - bits - first_bit % 8;
    u16::from(row[first_bit / 8] >> shift & ((1 << bits) - 1))
}
