use std::io::{Cursor, Read};
use std::path::Path;

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::complete::is_complete_jpeg;
use super::header::{cut_off, damaged, format_of, open};
use super::turn::turn;
use super::{DepthMap, FrameError, Image, Orientation};

// Nothing here may run on rayon's pool: a thread that waits there for parts of its own picture could steal work that
// asks the cache for the same picture and wait for itself.

/// Decodes a picture file and turns it upright.
pub(super) fn decode_picture(path: &Path, orientation: Orientation) -> Result<Image, FrameError> {
    let decoder = decoder_of(path)?;
    let (width, height) = decoder.dimensions();
    let pixels = read_rgb(decoder).map_err(|e| damaged(path, &e))?;
    let pixels = turn(pixels, width, height, orientation);
    let (width, height) = orientation.shown_size(width, height);
    Ok(Image { width, height, pixels })
}

/// Decodes a 16-bit depth picture to world units and turns it upright; stored 0 and 65535 become 0.
pub(super) fn decode_depth(path: &Path, unit: f64, orientation: Orientation) -> Result<DepthMap, FrameError> {
    let decoder = decoder_of(path)?;
    if decoder.color_type() != ColorType::L16 {
        return Err(not_depth(path));
    }
    let (width, height) = decoder.dimensions();
    let mut steps = vec![0_u16; width as usize * height as usize];
    decoder.read_image(bytemuck::cast_slice_mut(&mut steps)).map_err(|e| damaged(path, &e))?;
    let in_world = |step: u16| if step == u16::MAX { 0.0 } else { (f64::from(step) * unit) as f32 };
    let depths = turn(steps, width, height, orientation).into_iter().map(in_world).collect();
    let (width, height) = orientation.shown_size(width, height);
    Ok(DepthMap { width, height, depths })
}

/// The error for a picture in the place of depth that is not 16-bit grey.
pub(super) fn not_depth(path: &Path) -> FrameError {
    let what = "depth must be a grey picture of 16 bits (PNG or TIFF), and this one is not; \
                give the folder with the measured depth, not one drawn for viewing";
    FrameError::Invalid { path: path.into(), what: what.into() }
}

fn decoder_of(path: &Path) -> Result<Box<dyn ImageDecoder>, FrameError> {
    let mut reader = open(path)?;
    let format = format_of(&mut reader, path)?;
    if format != ImageFormat::Jpeg {
        let decoder = ImageReader::with_format(reader, format).into_decoder().map_err(|e| damaged(path, &e))?;
        return Ok(Box::new(decoder));
    }
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes).map_err(|source| FrameError::io(path, source))?;
    if !is_complete_jpeg(&bytes) {
        return Err(cut_off(path));
    }
    let reader = ImageReader::with_format(Cursor::new(bytes), format);
    Ok(Box::new(reader.into_decoder().map_err(|e| damaged(path, &e))?))
}

fn read_rgb(decoder: Box<dyn ImageDecoder>) -> image::ImageResult<Vec<[u8; 3]>> {
    let (width, height) = decoder.dimensions();
    if decoder.color_type() == ColorType::Rgb8 {
        let mut pixels = vec![[0; 3]; width as usize * height as usize];
        decoder.read_image(bytemuck::cast_slice_mut(&mut pixels))?;
        return Ok(pixels);
    }
    let rgb = DynamicImage::from_decoder(decoder)?.into_rgb8();
    Ok(bytemuck::cast_slice(rgb.as_raw()).to_vec())
}
