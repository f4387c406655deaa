use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};

use image::ImageFormat;

/// The chunk that closes a PNG.
const PNG_END: [u8; 12] = [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82];

/// Whether a picture file reaches its end, found out without decoding it; TIFF, which has no end, always does.
pub(super) fn is_complete(reader: &mut BufReader<File>, format: ImageFormat) -> std::io::Result<bool> {
    match format {
        ImageFormat::Jpeg => {
            if ends_with(reader, &[0xff, 0xd9])? {
                return Ok(true);
            }
            let mut bytes = Vec::new(); // something may follow the picture
            reader.rewind()?;
            reader.read_to_end(&mut bytes)?;
            Ok(is_complete_jpeg(&bytes))
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

/// Whether the picture data of a JPEG are closed by an end marker: decoders fill what is missing with grey.
pub(super) fn is_complete_jpeg(jpeg: &[u8]) -> bool {
    let mut at = 2;
    while let Some(&[marker, code, high, low]) = jpeg.get(at..at + 4) {
        match (marker, code) {
            (0xff, 0xda) => return jpeg[at..].windows(2).rev().any(|pair| pair == [0xff, 0xd9]),
            (0xff, 0x01 | 0xd0..=0xd8) => at += 2,
            (0xff, 0x02..=0xfe) => at += 2 + usize::from(u16::from_be_bytes([high, low])),
            _ => at += 1,
        }
    }
    false
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
        assert!(!is_complete_jpeg(&cut));
        assert!(is_complete_jpeg(&[cut.as_slice(), &[0xff, 0xd9, 0]].concat()));
    }
}
