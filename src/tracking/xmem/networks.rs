use super::fit::Fit;
use super::memory::{Elements, Widths, transpose};
use crate::networks::{check_signature, mismatch, run};
use ostra_compute::nn::{Network, NnError, Tensor};
use ostra_core::image::ImageSize;
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::MaskError;

/// The three networks.
#[derive(Debug)]
pub(super) struct XMemNetworks {
    key_encoder: Network,
    value_encoder: Network,
    decoder: Network,
    /// Channels per cell of a memory readout and of sensory memory.
    value: usize,
    pub hidden: usize,
}

/// Number of objects per network run; more need more memory and no less time.
const OBJECTS: usize = 10;

/// Encoder output for one image, independent of objects.
pub(super) struct ImageEncoding {
    pub fit: Fit,
    image: Tensor,
    /// Features at a 16th, an 8th and a 4th of the size.
    features: [Tensor; 3],
    /// Key, shrinkage and selection of every cell, without values.
    pub cells: Elements,
}

/// Network output for every object.
pub(super) struct ObjectOutputs {
    /// Shape `[objects][…]`.
    pub values: Vec<f32>,
    /// Sensory memory, `[objects][hidden][cells]`.
    pub hidden: Vec<f32>,
}

impl XMemNetworks {
    /// Checks the three networks.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if one has other inputs than expected.
    pub fn new([key_encoder, value_encoder, decoder]: [Network; 3]) -> Result<Self, NnError> {
        check_signature(&key_encoder, &["image"], &[])?;
        check_signature(
            &value_encoder,
            &["image", "f16", "hidden", "masks", "others"],
            &[],
        )?;
        check_signature(&decoder, &["f16", "f8", "f4", "readout", "hidden"], &[])?;
        let (value, hidden) = (
            channels(&decoder, "readout")?,
            channels(&decoder, "hidden")?,
        );
        if channels(&value_encoder, "hidden")? != hidden {
            return Err(mismatch(
                &value_encoder,
                "is of another size than the decoder",
            ));
        }
        Ok(Self {
            key_encoder,
            value_encoder,
            decoder,
            value,
            hidden,
        })
    }

    /// Encodes an image.
    pub fn see(
        &self,
        image: &Image,
        fit: Fit,
        progress: &Progress,
    ) -> Result<ImageEncoding, MaskError> {
        let ImageSize { width, height } = fit.padded;
        let image = Tensor::floats(&[1, 3, height, width], fit.planes(image))?;
        let given = run(&self.key_encoder, &[("image", &image)], progress)?;
        let [key, shrinkage, selection, f16, f8, f4] = outputs(&self.key_encoder, given)?;
        let ImageSize {
            width: columns,
            height: rows,
        } = fit.cells();
        let count = columns * rows;
        let width = key.as_floats().len() / count;
        if shrinkage.shape() != [1, 1, rows, columns]
            || selection.shape() != key.shape()
            || width == 0
        {
            return Err(unusable(&self.key_encoder));
        }
        let mut cells = Elements::new(
            Widths {
                key: width,
                value: self.value,
            },
            0,
        );
        cells.keys = by_cell(key.as_floats(), count);
        cells.selections = by_cell(selection.as_floats(), count);
        cells.shrinkages = shrinkage.as_floats().to_vec();
        Ok(ImageEncoding {
            fit,
            image,
            features: [f16, f8, f4],
            cells,
        })
    }

    /// Decodes logits `[objects][rows][columns]`.
    ///
    /// The inputs are the memory readout, `[objects][value][cells]`, and sensory memory.
    pub fn decode(
        &self,
        seen: &ImageEncoding,
        readout: &[f32],
        hidden: &[f32],
        progress: &Progress,
    ) -> Result<ObjectOutputs, MaskError> {
        let ImageSize {
            width: columns,
            height: rows,
        } = seen.fit.cells();
        let [f16, f8, f4] = &seen.features;
        let size = columns * rows;
        let parts = readout
            .chunks(OBJECTS * self.value * size)
            .zip(hidden.chunks(OBJECTS * self.hidden * size));
        let mut outputs = ObjectOutputs {
            values: Vec::new(),
            hidden: Vec::new(),
        };
        for (readout, hidden) in parts {
            let count = hidden.len() / (self.hidden * size);
            let readout = Tensor::floats(&[count, self.value, rows, columns], readout.to_vec())?;
            let hidden = Tensor::floats(&[count, self.hidden, rows, columns], hidden.to_vec())?;
            let fed = [
                ("f16", f16),
                ("f8", f8),
                ("f4", f4),
                ("readout", &readout),
                ("hidden", &hidden),
            ];
            outputs.add(
                &self.decoder,
                run(&self.decoder, &fed, progress)?,
                count * seen.fit.area(),
                hidden.shape(),
            )?;
        }
        Ok(outputs)
    }

    /// Encodes the memory values of each object, `[objects][value][cells]`.
    ///
    /// `masks` are the objects' probabilities, `[objects][area]`.
    pub fn value(
        &self,
        seen: &ImageEncoding,
        masks: &[f32],
        hidden: &[f32],
        progress: &Progress,
    ) -> Result<ObjectOutputs, MaskError> {
        let ImageSize {
            width: columns,
            height: rows,
        } = seen.fit.cells();
        let (area, size) = (seen.fit.area(), columns * rows);
        let others = others(masks, area);
        let parts = masks
            .chunks(OBJECTS * area)
            .zip(others.chunks(OBJECTS * area));
        let mut outputs = ObjectOutputs {
            values: Vec::new(),
            hidden: Vec::new(),
        };
        for ((masks, others), hidden) in parts.zip(hidden.chunks(OBJECTS * self.hidden * size)) {
            let count = masks.len() / area;
            let shape = [count, 1, seen.fit.padded.height, seen.fit.padded.width];
            let masks = Tensor::floats(&shape, masks.to_vec())?;
            let others = Tensor::floats(&shape, others.to_vec())?;
            let hidden = Tensor::floats(&[count, self.hidden, rows, columns], hidden.to_vec())?;
            let fed = [
                ("image", &seen.image),
                ("f16", &seen.features[0]),
                ("hidden", &hidden),
            ];
            let fed = [fed.as_slice(), &[("masks", &masks), ("others", &others)]].concat();
            let given = run(&self.value_encoder, &fed, progress)?;
            outputs.add(
                &self.value_encoder,
                given,
                count * self.value * size,
                hidden.shape(),
            )?;
        }
        Ok(outputs)
    }
}

impl ObjectOutputs {
    fn add(
        &mut self,
        by: &Network,
        given: Vec<Tensor>,
        count: usize,
        hidden: &[usize],
    ) -> Result<(), MaskError> {
        let [values, renewed] = outputs(by, given)?;
        if values.as_floats().len() != count || renewed.shape() != hidden {
            return Err(unusable(by));
        }
        self.values.extend_from_slice(values.as_floats());
        self.hidden.extend_from_slice(renewed.as_floats());
        Ok(())
    }
}

impl ImageEncoding {
    /// Returns the features `f16`, `f8` or `f4`.
    #[cfg(test)]
    pub fn feature(&self, name: &str) -> &Tensor {
        let place = ["f16", "f8", "f4"]
            .iter()
            .position(|&known| known == name)
            .unwrap();
        &self.features[place]
    }

    /// Returns the cells with the objects' values, given as `[objects][value][cells]`.
    pub fn with_values(&self, values: &[f32]) -> Elements {
        let count = self.cells.len();
        let of = values.chunks_exact(self.cells.widths.value * count);
        self.cells
            .with_values(of.map(|values| by_cell(values, count)).collect())
    }
}

/// Transposes `[parts][cells]` to `[cells][parts]`.
fn by_cell(planes: &[f32], cells: usize) -> Vec<f32> {
    let mut rows = vec![0.0; planes.len()];
    transpose(planes, cells, &mut rows);
    rows
}

/// Returns the sum of all other objects' masks for each object.
fn others(masks: &[f32], area: usize) -> Vec<f32> {
    let objects: Vec<&[f32]> = masks.chunks_exact(area).collect();
    let mut out = vec![0.0; masks.len()];
    for (object, out) in out.chunks_exact_mut(area).enumerate() {
        for (_, other) in objects
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != object)
        {
            out.iter_mut()
                .zip(*other)
                .for_each(|(sum, value)| *sum += value);
        }
    }
    out
}

fn outputs<const N: usize>(
    network: &Network,
    given: Vec<Tensor>,
) -> Result<[Tensor; N], MaskError> {
    <[Tensor; N]>::try_from(given).map_err(|_| unusable(network))
}

fn unusable(network: &Network) -> MaskError {
    let path = network.path().display();
    MaskError::Network(format!(
        "{path}: has other outputs than a file made by assets/export/xmem.py; export it again"
    ))
}

fn channels(network: &Network, name: &str) -> Result<usize, NnError> {
    let port = network
        .signature()
        .inputs
        .iter()
        .find(|port| port.name == name);
    match port.map(|port| port.shape.as_slice()) {
        Some([_, Some(channels), _, _]) => Ok(*channels),
        _ => Err(mismatch(
            network,
            &format!("expected the input `{name}` f32 [any, channels, any, any]"),
        )),
    }
}
