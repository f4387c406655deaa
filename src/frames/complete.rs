use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom};

use image::ImageFormat;

/// Last chunk of a PNG.
const PNG_END: [u8; 12] = [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82];

/// Maximum number of chunks of an image file: walking over more of them would take long.
const MAX_CHUNKS: usize = 1 << 20;

/// Returns whether an image file reaches its end; always true for TIFF, which has no end marker.
///
/// The file is neither decoded nor read into memory.
pub(super) fn is_complete(
    reader: &mut BufReader<File>,
    format: ImageFormat,
) -> std::io::Result<bool> {
    match format {
        ImageFormat::Jpeg => {
            if ends_with(reader, &[0xff, 0xd9])? {
                return Ok(true);
            }
            reader.rewind()?;
            is_complete_jpeg(reader) // other data may follow the image
        }
        ImageFormat::Png => Ok(ends_with(reader, &PNG_END)? || has_png_end(reader)?),
        ImageFormat::WebP => {
            let length = reader.seek(SeekFrom::End(0))?;
            reader.seek(SeekFrom::Start(4))?;
            let mut riff_length = [0; 4];
            reader.read_exact(&mut riff_length)?;
            Ok(u64::from(u32::from_le_bytes(riff_length)) + 8 <= length)
        }
        _ => Ok(true),
    }
}

/// Returns whether the image data of a JPEG end with an end marker.
///
/// Decoders fill missing data with grey.
pub(super) fn is_complete_jpeg(jpeg: &mut (impl BufRead + Seek)) -> std::io::Result<bool> {
    match has_jpeg_end(jpeg) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(false),
        found => found,
    }
}

fn has_jpeg_end(jpeg: &mut (impl BufRead + Seek)) -> std::io::Result<bool> {
    jpeg.seek(SeekFrom::Start(2))?;
    loop {
        match next_marker(jpeg)? {
            0xda => break,
            0x00 | 0x01 | 0xd0..=0xd8 => {}
            _ => {
                let length = u16::from_be_bytes(read_bytes(jpeg)?);
                jpeg.seek_relative(i64::from(length.saturating_sub(2)))?;
            }
        }
    }
    let mut after_marker = false;
    loop {
        let bytes = jpeg.fill_buf()?;
        if bytes.is_empty() {
            return Ok(false);
        }
        if after_marker && bytes[0] == 0xd9 || bytes.windows(2).any(|pair| pair == [0xff, 0xd9]) {
            return Ok(true);
        }
        after_marker = bytes.last() == Some(&0xff);
        let count = bytes.len();
        jpeg.consume(count);
    }
}

/// Returns whether no lossy frame of a WebP file is larger than the image.
///
/// Decoders compare the sizes only after they have decoded a frame, which may be as large as 16383
/// × 16383 pixels in a file of 100 bytes.
pub(super) fn webp_frames_fit(
    reader: &mut BufReader<File>,
    width: u32,
    height: u32,
) -> std::io::Result<bool> {
    let end = reader.seek(SeekFrom::End(0))?;
    let mut at = reader.seek(SeekFrom::Start(12))?;
    for _ in 0..MAX_CHUNKS {
        if at + 8 > end {
            return Ok(true);
        }
        let [kind @ .., l0, l1, l2, l3] = read_bytes::<8>(reader)?;
        at += 8;
        let length = u64::from(u32::from_le_bytes([l0, l1, l2, l3]));
        let (mut skipped, mut taken) = (length + length % 2, 0);
        match &kind {
            // The chunks of an animation's frame follow after its position and duration.
            b"ANMF" => skipped = 16,
            b"VP8 " if at + 10 <= end => {
                let [_, _, _, _, _, _, w0, w1, h0, h1] = read_bytes::<10>(reader)?;
                let side = |low, high| u32::from(u16::from_le_bytes([low, high]) & 0x3fff);
                if side(w0, w1) > width || side(h0, h1) > height {
                    return Ok(false);
                }
                taken = 10;
            }
            _ => {}
        }
        at += skipped;
        reader.seek_relative(skipped as i64 - taken)?;
    }
    Err(too_many_chunks())
}

fn too_many_chunks() -> std::io::Error {
    std::io::Error::new(
        ErrorKind::InvalidData,
        format!("it has more than {MAX_CHUNKS} chunks"),
    )
}

fn ends_with(reader: &mut BufReader<File>, end: &[u8]) -> std::io::Result<bool> {
    let length = reader.seek(SeekFrom::End(0))?;
    let Some(start) = length.checked_sub(end.len() as u64) else {
        return Ok(false);
    };
    reader.seek(SeekFrom::Start(start))?;
    let mut found = vec![0; end.len()];
    reader.read_exact(&mut found)?;
    Ok(found == end)
}

/// Returns whether a PNG that is followed by other data has its last chunk.
fn has_png_end(reader: &mut BufReader<File>) -> std::io::Result<bool> {
    let length = reader.seek(SeekFrom::End(0))?;
    let mut at = reader.seek(SeekFrom::Start(8))?;
    for _ in 0..MAX_CHUNKS {
        if at + 12 > length {
            return Ok(false);
        }
        let [l3, l2, l1, l0, kind @ ..] = read_bytes::<8>(reader)?;
        let rest = u64::from(u32::from_be_bytes([l3, l2, l1, l0])) + 4; // with the checksum
        at += 8 + rest;
        if kind == *b"IEND" {
            return Ok(at <= length);
        }
        reader.seek_relative(rest as i64)?;
    }
    Err(too_many_chunks())
}

/// Reads the code of the next marker of a JPEG.
pub(super) fn next_marker(reader: &mut impl Read) -> std::io::Result<u8> {
    let [mut byte] = read_bytes(reader)?;
    while byte != 0xff {
        [byte] = read_bytes(reader)?; // some cameras leave bytes between segments
    }
    while byte == 0xff {
        [byte] = read_bytes(reader)?;
    }
    Ok(byte)
}

/// Reads the next `N` bytes.
pub(super) fn read_bytes<const N: usize>(reader: &mut impl Read) -> std::io::Result<[u8; N]> {
    let mut bytes = [0; N];
    reader.read_exact(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complete(bytes: &[u8], format: ImageFormat) -> bool {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        is_complete(
            &mut BufReader::new(File::open(file.path()).unwrap()),
            format,
        )
        .unwrap_or(false)
    }

    #[test]
    fn truncated_image_is_distinguished_from_one_with_appended_data() {
        for format in [ImageFormat::Jpeg, ImageFormat::Png, ImageFormat::WebP] {
            let mut whole = std::io::Cursor::new(Vec::new());
            image::RgbImage::from_fn(60, 40, |x, y| image::Rgb([x as u8, y as u8, 9]))
                .write_to(&mut whole, format)
                .unwrap();
            let whole = whole.into_inner();
            assert!(complete(&whole, format), "{format:?}");
            assert!(
                complete(
                    &[whole.as_slice(), b"a video of two seconds"].concat(),
                    format
                ),
                "{format:?} and more"
            );
            for end in [whole.len() - 1, whole.len() * 2 / 3, 13] {
                assert!(!complete(&whole[..end], format), "{format:?} cut at {end}");
            }
        }
    }

    #[test]
    fn files_with_too_many_chunks_are_refused() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let open = |start: &[u8], chunk: &[u8]| {
            std::fs::write(
                file.path(),
                [start, &chunk.repeat(MAX_CHUNKS + 9), b"more"].concat(),
            )
            .unwrap();
            BufReader::new(File::open(file.path()).unwrap())
        };
        let png = is_complete(
            &mut open(b"\x89PNG\r\n\x1a\n", b"\0\0\0\0tEXt\0\0\0\0"),
            ImageFormat::Png,
        );
        assert!(png.unwrap_err().to_string().contains("chunks"));
        let webp = webp_frames_fit(
            &mut open(b"RIFF\xff\xff\xff\x7fWEBP", b"XXXX\0\0\0\0"),
            4,
            4,
        );
        assert!(webp.unwrap_err().to_string().contains("chunks"));
        let wide = [
            b"XXXX\x03\0\0\0....VP8 \x0a\0\0\0",
            &[0; 6][..],
            &[9, 0, 4, 0],
        ]
        .concat();
        let fits = |width: u32| {
            webp_frames_fit(
                &mut open(&[b"RIFF\0\0\0\0WEBP", &wide[..]].concat(), b""),
                width,
                4,
            )
        };
        assert!(fits(9).unwrap() && !fits(8).unwrap());
    }

    #[test]
    fn end_of_an_embedded_thumbnail_is_not_the_end() {
        let thumbnail = [0xff, 0xe1, 0, 6, 1, 2, 0xff, 0xd9];
        let cut = [
            &[0xff, 0xd8],
            thumbnail.as_slice(),
            &[0xff, 0xda, 0, 2, 1, 2, 3, 4],
        ]
        .concat();
        let complete = |bytes: &[u8]| is_complete_jpeg(&mut std::io::Cursor::new(bytes)).unwrap();
        assert!(!complete(&cut));
        assert!(complete(&[cut.as_slice(), &[0xff, 0xd9, 0]].concat()));
    }
}
