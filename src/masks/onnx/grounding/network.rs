use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec2;

use super::caption::{Caption, Tokenizer};
use super::grounding_output::GroundingOutput;
use super::network_input::NetworkInput;
use crate::{GroundRequest, Grounded, MaskError, TextGrounder};
use ostra_compute::nn::{Dialect, Network, NnError, Tensor, load_text, load_with_dialect};
use ostra_core::job::{Progress, Stopped};
use ostra_frames::Image;

/// Finds objects described by free text.
///
/// Caches its last answer: another threshold for the same image and phrases needs no run.
#[derive(Debug)]
pub struct GroundingDino {
    network: Network,
    dialect: Dialect,
    tokenizer: Tokenizer,
    last: Mutex<Option<(NetworkInput, Arc<GroundingOutput>)>>,
}

/// Output of the network for every query.
struct RawAnswer {
    logits: Vec<f32>,
    boxes: Vec<f32>,
}

/// Name in the catalogue, on the command line and in the model folder.
const NAME: &str = "grounding-dino";
/// Default score threshold.
const LEAST_SCORE: f32 = 0.3;
/// Names of the inputs.
const INPUTS: [&str; 4] = ["image", "input_ids", "position_ids", "attention_mask"];
/// Names of the inputs of the export of Hugging Face.
const HF_INPUTS: [&str; 5] = [
    "pixel_values",
    "input_ids",
    "token_type_ids",
    "attention_mask",
    "pixel_mask",
];
/// Logit of tokens that a query was not asked about.
const NOT_ASKED: f32 = -1e3;

impl GroundingDino {
    /// Loads the network `grounding-dino` and its vocabulary from a model folder.
    ///
    /// # Errors
    /// Fails if it is not installed there, does not load, its vocabulary does not match, or ONNX
    /// Runtime is missing.
    pub fn load(folder: &Path) -> Result<Self, NnError> {
        let missing = || NnError::Request(format!("the catalogue has no file for `{NAME}`"));
        let vocabulary = load_text(folder, NAME)?.pop().ok_or_else(missing)?;
        let mut loaded = load_with_dialect(folder, NAME)?;
        let network = loaded.networks.pop().ok_or_else(missing)?;
        let dialect = loaded.dialect.unwrap_or(Dialect::GroundingDino);
        Self::new(dialect, network, &vocabulary)
    }

    /// Wraps a network exported by `assets/export/grounding_dino.py` or by Hugging Face.
    ///
    /// `vocabulary` is the text of BERT's `vocab.txt`.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] for a network with other inputs, [`NnError::Request`] for a vocabulary
    /// without the tokens that every caption needs.
    pub fn new(dialect: Dialect, network: Network, vocabulary: &str) -> Result<Self, NnError> {
        let there = &network.signature().inputs;
        let expected = match dialect {
            Dialect::GroundingDinoHf => &HF_INPUTS[..],
            _ => &INPUTS[..],
        };
        if there.len() != expected.len()
            || !expected
                .iter()
                .all(|name| there.iter().any(|port| port.name == *name))
        {
            let what = format!("expected the inputs {}", expected.join(", "));
            return Err(NnError::Mismatch {
                path: network.path().to_owned(),
                what,
            });
        }
        let tokenizer =
            Tokenizer::new(vocabulary).map_err(|error| NnError::Request(error.to_string()))?;
        Ok(Self {
            network,
            dialect,
            tokenizer,
            last: Mutex::default(),
        })
    }

    /// Runs the network on an image and some phrases; the answer can be read at any threshold.
    ///
    /// # Errors
    /// [`MaskError::Request`] for invalid or too many phrases (see [`Caption::new`]) and for an
    /// empty or very narrow image; [`MaskError::Stopped`], or the error of the network.
    pub fn detect(
        &self,
        image: &Image,
        phrases: &[String],
        progress: &Progress,
    ) -> Result<Arc<GroundingOutput>, MaskError> {
        let caption = Caption::new(&self.tokenizer, phrases)?;
        let input = match self.dialect {
            Dialect::GroundingDinoHf => NetworkInput::square(image)?,
            _ => NetworkInput::new(image)?,
        };
        let size_px = DVec2::new(image.width.into(), image.height.into());
        let answer = if let Some(answer) = self.known(&input, &caption, size_px) {
            answer
        } else {
            let RawAnswer { logits, boxes } = match self.dialect {
                Dialect::GroundingDinoHf => self.run_each(&input, &caption, phrases, progress)?,
                _ => {
                    progress.step(0, 1)?;
                    let answer = self.run(&input, &caption, progress)?;
                    progress.step(1, 1)?;
                    answer
                }
            };
            let answer = Arc::new(GroundingOutput {
                caption,
                logits,
                boxes,
                size_px,
            });
            *self.last.lock().unwrap_or_else(PoisonError::into_inner) =
                Some((input, Arc::clone(&answer)));
            answer
        };
        Ok(answer)
    }

    /// Returns the last answer if image and phrases are the same.
    fn known(
        &self,
        input: &NetworkInput,
        caption: &Caption,
        size_px: DVec2,
    ) -> Option<Arc<GroundingOutput>> {
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let (before, answer) = last.as_ref()?;
        let is_same = before == input && answer.caption == *caption && answer.size_px == size_px;
        is_same.then(|| Arc::clone(answer))
    }

    /// Runs the network and returns logits and boxes of every query.
    fn run(
        &self,
        input: &NetworkInput,
        caption: &Caption,
        progress: &Progress,
    ) -> Result<RawAnswer, MaskError> {
        let (count, image) = (caption.ids.len(), planes(input)?);
        let ids = integers(&[1, count], caption.ids.clone())?;
        let positions = integers(&[1, count], caption.positions.clone())?;
        let attention = integers(&[1, count, count], caption.attention())?;
        let [a, b, c, d] = INPUTS;
        let inputs = [(a, &image), (b, &ids), (c, &positions), (d, &attention)];
        self.answer(&inputs, count, count, progress)
    }

    /// Runs the network once for each phrase, and returns the queries of all runs.
    ///
    /// The export of Hugging Face has no mask that keeps the phrases of a caption apart, so that they
    /// would influence each other. A query has logits only for the phrase of its run.
    fn run_each(
        &self,
        input: &NetworkInput,
        all: &Caption,
        phrases: &[String],
        progress: &Progress,
    ) -> Result<RawAnswer, MaskError> {
        let mut answer = RawAnswer {
            logits: Vec::new(),
            boxes: Vec::new(),
        };
        for (number, phrase) in phrases.iter().enumerate() {
            progress.step(number, phrases.len())?;
            let caption = Caption::new(&self.tokenizer, std::slice::from_ref(phrase))?;
            let alone = self.run_hf(input, &caption, progress)?;
            answer.boxes.extend(alone.boxes);
            // The tokens of the phrase come after the start token in its own caption.
            let first = all.phrases.iter().position(|one| *one == Some(number));
            let first = first.unwrap_or(0);
            let own = caption.ids.len() - 2;
            for logits in alone.logits.chunks_exact(caption.ids.len()) {
                let mut row = vec![NOT_ASKED; all.ids.len()];
                row[first..first + own].copy_from_slice(&logits[1..=own]);
                answer.logits.extend(row);
            }
        }
        progress.step(phrases.len(), phrases.len())?;
        Ok(answer)
    }

    fn run_hf(
        &self,
        input: &NetworkInput,
        caption: &Caption,
        progress: &Progress,
    ) -> Result<RawAnswer, MaskError> {
        let (count, image) = (caption.ids.len(), planes(input)?);
        let (rows, columns) = (input.rows, input.columns);
        let ids = integers(&[1, count], caption.ids.clone())?;
        let types = integers(&[1, count], vec![0; count])?;
        let attention = integers(&[1, count], vec![1; count])?;
        let shown = integers(&[1, rows, columns], vec![1; rows * columns])?;
        let tensors = [&image, &ids, &types, &attention, &shown];
        let inputs: Vec<(&str, &Tensor)> = HF_INPUTS.into_iter().zip(tensors).collect();
        self.answer(&inputs, count, Caption::MOST, progress)
    }

    /// Runs the network; of `given` logits for each query, the first `count` are those of tokens.
    fn answer(
        &self,
        inputs: &[(&str, &Tensor)],
        count: usize,
        given: usize,
        progress: &Progress,
    ) -> Result<RawAnswer, MaskError> {
        let is_wanted = || progress.check().is_ok();
        let answer = self.network.run_while(inputs, &is_wanted)?.ok_or(Stopped)?;
        if let [logits, boxes] = answer.as_slice()
            && let [1, queries, tokens] = *logits.shape()
            && tokens == given
            && boxes.shape() == [1, queries, 4]
        {
            let of_tokens = logits
                .as_floats()
                .chunks_exact(tokens)
                .flat_map(|row| &row[..count]);
            return Ok(RawAnswer {
                logits: of_tokens.copied().collect(),
                boxes: boxes.as_floats().to_vec(),
            });
        }
        let path = self.network.path().display();
        Err(MaskError::Network(format!(
            "{path}: does not give a logit for each token and a box for each query"
        )))
    }
}

/// Returns the image of an input.
fn planes(input: &NetworkInput) -> Result<Tensor, MaskError> {
    let shape = [1, 3, input.rows, input.columns];
    Tensor::floats(&shape, input.planes()).map_err(MaskError::from)
}

fn integers(shape: &[usize], values: Vec<i64>) -> Result<Tensor, MaskError> {
    Tensor::integers(shape, values).map_err(MaskError::from)
}

impl TextGrounder for GroundingDino {
    fn name(&self) -> &'static str {
        NAME
    }

    fn vocabulary(&self) -> Option<&'static [&'static str]> {
        None
    }

    fn ground(
        &self,
        image: &Image,
        request: &GroundRequest<'_>,
        progress: &Progress,
    ) -> Result<Vec<Grounded>, MaskError> {
        let answer = self.detect(image, request.phrases, progress)?;
        Ok(answer.above(request.threshold.unwrap_or(LEAST_SCORE)))
    }
}
