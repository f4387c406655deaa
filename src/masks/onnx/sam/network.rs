use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::decoder::{Decoder, EmbeddingShape, map_names};
use super::embedding::{Embedding, EmbeddingMap};
use super::frame::{SamFrame, bytes_of};
use super::part::{Canvas, ImagePart};
use crate::onnx::resize::resized;
use crate::{MaskError, PreparedFrame, Segmenter};
use ostra_compute::nn::{Dialect, Network, NnError, Port, Tensor, load_with_dialect};
use ostra_core::image::ImageSize;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::{DepthMap, Image};

/// Segment Anything in two networks.
///
/// One embeds an image (seconds), the other answers prompts (a tenth of a second).
#[derive(Debug)]
pub struct Sam {
    encoder: Network,
    decoder: Arc<Decoder>,
}

/// Mean and standard deviation per channel with which the encoder was trained.
const MEAN: [f32; 3] = [123.675, 116.28, 103.53];
const DEVIATION: [f32; 3] = [58.395, 57.12, 57.375];

impl Sam {
    /// Loads the networks of a Segment Anything model from a model folder.
    ///
    /// # Errors
    /// Fails if the networks are not installed there, do not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, name: &str) -> Result<Self, NnError> {
        let loaded = load_with_dialect(folder, name)?;
        let pair = <[Network; 2]>::try_from(loaded.networks);
        let [encoder, decoder] =
            pair.map_err(|_| NnError::Request(format!("`{name}` has no encoder and decoder")))?;
        let dialect = loaded.dialect.ok_or_else(|| {
            NnError::Request(format!(
                "the catalogue does not say which interface `{name}` has"
            ))
        })?;
        Self::new(dialect, encoder, decoder)
    }

    /// Combines an encoder and a decoder.
    ///
    /// The decoder has the inputs and outputs of the official export, except for `EfficientSAM`. The
    /// encoder takes the image as [`Dialect`] describes.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if the two do not belong together.
    pub fn new(dialect: Dialect, encoder: Network, decoder: Network) -> Result<Self, NnError> {
        let decoder = Decoder::new(decoder, dialect)?;
        let side = decoder.canvas().side;
        let input = EncoderInput::of(dialect);
        let [rows, columns] = if input.takes_any_size {
            [None; 2]
        } else {
            [Some(side); 2]
        };
        let shape = if input.is_interleaved {
            vec![rows, columns, Some(3)]
        } else {
            vec![Some(1), Some(3), rows, columns]
        };
        let fits = |port: &Port| {
            let sizes = port.shape.iter().zip(&shape);
            // The batch may be of any size.
            let same = |(at, (found, expected)): (usize, (&Option<usize>, &Option<usize>))| {
                found == expected || (at == 0 && !input.is_interleaved)
            };
            port.name == input.name
                && port.shape.len() == shape.len()
                && sizes.enumerate().all(same)
        };
        if !matches!(encoder.signature().inputs.as_slice(), [port] if fits(port)) {
            let size = |size: &Option<usize>| {
                size.map_or_else(|| "any".to_owned(), |size| size.to_string())
            };
            let shape: Vec<String> = shape.iter().map(size).collect();
            let what = format!(
                "expected the only input `{}` f32 [{}], which goes with the decoder",
                input.name,
                shape.join(", ")
            );
            return Err(NnError::Mismatch {
                path: encoder.path().to_owned(),
                what,
            });
        }
        Ok(Self {
            encoder,
            decoder: Arc::new(decoder),
        })
    }

    /// Returns the file of the encoder.
    #[must_use]
    pub fn encoder(&self) -> &Path {
        self.encoder.path()
    }

    /// Returns the side of the square that the encoder sees, pixels.
    ///
    /// Larger images are shrunk to it.
    #[must_use]
    pub fn side(&self) -> usize {
        self.decoder.canvas().side
    }

    /// Embeds a part of an image.
    ///
    /// In a small part, the network sees more of thin objects than in the whole image.
    ///
    /// # Errors
    /// [`MaskError::Request`] for a part that is not within the image, [`MaskError::Stopped`], or
    /// the error of the network.
    pub fn embed(
        &self,
        image: &Image,
        part: ImagePart,
        progress: &Progress,
    ) -> Result<Embedding, MaskError> {
        let Image { width, height, .. } = *image;
        if !part.is_within(width, height) || image.pixels.len() != width as usize * height as usize
        {
            let ImagePart {
                x,
                y,
                width: columns,
                height: rows,
            } = part;
            let part = format!("{columns}×{rows} pixels from {x}, {y}");
            return Err(MaskError::Request(format!(
                "{part} are not in the image of {width}×{height}; ask for less"
            )));
        }
        progress.step(0, 2)?;
        let dialect = self.decoder.dialect();
        let name = EncoderInput::of(dialect).name;
        let input = match dialect {
            Dialect::EfficientSam => fed_unscaled(image, part),
            Dialect::SamHwc => fed_interleaved(image, part, self.decoder.canvas()),
            _ => fed(image, part, self.decoder.canvas()),
        };
        let input = input?;
        progress.step(1, 2)?;
        let is_wanted = || progress.check().is_ok();
        let Some(given) = self.encoder.run_while(&[(name, &input)], &is_wanted)? else {
            return Err(Stopped.into());
        };
        let maps = self.maps(&given)?;
        progress.step(2, 2)?;
        Ok(Embedding {
            width,
            height,
            part,
            maps,
        })
    }

    /// Returns the maps of an embedding from the outputs of the encoder.
    ///
    /// An output whose name is not that of the decoder's input is taken by its place.
    fn maps(&self, given: &[Tensor]) -> Result<Vec<EmbeddingMap>, MaskError> {
        let outputs = &self.encoder.signature().outputs;
        let map = |(at, (name, shape)): (usize, (&&str, &EmbeddingShape))| {
            let EmbeddingShape { channels, cells } = *shape;
            let named = outputs.iter().position(|port| port.name == **name);
            let found = given.get(named.unwrap_or(at));
            let fits = |given: &&Tensor| given.shape() == [1, channels, cells, cells];
            let found = found.filter(fits).ok_or_else(|| {
                let path = self.encoder.path().display();
                MaskError::Network(format!(
                    "{path}: gives no embedding of {channels}×{cells}×{cells}"
                ))
            })?;
            Ok(EmbeddingMap {
                channels,
                cells,
                values: found.as_floats().to_vec(),
            })
        };
        let names = map_names(self.decoder.dialect()).iter();
        names
            .zip(self.decoder.maps())
            .enumerate()
            .map(map)
            .collect()
    }

    /// Returns the number of bytes that a frame of these networks holds.
    pub(super) fn bytes_of_frame(&self) -> usize {
        bytes_of(&self.decoder)
    }

    /// Creates a frame that answers prompts from an embedding of these networks.
    ///
    /// # Errors
    /// [`MaskError::Network`] if the embedding is from another network.
    pub fn frame(&self, embedding: &Embedding) -> Result<SamFrame, MaskError> {
        SamFrame::new(Arc::clone(&self.decoder), embedding)
    }
}

impl Segmenter for Sam {
    fn name(&self) -> &'static str {
        "sam"
    }

    fn prepare(
        &self,
        image: &Arc<Image>,
        _depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        let embedding = self.embed(image, ImagePart::whole(image.width, image.height), progress)?;
        Ok(Arc::new(self.frame(&embedding)?))
    }
}

/// The image that an encoder takes.
struct EncoderInput {
    name: &'static str,
    /// Whether it takes rows × columns × colours instead of planes.
    is_interleaved: bool,
    /// Whether it takes images of any size.
    takes_any_size: bool,
}

impl EncoderInput {
    fn of(dialect: Dialect) -> Self {
        let name = match dialect {
            Dialect::SamX => "x",
            Dialect::SamHwc => "input_image",
            Dialect::EfficientSam => "batched_images",
            Dialect::Sam2 => "input",
            _ => "image",
        };
        Self {
            name,
            is_interleaved: dialect == Dialect::SamHwc,
            takes_any_size: matches!(dialect, Dialect::SamHwc | Dialect::EfficientSam),
        }
    }
}

/// Returns the pixels of a part, row by row.
fn pixels(image: &Image, part: ImagePart) -> Vec<[u8; 3]> {
    let rows = image
        .pixels
        .chunks_exact(image.width as usize)
        .skip(part.y as usize)
        .take(part.height as usize);
    rows.flat_map(|row| &row[part.x as usize..][..part.width as usize])
        .copied()
        .collect()
}

/// Returns the part with colours from 0 to 1; `EfficientSAM` resizes it to its square itself.
fn fed_unscaled(image: &Image, part: ImagePart) -> Result<Tensor, NnError> {
    let pixels = pixels(image, part);
    let plane = |channel: usize| {
        pixels
            .iter()
            .map(move |pixel| f32::from(pixel[channel]) / 255.0)
    };
    Tensor::floats(
        &[1, 3, part.height as usize, part.width as usize],
        (0..3).flat_map(plane).collect(),
    )
}

/// Returns the part with its longer side as long as the square, rows × columns × RGB from 0 to 255.
///
/// The encoder normalises and pads it.
fn fed_interleaved(image: &Image, part: ImagePart, canvas: Canvas) -> Result<Tensor, NnError> {
    let shown = part.shown(canvas);
    let small = resized(
        &pixels(image, part),
        ImageSize::new(part.width as usize, part.height as usize),
        shown,
    );
    let values = small.as_flattened().iter().map(|&value| f32::from(value));
    Tensor::floats(&[shown.height, shown.width, 3], values.collect())
}

/// Returns the part as the encoder expects it.
///
/// Its longer side is as long as the square, or it fills the square. Colours are normalised, and the
/// rest at the right and below is zero.
fn fed(image: &Image, part: ImagePart, canvas: Canvas) -> Result<Tensor, NnError> {
    let (shown, side) = (part.shown(canvas), canvas.side);
    let small = resized(
        &pixels(image, part),
        ImageSize::new(part.width as usize, part.height as usize),
        shown,
    );
    let mut planes = vec![0.0; 3 * side * side];
    planes
        .par_chunks_mut(side)
        .enumerate()
        .for_each(|(line, out)| {
            let (channel, row) = (line / side, line % side);
            if row < shown.height {
                let values = small[row * shown.width..][..shown.width]
                    .iter()
                    .map(|pixel| f32::from(pixel[channel]));
                out.iter_mut()
                    .zip(values)
                    .for_each(|(out, value)| *out = (value - MEAN[channel]) / DEVIATION[channel]);
            }
        });
    Tensor::floats(&[1, 3, side, side], planes)
}
