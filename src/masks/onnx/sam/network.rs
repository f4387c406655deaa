use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::decoder::{Decoder, Dialect, EmbeddingShape, network_error};
use super::embedding::Embedding;
use super::frame::{SamFrame, bytes_of};
use super::part::{Canvas, ImagePart};
use crate::onnx::resize::resized;
use crate::{MaskError, PreparedFrame, Segmenter};
use ostra_compute::nn::{Network, NnError, Signature, Tensor, load};
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
    /// Loads the networks `sam-vit-b`, `mobile-sam` or `efficient-sam` from a model folder.
    ///
    /// # Errors
    /// Fails if the networks are not installed there, do not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, name: &str) -> Result<Self, NnError> {
        let pair = <[Network; 2]>::try_from(load(folder, name)?);
        let [encoder, decoder] =
            pair.map_err(|_| NnError::Request(format!("`{name}` has no encoder and decoder")))?;
        Self::new(encoder, decoder)
    }

    /// Combines an encoder and a decoder.
    ///
    /// The encoder maps `image` [1, 3, side, side] to `image_embeddings` [1, channels, cells,
    /// cells]; the decoder has the inputs and outputs of the official export. Alternatively, both
    /// are those of the official export of `EfficientSAM`, whose encoder takes `batched_images` [1,
    /// 3, rows, columns] of any size.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if the two do not belong together.
    pub fn new(encoder: Network, decoder: Network) -> Result<Self, NnError> {
        let decoder = Decoder::new(decoder)?;
        let side = decoder.canvas().side;
        let (fits, expected) = match decoder.dialect() {
            Dialect::Sam => (
                takes(encoder.signature(), "image", [Some(side); 2]),
                format!("`image` f32 [1, 3, {side}, {side}]"),
            ),
            Dialect::Efficient => (
                takes(encoder.signature(), "batched_images", [None; 2]),
                "`batched_images` f32 [1, 3, any, any]".to_owned(),
            ),
        };
        if !fits {
            let what = format!("expected the only input {expected}, which goes with the decoder");
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
        let (name, input) = match self.decoder.dialect() {
            Dialect::Sam => ("image", fed(image, part, self.decoder.canvas())),
            Dialect::Efficient => ("batched_images", fed_unscaled(image, part)),
        };
        let input = input.map_err(network_error)?;
        progress.step(1, 2)?;
        let is_wanted = || progress.check().is_ok();
        let Some(given) = self
            .encoder
            .run_while(&[(name, &input)], &is_wanted)
            .map_err(network_error)?
        else {
            return Err(Stopped.into());
        };
        let EmbeddingShape { channels, cells } = self.decoder.embedding();
        let Some(embedding) = given
            .first()
            .filter(|given| given.shape() == [1, channels, cells, cells])
        else {
            let path = self.encoder.path().display();
            return Err(MaskError::Network(format!(
                "{path}: gives no embedding of {channels}×{cells}×{cells}"
            )));
        };
        progress.step(2, 2)?;
        Ok(Embedding {
            width,
            height,
            part,
            channels,
            cells,
            values: embedding.as_floats().to_vec(),
        })
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

/// Returns whether the only input is a colour image of that many rows and columns (`None` = any).
fn takes(signature: &Signature, name: &str, size: [Option<usize>; 2]) -> bool {
    let [port] = signature.inputs.as_slice() else {
        return false;
    };
    port.name == name
        && matches!(port.shape.as_slice(), [_, Some(3), rows, columns] if [*rows, *columns] == size)
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

/// Returns the part as the encoder expects it.
///
/// Its longer side is as long as the square. Colours are normalised, and the rest at the right and
/// below is zero.
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
