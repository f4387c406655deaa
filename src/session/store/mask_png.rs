use anyhow::{Result, bail, ensure};

use crate::masks::{LabelId, LabelMask, LabelTree};

/// A mask as a PNG whose pixel value is the label id: 8 bit with the labels' colours as palette, 16-bit grey once an
/// id exceeds 255.
///
/// # Errors
/// When the picture cannot be encoded.
pub fn encode(mask: &LabelMask, labels: &LabelTree) -> Result<Vec<u8>> {
    let wide = mask.ids.iter().any(|id| id.0 > 255);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, mask.width, mask.height);
    encoder.set_compression(png::Compression::Fast);
    let pixels: Vec<u8> = if wide {
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        mask.ids.iter().flat_map(|id| id.0.to_be_bytes()).collect()
    } else {
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_palette(palette(labels));
        mask.ids.iter().map(|id| id.0 as u8).collect()
    };
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels)?;
    writer.finish()?;
    Ok(bytes)
}

fn palette(labels: &LabelTree) -> Vec<u8> {
    let color = |id: u16| labels.get(LabelId(id)).map_or([0; 3], |label| label.color);
    (0..256).flat_map(color).collect()
}

/// Reads what [`encode`] wrote.
///
/// # Errors
/// When it is no such picture.
pub fn decode(bytes: &[u8]) -> Result<LabelMask> {
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info()?;
    let Some(size) = reader.output_buffer_size() else { bail!("the picture is too large") };
    let mut pixels = vec![0; size];
    let of = reader.next_frame(&mut pixels)?;
    let ids: Vec<LabelId> = match (of.color_type, of.bit_depth) {
        (png::ColorType::Indexed, png::BitDepth::Eight) => pixels.iter().map(|&id| LabelId(id.into())).collect(),
        (png::ColorType::Grayscale, png::BitDepth::Sixteen) => {
            pixels.chunks_exact(2).map(|id| LabelId(u16::from_be_bytes([id[0], id[1]]))).collect()
        }
        _ => bail!("the picture is no mask"),
    };
    ensure!(ids.len() as u64 == u64::from(of.width) * u64::from(of.height), "the picture is cut short");
    Ok(LabelMask { width: of.width, height: of.height, ids })
}
