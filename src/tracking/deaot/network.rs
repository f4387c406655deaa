use crate::networks::{check_signature, run};
use ostra_compute::nn::{Network, NnError, Tensor};
use ostra_core::job::Progress;
use ostra_masks::MaskError;

/// The four networks, shared by all passes.
#[derive(Debug)]
pub(super) struct DeAotNetworks {
    encoder: Network,
    remember: Network,
    propagate: Network,
    identify: Network,
    names: TensorNames,
}

/// Number of objects in one run; the first channel of a run is the background.
pub(super) const OBJECTS: usize = 10;

/// Names of inputs and outputs, layer by layer.
#[derive(Debug)]
struct TensorNames {
    memory: Vec<[String; PARTS]>,
    long: Vec<[String; PARTS]>,
    short: Vec<[String; PARTS]>,
    /// Trace names of all layers but the first, which has no trace.
    traces: Vec<String>,
}

const FEATURES: [&str; 4] = ["fine", "middle", "coarse", "embedding"];

/// Encoder output for one image.
#[derive(Debug)]
pub(super) struct EncoderFeatures([Tensor; FEATURES.len()]);

/// Result of propagating one group of objects to an image.
#[derive(Debug)]
pub(super) struct NetworkOutput {
    /// Shape `[1, 11, rows, columns]`, at a quarter of the image size.
    pub logits: Tensor,
    /// Key and value of every layer.
    kept: Vec<[Tensor; 2]>,
    traces: Vec<Tensor>,
}

impl DeAotNetworks {
    /// Checks the four networks, which `assets/export/deaot.py` writes.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if one has other inputs or outputs.
    pub fn new([encoder, remember, propagate, identify]: [Network; 4]) -> Result<Self, NnError> {
        let names = TensorNames::of(remember.signature().outputs.len() / PARTS);
        let memory: Vec<&str> = names
            .memory
            .as_flattened()
            .iter()
            .map(String::as_str)
            .collect();
        let requested: Vec<&str> = [&names.long, &names.short]
            .into_iter()
            .flat_map(|term| term.as_flattened())
            .map(String::as_str)
            .collect();
        let identities: Vec<&str> = names
            .memory
            .iter()
            .map(|[.., identity]| identity.as_str())
            .collect();
        let traces: Vec<&str> = names.traces.iter().map(String::as_str).collect();
        check_signature(&encoder, &["image"], &FEATURES)?;
        check_signature(&remember, &["embedding", "mask"], &memory)?;
        check_signature(
            &propagate,
            &[&FEATURES[..], &requested].concat(),
            &[&["logits"], &traces[..]].concat(),
        )?;
        check_signature(&identify, &[&["mask"], &traces[..]].concat(), &identities)?;
        Ok(Self {
            encoder,
            remember,
            propagate,
            identify,
            names,
        })
    }

    /// Binds the networks to the job's progress, which can stop them.
    pub fn running<'a>(&'a self, progress: &'a Progress) -> Running<'a> {
        Running {
            networks: self,
            progress,
        }
    }
}

/// The networks together with the progress that can stop them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Running<'a> {
    networks: &'a DeAotNetworks,
    progress: &'a Progress,
}

impl<'a> Running<'a> {
    fn names(self) -> &'a TensorNames {
        &self.networks.names
    }

    fn run(
        self,
        network: &'a Network,
        fed: &[(&str, &Tensor)],
    ) -> Result<RunOutputs<'a>, MaskError> {
        let given = run(network, fed, self.progress)?;
        Ok(RunOutputs {
            network,
            tensors: given.into_iter().map(Some).collect(),
        })
    }

    pub fn encode(self, image: &Tensor) -> Result<EncoderFeatures, MaskError> {
        let mut given = self.run(&self.networks.encoder, &[("image", image)])?;
        let [fine, middle, coarse, embedding] = FEATURES.map(|name| given.take(name, 4));
        Ok(EncoderFeatures([fine?, middle?, coarse?, embedding?]))
    }

    /// Returns the memory of an image with a given mask.
    ///
    /// The mask is `[1, 11, rows, columns]` of zeros and ones.
    pub fn remember(
        self,
        features: &EncoderFeatures,
        mask: &Tensor,
    ) -> Result<ImageMemory, MaskError> {
        let EncoderFeatures([.., embedding]) = features;
        let mut given = self.run(
            &self.networks.remember,
            &[("embedding", embedding), ("mask", mask)],
        )?;
        let layer = |[key, value, identity]: &[String; PARTS]| {
            Ok([
                given.take(key, 2)?,
                given.take(value, 2)?,
                given.take(identity, 2)?,
            ])
        };
        Ok(ImageMemory {
            layers: self
                .names()
                .memory
                .iter()
                .map(layer)
                .collect::<Result<_, MaskError>>()?,
        })
    }

    /// Propagates the objects to an image, from long-term memory and the image before.
    pub fn propagate(
        self,
        features: &EncoderFeatures,
        long: &ImageMemory,
        short: &ImageMemory,
    ) -> Result<NetworkOutput, MaskError> {
        let EncoderFeatures(features) = features;
        let terms = [(&self.names().long, long), (&self.names().short, short)];
        let memories = terms.into_iter().flat_map(|(names, memory)| {
            names
                .as_flattened()
                .iter()
                .map(String::as_str)
                .zip(memory.layers.as_flattened())
        });
        let fed: Vec<(&str, &Tensor)> =
            FEATURES.into_iter().zip(features).chain(memories).collect();
        let mut given = self.run(&self.networks.propagate, &fed)?;
        let logits = given.take("logits", 4)?;
        if logits.shape()[1] != OBJECTS + 1 {
            return Err(given.unfit("logits"));
        }
        let layer =
            |[key, value, _]: &[String; PARTS]| Ok([given.take(key, 2)?, given.take(value, 2)?]);
        let kept = self
            .names()
            .memory
            .iter()
            .map(layer)
            .collect::<Result<_, MaskError>>()?;
        let traces = self
            .names()
            .traces
            .iter()
            .map(|name| given.take(name, 2))
            .collect::<Result<_, MaskError>>()?;
        Ok(NetworkOutput {
            logits,
            kept,
            traces,
        })
    }

    /// Returns the memory of an image that was propagated to, now that its mask is known.
    pub fn identify(self, seen: NetworkOutput, mask: &Tensor) -> Result<ImageMemory, MaskError> {
        let traces = self
            .names()
            .traces
            .iter()
            .map(String::as_str)
            .zip(&seen.traces);
        let fed: Vec<(&str, &Tensor)> = [("mask", mask)].into_iter().chain(traces).collect();
        let mut given = self.run(&self.networks.identify, &fed)?;
        let layer = |([key, value], [.., name]): ([Tensor; 2], &[String; PARTS])| {
            Ok([key, value, given.take(name, 2)?])
        };
        let layers = seen.kept.into_iter().zip(&self.names().memory).map(layer);
        Ok(ImageMemory {
            layers: layers.collect::<Result<_, MaskError>>()?,
        })
    }
}

impl TensorNames {
    fn of(layers: usize) -> Self {
        let named = |term: &str| -> Vec<[String; PARTS]> {
            let one =
                |at: usize| ["key", "value", "identity"].map(|part| format!("{term}{part}_{at}"));
            (0..layers).map(one).collect()
        };
        let traces = (1..layers).map(|at| format!("trace_{at}")).collect();
        Self {
            memory: named(""),
            long: named("long_"),
            short: named("short_"),
            traces,
        }
    }
}

/// Outputs of a run, by name.
struct RunOutputs<'a> {
    network: &'a Network,
    tensors: Vec<Option<Tensor>>,
}

impl RunOutputs<'_> {
    fn take(&mut self, name: &str, dimensions: usize) -> Result<Tensor, MaskError> {
        let at = self
            .network
            .signature()
            .outputs
            .iter()
            .position(|port| port.name == name);
        let tensor = at.and_then(|at| self.tensors.get_mut(at)?.take());
        tensor
            .filter(|tensor| tensor.shape().len() == dimensions)
            .ok_or_else(|| self.unfit(name))
    }

    fn unfit(&self, name: &str) -> MaskError {
        MaskError::Network(format!(
            "{}: gives no fitting `{name}`",
            self.network.path().display()
        ))
    }
}

/// Key, value and identity.
const PARTS: usize = 3;

/// Memory of one image: key, value and identity per layer, each `[cells, channels]`.
#[derive(Debug)]
pub(super) struct ImageMemory {
    pub layers: Vec<[Tensor; PARTS]>,
}

/// Memory of a bounded number of images.
#[derive(Debug)]
pub(super) struct LongMemory {
    /// Laid out as for one image, with the cells of all images one after the other.
    pub memory: ImageMemory,
    /// Whether each image's mask was given.
    is_given: Vec<bool>,
    most: usize,
}

impl LongMemory {
    /// Starts with the memory of an image whose mask was given.
    pub fn new(first: &ImageMemory, most: usize) -> Self {
        Self {
            memory: ImageMemory {
                layers: first.layers.clone(),
            },
            is_given: vec![true],
            most: most.max(1),
        }
    }

    /// Adds the memory of an image.
    ///
    /// At the limit, the oldest image whose mask was not given is removed. If all masks were given,
    /// the oldest image after the first is removed.
    pub fn push(&mut self, image: &ImageMemory, is_given: bool) -> Result<(), NnError> {
        let count = self.is_given.len();
        let is_full = count >= self.most;
        if is_full && self.most == 1 {
            if is_given {
                *self = Self::new(image, self.most);
            }
            return Ok(());
        }
        let gone = is_full.then(|| {
            self.is_given
                .iter()
                .position(|is_given| !is_given)
                .unwrap_or(1)
        });
        let all = self.memory.layers.iter_mut().zip(&image.layers);
        for (kept, new) in all.flat_map(|(kept, new)| kept.iter_mut().zip(new)) {
            *kept = joined(kept, new, gone)?;
        }
        gone.map(|gone| self.is_given.remove(gone));
        self.is_given.push(is_given);
        Ok(())
    }
}

/// Concatenates the cells of several images without image `gone`, and those of a new one.
fn joined(kept: &Tensor, new: &Tensor, gone: Option<usize>) -> Result<Tensor, NnError> {
    let (values, size) = (kept.as_floats(), new.as_floats().len());
    let (before, after) = gone.map_or((values, &[][..]), |at| {
        (&values[..at * size], &values[(at + 1) * size..])
    });
    let values = [before, after, new.as_floats()].concat();
    let channels = *new.shape().last().unwrap_or(&1);
    Tensor::floats(&[values.len() / channels, channels], values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(value: f32) -> ImageMemory {
        let part = || Tensor::floats(&[2, 1], vec![value, value + 0.5]).unwrap();
        ImageMemory {
            layers: vec![std::array::from_fn(|_| part())],
        }
    }

    fn kept(long: &LongMemory) -> Vec<f32> {
        let [key, _, identity] = &long.memory.layers[0];
        assert_eq!(key, identity);
        assert_eq!(key.shape(), [key.as_floats().len(), 1]);
        key.as_floats().iter().step_by(2).copied().collect()
    }

    #[test]
    fn images_with_given_masks_stay_and_the_oldest_others_are_removed() {
        let mut long = LongMemory::new(&of(0.0), 4);
        for at in 1..6 {
            long.push(&of(at as f32), at == 2).unwrap();
        }
        assert_eq!(kept(&long), [0.0, 2.0, 4.0, 5.0]);
        for at in 6..9 {
            long.push(&of(at as f32), true).unwrap();
        }
        assert_eq!(
            kept(&long),
            [0.0, 6.0, 7.0, 8.0],
            "the first and the latest"
        );
    }

    #[test]
    fn memory_of_one_image_keeps_the_last_given_mask() {
        let mut long = LongMemory::new(&of(0.0), 1);
        long.push(&of(1.0), false).unwrap();
        assert_eq!(kept(&long), [0.0]);
        long.push(&of(2.0), true).unwrap();
        assert_eq!(kept(&long), [2.0]);
    }
}
