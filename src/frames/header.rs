use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::Path;

use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use tiff::decoder::Decoder;
use tiff::tags::{SampleFormat, Tag};

use super::complete::{is_complete, next_marker, read_bytes};
use super::tiff_samples::{sample_format, variant_of};
use super::{FrameError, Orientation};
use ostra_core::disk;
use ostra_geometry::Camera;

/// Supported image formats, as shown to the user.
pub(super) const FORMATS: &str = "JPEG, PNG, TIFF or WebP";

/// Maximum number of pixels of an image.
///
/// More mean a damaged header, or an image that is too large to process.
pub(super) const MAX_PIXELS: u64 = Camera::MAX_PIXELS;

/// Bytes that a decoder may allocate for a header: colour profiles, EXIF data, text.
const HEADER_BYTES: u64 = 32 << 20;

/// Maximum number of file bytes per pixel, besides [`APPENDED_BYTES`].
const BYTES_PER_PIXEL: u64 = 64;
/// Maximum number of bytes that a camera appends to an image (a short video, previews).
const APPENDED_BYTES: u64 = 256 << 20;

/// Kind of the pixels of an image file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Content {
    /// Colours or grey.
    Color,
    /// Colours or grey, with an alpha channel.
    ColorAlpha,
    /// Colours as floats.
    FloatColor,
    /// Colours as floats, with an alpha channel.
    FloatColorAlpha,
    /// One channel of 16-bit unsigned integers: a grey image, or depth.
    Grey16,
    /// One channel of integers that can only be depth: signed, or of 32 bits.
    IntegerDepth,
    /// One channel of floats, which can only be depth.
    FloatDepth,
}

/// Properties of an image file from its header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    /// Width in pixels as stored.
    pub width: u32,
    /// Height in pixels as stored.
    pub height: u32,
    /// Rotation to apply when shown.
    pub orientation: Orientation,
    /// Kind of the pixels.
    pub content: Content,
}

impl Content {
    /// Returns whether pixels can be transparent.
    pub fn has_alpha(self) -> bool {
        matches!(self, Self::ColorAlpha | Self::FloatColorAlpha)
    }

    /// Returns whether colours are floats.
    pub fn is_float_color(self) -> bool {
        matches!(self, Self::FloatColor | Self::FloatColorAlpha)
    }
}

impl Header {
    /// Returns whether the image can be a depth map.
    pub fn is_depth(&self) -> bool {
        matches!(
            self.content,
            Content::Grey16 | Content::IntegerDepth | Content::FloatDepth
        )
    }

    /// Returns whether the image can only be a depth map.
    pub fn is_only_depth(&self) -> bool {
        matches!(self.content, Content::IntegerDepth | Content::FloatDepth)
    }
}

/// Reads size, orientation and kind from the first bytes of an image file.
pub(super) fn read_header(path: &Path) -> Result<Header, FrameError> {
    let mut reader = open(path)?;
    let format = format_of(&mut reader, path)?;
    header_in(&mut reader, format, path)
}

/// Returns an error if the end of an image file is missing; the file is not decoded.
pub(super) fn check_complete(path: &Path) -> Result<(), FrameError> {
    let mut reader = open(path)?;
    let format = format_of(&mut reader, path)?;
    match is_complete(&mut reader, format) {
        Ok(true) => Ok(()),
        Ok(false) => Err(cut_off(path)),
        Err(reason) if reason.kind() == std::io::ErrorKind::UnexpectedEof => Err(cut_off(path)),
        Err(reason) => Err(FrameError::io(path, reason)),
    }
}

/// Returns the header of an open file, within the decoding limits; the reader is left at its start.
pub(super) fn header_in(
    reader: &mut BufReader<File>,
    format: ImageFormat,
    path: &Path,
) -> Result<Header, FrameError> {
    let io = |reason| FrameError::io(path, reason);
    let depth = if format == ImageFormat::Tiff {
        depth_samples(reader)
    } else {
        None
    };
    reader.rewind().map_err(io)?;
    let header = match (format, depth) {
        (_, Some(header)) => header,
        (ImageFormat::Jpeg, None) => read_jpeg_header(reader).map_err(|e| damaged(path, &e))?,
        (format, None) => {
            let mut limits = Limits::default();
            limits.max_alloc = Some(HEADER_BYTES);
            let mut images = ImageReader::with_format(&mut *reader, format);
            images.limits(limits);
            let header = images.into_decoder().and_then(header_of);
            match header {
                Ok(header) => header,
                Err(error) => return Err(cannot_decode(reader, path, format, &error)),
            }
        }
    };
    reader.rewind().map_err(io)?;
    check_limits(
        &header,
        reader.get_ref().metadata().map_err(io)?.len(),
        path,
    )?;
    Ok(header)
}

fn check_limits(header: &Header, bytes: u64, path: &Path) -> Result<(), FrameError> {
    let (width, height) = (header.width, header.height);
    let pixels = u64::from(width) * u64::from(height);
    let invalid = |what: String| {
        Err(FrameError::Invalid {
            path: path.into(),
            what,
        })
    };
    if pixels == 0 || width.max(height) > Camera::MAX_SIDE || pixels > MAX_PIXELS {
        return invalid(format!(
            "its header says {width} × {height} pixels, which cannot be read (at most {} a side and {} million in all); \
             replace it or make it smaller",
            Camera::MAX_SIDE,
            MAX_PIXELS / 1_000_000
        ));
    }
    if bytes > pixels * BYTES_PER_PIXEL + APPENDED_BYTES {
        return invalid(format!(
            "a file of {bytes} bytes for {width} × {height} pixels is damaged; replace it"
        ));
    }
    Ok(())
}

/// Opens a source file, which must be a regular one.
///
/// The error distinguishes a missing file from an unreadable one.
pub(super) fn open(path: &Path) -> Result<BufReader<File>, FrameError> {
    disk::open_regular(path)
        .map(BufReader::new)
        .map_err(|reason| FrameError::io(path, reason))
}

/// Returns the image format from the file's first bytes, independent of its extension.
pub(super) fn format_of(
    reader: &mut BufReader<File>,
    path: &Path,
) -> Result<ImageFormat, FrameError> {
    let start = reader
        .fill_buf()
        .map_err(|reason| FrameError::io(path, reason))?;
    let invalid = |what: String| {
        Err(FrameError::Invalid {
            path: path.into(),
            what,
        })
    };
    if start.is_empty() {
        return invalid("the file is empty; replace it or remove it".into());
    }
    if start.starts_with(b"II\x2b\0") || start.starts_with(b"MM\0\x2b") {
        return Ok(ImageFormat::Tiff); // BigTIFF
    }
    if is_heif(start) {
        return invalid(format!(
            "this is a HEIC or AVIF image, not {FORMATS}; convert it, e.g. with heif-convert"
        ));
    }
    match image::guess_format(start) {
        Ok(
            format @ (ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::Tiff | ImageFormat::WebP),
        ) => Ok(format),
        _ => invalid(format!(
            "this is not a {FORMATS} image; remove it or replace it"
        )),
    }
}

/// Kind of a file by its first bytes.
pub(super) enum FileKind {
    /// A JPEG, PNG or WebP image.
    Image,
    /// A TIFF image, or a file in another format with the same structure.
    Tiff,
    /// A HEIC or AVIF image, with its error.
    Heif(FrameError),
    /// Not a known image format.
    Other,
}

/// Returns the kind of a file by its first bytes.
pub(super) fn kind_of_file(path: &Path) -> Result<FileKind, FrameError> {
    let mut reader = open(path)?;
    match format_of(&mut reader, path) {
        Ok(ImageFormat::Tiff) => Ok(FileKind::Tiff),
        Ok(_) => Ok(FileKind::Image),
        Err(error @ FrameError::Invalid { .. }) => {
            let start = reader
                .fill_buf()
                .map_err(|reason| FrameError::io(path, reason))?;
            Ok(if is_heif(start) {
                FileKind::Heif(error)
            } else {
                FileKind::Other
            })
        }
        Err(error) => Err(error),
    }
}

fn is_heif(start: &[u8]) -> bool {
    let brands = [
        b"heic", b"heix", b"heim", b"heis", b"hevc", b"mif1", b"msf1", b"avif",
    ];
    start.get(4..8) == Some(b"ftyp".as_slice())
        && brands
            .iter()
            .any(|brand| start.get(8..12) == Some(brand.as_slice()))
}

/// Returns the error for a file that a decoder refused.
///
/// An unsupported variant is distinguished from damage.
pub(super) fn cannot_decode(
    reader: &mut BufReader<File>,
    path: &Path,
    format: ImageFormat,
    error: &ImageError,
) -> FrameError {
    let invalid = |what: String| FrameError::Invalid {
        path: path.into(),
        what,
    };
    let as_png = "convert it to a PNG of 8 or 16 bits, e.g. with ImageMagick: magick";
    let name = path.file_name().unwrap_or_default().display();
    let variant = if format == ImageFormat::Tiff {
        variant_of(reader)
    } else {
        None
    };
    match (error, variant) {
        (ImageError::Unsupported(_), Some(variant)) => invalid(format!(
            "a TIFF with {variant} is not supported; {as_png} {name} -colorspace sRGB {name}.png"
        )),
        (ImageError::Unsupported(_), None) => invalid(format!(
            "this variant of {format:?} is not supported ({error}); {as_png} {name} {name}.png"
        )),
        (ImageError::Limits(_), _) => invalid(format!(
            "decoding it takes more memory than an image of its size needs ({error}); {as_png} {name} {name}.png"
        )),
        _ => damaged(path, error),
    }
}

/// Returns the error for an image that is truncated or does not follow its format.
pub(super) fn damaged(path: &Path, why: &dyn std::fmt::Display) -> FrameError {
    let what =
        format!("the image is damaged or cut off ({why}); replace it or take it out of the folder");
    FrameError::Invalid {
        path: path.into(),
        what,
    }
}

/// Returns the error for an image whose end is missing.
pub(super) fn cut_off(path: &Path) -> FrameError {
    damaged(path, &"its end is missing")
}

fn header_of(mut decoder: impl ImageDecoder) -> image::ImageResult<Header> {
    let (width, height) = decoder.dimensions();
    let orientation = Orientation(decoder.orientation()?.to_exif());
    let content = match decoder.color_type() {
        ColorType::L16 => Content::Grey16,
        ColorType::Rgb32F => Content::FloatColor,
        ColorType::Rgba32F => Content::FloatColorAlpha,
        color if color.has_alpha() => Content::ColorAlpha,
        _ => Content::Color,
    };
    Ok(Header {
        width,
        height,
        orientation,
        content,
    })
}

/// Reads a JPEG's segments up to the frame header.
///
/// Unlike a decoder it does not read the whole file.
fn read_jpeg_header(reader: &mut (impl BufRead + Seek)) -> std::io::Result<Header> {
    reader.seek(SeekFrom::Start(2))?;
    let mut orientation = Orientation::default();
    loop {
        let marker = next_marker(reader)?;
        if matches!(marker, 0x01 | 0xd0..=0xd8) {
            continue;
        }
        let length = u16::from_be_bytes(read_bytes(reader)?);
        let body = length
            .checked_sub(2)
            .ok_or_else(|| invalid("a segment of impossible length"))?;
        match marker {
            0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => {
                let [_, h1, h0, w1, w0, _] = read_bytes::<6>(reader)?;
                let (width, height) = (
                    u16::from_be_bytes([w1, w0]).into(),
                    u16::from_be_bytes([h1, h0]).into(),
                );
                return Ok(Header {
                    width,
                    height,
                    orientation,
                    content: Content::Color,
                });
            }
            0xd9 | 0xda => return Err(invalid("image data before a size")),
            0xe1 => {
                let mut segment = vec![0; body.into()];
                reader.read_exact(&mut segment)?;
                orientation = exif_orientation(&segment).unwrap_or(orientation);
            }
            _ => reader.seek_relative(body.into())?,
        }
    }
}

fn exif_orientation(segment: &[u8]) -> Option<Orientation> {
    let exif = segment.strip_prefix(b"Exif\0\0")?;
    image::metadata::Orientation::from_exif_chunk(exif).map(|o| Orientation(o.to_exif()))
}

fn invalid(what: &str) -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::InvalidData, what)
}

/// Returns the header of a TIFF with one channel of depth; `None` for every other TIFF.
fn depth_samples(reader: &mut BufReader<File>) -> Option<Header> {
    reader.rewind().ok()?;
    let mut decoder = Decoder::new(&mut *reader).ok()?;
    let tiff::ColorType::Gray(bits) = decoder.colortype().ok()? else {
        return None;
    };
    let format = sample_format(&mut decoder);
    let content = match (format, bits) {
        (SampleFormat::IEEEFP, 16 | 32 | 64) => Content::FloatDepth,
        (SampleFormat::Uint, 16) => Content::Grey16,
        (SampleFormat::Uint, 32) | (SampleFormat::Int, 16 | 32) => Content::IntegerDepth,
        _ => return None,
    };
    let (width, height) = decoder.dimensions().ok()?;
    let orientation = decoder
        .find_tag_unsigned::<u8>(Tag::Orientation)
        .ok()
        .flatten();
    let orientation = Orientation(
        orientation
            .filter(|value| (1..=8).contains(value))
            .unwrap_or(1),
    );
    Some(Header {
        width,
        height,
        orientation,
        content,
    })
}
