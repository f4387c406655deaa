use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom};

use image::ImageFormat;

use super::header::{next_marker, read_bytes};

/// The chunk that closes a PNG.
const PNG_END: [u8; 12] = [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82];

/// Whether an image file reaches its end, found without decoding it and without reading it into memory; always for TIFF,
/// which has no end.
pub(super) fn is_complete(reader: &mut BufReader<File>, format: ImageFormat) -> std::io::Result<bool> {
    match format {
        ImageFormat::Jpeg => {
            if ends_with(reader, &[0xff, 0xd9])? {
                return Ok(true);
            }
            reader.rewind()?;
            is_complete_jpeg(reader) // something may follow the image
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

/// Whether the image data of a JPEG are closed by an end marker: decoders fill what is missing with grey.
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

/// Whether the lossy frames of a WebP file are not larger than the image. Decoders compare the sizes only after they have
/// decoded a frame, which may be as large as 16383 × 16383 pixels in a file of 100 bytes.
pub(super) fn webp_frames_fit(reader: &mut (impl Read + Seek), width: u32, height: u32) -> std::io::Result<bool> {
    let end = reader.seek(SeekFrom::End(0))?;
    let mut at = 12;
    while at + 8 <= end {
        reader.seek(SeekFrom::Start(at))?;
        let [kind @ .., l0, l1, l2, l3] = read_bytes::<8>(reader)?;
        let length = u64::from(u32::from_le_bytes([l0, l1, l2, l3]));
        match &kind {
            // The chunks of an animation's frame follow after its place and duration.
            b"ANMF" => at += 8 + 16,
            b"VP8 " if at + 18 <= end => {
                let [_, _, _, _, _, _, w0, w1, h0, h1] = read_bytes::<10>(reader)?;
                let side = |low, high| u32::from(u16::from_le_bytes([low, high]) & 0x3fff);
                if side(w0, w1) > width || side(h0, h1) > height {
                    return Ok(false);
                }
                at += 8 + length + length % 2;
            }
            _ => at += 8 + length + length % 2,
        }
    }
    Ok(true)
}

fn ends_with(reader: &mut BufReader<File>, end: &[u8]) -> std::io::Result<bool> {
    let length = reader.seek(SeekFrom::End(0))?;
    let Some(start) = length.checked_sub(end.len() as u64) else { return Ok(false) };
    reader.seek(SeekFrom::Start(start))?;
    let mut found = vec![0; end.len()];
    reader.read_exact(&mut found)?;
    Ok(found == end)
}

/// Walks over the chunks of a PNG that something else follows.
fn has_png_end(reader: &mut BufReader<File>) -> std::io::Result<bool> {
    let length = reader.seek(SeekFrom::End(0))?;
    let mut at = 8;
    while at + 12 <= length {
        reader.seek(SeekFrom::Start(at))?;
        let mut head = [0; 8];
        reader.read_exact(&mut head)?;
        let [l3, l2, l1, l0, kind @ ..] = head;
        at += 12 + u64::from(u32::from_be_bytes([l3, l2, l1, l0]));
        if kind == *b"IEND" {
            return Ok(at <= length);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complete(bytes: &[u8], format: ImageFormat) -> bool {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        is_complete(&mut BufReader::new(File::open(file.path()).unwrap()), format).unwrap_or(false)
    }

    #[test]
    fn a_cut_picture_is_told_from_one_that_something_follows() {
        for format in [ImageFormat::Jpeg, ImageFormat::Png, ImageFormat::WebP] {
            let mut whole = std::io::Cursor::new(Vec::new());
            image::RgbImage::from_fn(60, 40, |x, y| image::Rgb([x as u8, y as u8, 9]))
                .write_to(&mut whole, format)
                .unwrap();
            let whole = whole.into_inner();
            assert!(complete(&whole, format), "{format:?}");
            assert!(complete(&[whole.as_slice(), b"a film of two seconds"].concat(), format), "{format:?} and more");
            for end in [whole.len() - 1, whole.len() * 2 / 3, 13] {
                assert!(!complete(&whole[..end], format), "{format:?} cut at {end}");
            }
        }
    }

    #[test]
    fn the_end_of_an_embedded_thumbnail_is_not_the_end() {
        let thumbnail = [0xff, 0xe1, 0, 6, 1, 2, 0xff, 0xd9];
        let cut = [&[0xff, 0xd8], thumbnail.as_slice(), &[0xff, 0xda, 0, 2, 1, 2, 3, 4]].concat();
        let complete = |bytes: &[u8]| is_complete_jpeg(&mut std::io::Cursor::new(bytes)).unwrap();
        assert!(!complete(&cut));
        assert!(complete(&[cut.as_slice(), &[0xff, 0xd9, 0]].concat()));
    }
}
