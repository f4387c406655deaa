use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use image::{ColorType, ImageDecoder, ImageFormat, ImageReader};

use super::complete::is_complete;
use super::{FrameError, Orientation};

/// The formats that can be frames, as named to the user.
pub(super) const FORMATS: &str = "JPEG, PNG, TIFF or WebP";

/// Pictures with more pixels are refused: a damaged header, or more than one machine can work on.
pub(super) const MAX_PIXELS: u64 = 1 << 28;

/// What a picture file's header says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    /// Columns as stored.
    pub width: u32,
    /// Rows as stored.
    pub height: u32,
    /// The turn to apply when shown.
    pub orientation: Orientation,
    /// One channel of 16 bits: what depth is stored as.
    pub grey16: bool,
}

/// Reads size, orientation and kind from the first bytes of a picture file, and looks whether its end is there.
pub(super) fn read_header(path: &Path) -> Result<Header, FrameError> {
    let mut reader = open(path)?;
    let format = format_of(&mut reader, path)?;
    if !is_complete(&mut reader, format).map_err(|source| FrameError::io(path, source))? {
        return Err(cut_off(path));
    }
    reader.rewind().map_err(|source| FrameError::io(path, source))?;
    let header = match format {
        ImageFormat::Jpeg => read_jpeg_header(&mut reader).map_err(|e| damaged(path, &e))?,
        format => {
            let decoder = ImageReader::with_format(reader, format).into_decoder();
            decoder.and_then(header_of).map_err(|e| damaged(path, &e))?
        }
    };
    let pixels = u64::from(header.width) * u64::from(header.height);
    if pixels == 0 || pixels > MAX_PIXELS {
        let what = format!(
            "its header says {} × {} pixels, which cannot be read (at most {} million); replace it or make it smaller",
            header.width,
            header.height,
            MAX_PIXELS / 1_000_000
        );
        return Err(FrameError::Invalid { path: path.into(), what });
    }
    Ok(header)
}

/// Opens a source file; one that is gone is told apart from one that cannot be read.
pub(super) fn open(path: &Path) -> Result<BufReader<File>, FrameError> {
    File::open(path).map(BufReader::new).map_err(|source| FrameError::io(path, source))
}

/// The picture format, from the file's first bytes, whatever its name ends with.
pub(super) fn format_of(reader: &mut BufReader<File>, path: &Path) -> Result<ImageFormat, FrameError> {
    let start = reader.fill_buf().map_err(|source| FrameError::io(path, source))?;
    match image::guess_format(start) {
        Ok(format @ (ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::Tiff | ImageFormat::WebP)) => Ok(format),
        _ => {
            let what = format!("this is no {FORMATS} picture; remove it or replace it");
            Err(FrameError::Invalid { path: path.into(), what })
        }
    }
}

/// Whether a file's first bytes are those of a picture.
pub(super) fn is_picture(path: &Path) -> Result<bool, FrameError> {
    match format_of(&mut open(path)?, path) {
        Ok(_) => Ok(true),
        Err(FrameError::Invalid { .. }) => Ok(false),
        Err(error) => Err(error),
    }
}

/// The error for a picture that breaks off or does not follow its format.
pub(super) fn damaged(path: &Path, why: &dyn std::fmt::Display) -> FrameError {
    let what = format!("the picture is damaged or cut off ({why}); replace it or take it out of the folder");
    FrameError::Invalid { path: path.into(), what }
}

/// The error for a picture whose end is missing.
pub(super) fn cut_off(path: &Path) -> FrameError {
    damaged(path, &"its end is missing")
}

fn header_of(mut decoder: impl ImageDecoder) -> image::ImageResult<Header> {
    let (width, height) = decoder.dimensions();
    let orientation = Orientation(decoder.orientation()?.to_exif());
    Ok(Header { width, height, orientation, grey16: decoder.color_type() == ColorType::L16 })
}

/// Walks the segments up to the frame header; unlike a decoder it does not read the whole file.
fn read_jpeg_header(reader: &mut (impl BufRead + Seek)) -> std::io::Result<Header> {
    reader.seek(SeekFrom::Start(2))?;
    let mut orientation = Orientation::default();
    loop {
        let marker = next_marker(reader)?;
        if matches!(marker, 0x01 | 0xd0..=0xd8) {
            continue;
        }
        let length = u16::from_be_bytes(read_bytes(reader)?);
        let body = length.checked_sub(2).ok_or_else(|| invalid("a segment of impossible length"))?;
        match marker {
            0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => {
                let [_, h1, h0, w1, w0, _] = read_bytes::<6>(reader)?;
                let (width, height) = (u16::from_be_bytes([w1, w0]).into(), u16::from_be_bytes([h1, h0]).into());
                return Ok(Header { width, height, orientation, grey16: false });
            }
            0xd9 | 0xda => return Err(invalid("picture data before a size")),
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

fn next_marker(reader: &mut impl Read) -> std::io::Result<u8> {
    let [mut byte] = read_bytes(reader)?;
    while byte != 0xff {
        [byte] = read_bytes(reader)?; // some cameras leave bytes between segments
    }
    while byte == 0xff {
        [byte] = read_bytes(reader)?;
    }
    Ok(byte)
}

fn read_bytes<const N: usize>(reader: &mut impl Read) -> std::io::Result<[u8; N]> {
    let mut bytes = [0; N];
    reader.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn invalid(what: &str) -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::InvalidData, what)
}
