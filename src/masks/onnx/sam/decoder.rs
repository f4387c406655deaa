use super::part::Canvas;
use crate::MaskError;
use ostra_compute::nn::{Dialect, Network, NnError, Tensor};

/// The network that answers prompts from an embedding.
#[derive(Debug)]
pub(super) struct Decoder {
    network: Network,
    dialect: Dialect,
    /// Shapes of the maps of an embedding, in the order of [`map_names`].
    maps: Vec<EmbeddingShape>,
}

/// Shape of one map of an embedding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct EmbeddingShape {
    pub channels: usize,
    /// Number of cells along each side.
    pub cells: usize,
}

/// Returns the names of the maps of an embedding, the one of the masks' resolution first.
///
/// They are outputs of the encoder and inputs of the decoder.
pub(super) fn map_names(dialect: Dialect) -> &'static [&'static str] {
    match dialect {
        Dialect::Sam2 => &[
            "image_embeddings",
            "high_res_features1",
            "high_res_features2",
        ],
        _ => &["image_embeddings"],
    }
}

/// Maximum number of points for `EfficientSAM`, including corners of a box.
const MOST_POINTS: usize = 6;

/// Pixels of the encoder's square along each side of a cell of the embedding.
const CELL: usize = 16;
/// Logits along each side of a cell.
const FINE: usize = 4;

/// Minimum stability of a mask for clear prompts of Segment Anything 2, and the offset of the logits
/// for it; values of the official configuration.
const LEAST_STABILITY: f64 = 0.98;
const STABILITY_OFFSET: f32 = 0.05;

/// A prompt as the decoder expects it.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct DecoderPrompt {
    /// Positions in pixels of the encoder's square, relative to the centre of the first pixel.
    pub points: Vec<[f32; 2]>,
    /// Kind of each point.
    pub kinds: Vec<PointKind>,
}

/// Kind of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PointKind {
    Exclude,
    Include,
    FirstCorner,
    LastCorner,
    /// Placeholder if there is no box.
    Padding,
}

/// Candidate masks for a prompt.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CandidateMasks {
    /// Mask for clear prompts; `None` if the network does not choose.
    pub clear: Option<MaskPrediction>,
    /// Masks for ambiguous prompts; empty if the network has chosen.
    pub others: Vec<MaskPrediction>,
}

/// A mask and its predicted quality.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MaskPrediction {
    /// Logits, row by row, [`Decoder::fine`] along each side; above 0 = inside.
    pub logits: Vec<f32>,
    /// Predicted IoU.
    pub score: f32,
    /// Whether the mask was given from outside instead of predicted by the network.
    pub is_given: bool,
}

impl DecoderPrompt {
    /// Adds a point.
    pub fn add(&mut self, at: [f32; 2], kind: PointKind) {
        self.points.push(at);
        self.kinds.push(kind);
    }
}

impl PointKind {
    fn number(self) -> f32 {
        match self {
            Self::Exclude => 0.0,
            Self::Include => 1.0,
            Self::FirstCorner => 2.0,
            Self::LastCorner => 3.0,
            Self::Padding => -1.0,
        }
    }

    fn is_corner(self) -> bool {
        matches!(self, Self::FirstCorner | Self::LastCorner)
    }
}

impl Decoder {
    /// Creates a decoder.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if the network does not take square embeddings.
    pub fn new(network: Network, dialect: Dialect) -> Result<Self, NnError> {
        let maps = map_names(dialect)
            .iter()
            .map(|name| map_shape(&network, name))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            network,
            dialect,
            maps,
        })
    }

    /// Returns the interface.
    pub fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// Returns the square that the encoder sees.
    pub fn canvas(&self) -> Canvas {
        Canvas {
            side: self.cells() * CELL,
            is_filled: matches!(self.dialect, Dialect::EfficientSam | Dialect::Sam2),
        }
    }

    /// Returns the shapes of the maps of an embedding.
    pub fn maps(&self) -> &[EmbeddingShape] {
        &self.maps
    }

    /// Returns the number of cells along each side of the square.
    fn cells(&self) -> usize {
        self.maps.first().map_or(0, |map| map.cells)
    }

    /// Returns the number of logits along each side of a mask, padding included.
    pub fn fine(&self) -> usize {
        self.cells() * FINE
    }

    /// Returns the candidate masks for a prompt.
    ///
    /// `before` are the logits of an earlier answer to refine; they are ignored if the network
    /// cannot refine.
    pub fn run(
        &self,
        embedding: &[Tensor],
        prompt: &DecoderPrompt,
        before: Option<&[f32]>,
    ) -> Result<CandidateMasks, MaskError> {
        match self.dialect {
            Dialect::EfficientSam => self.run_efficient(embedding, prompt),
            Dialect::Sam2 => self.run_sam2(embedding, prompt, before),
            _ => self.run_sam(embedding, prompt, before),
        }
    }

    fn run_sam(
        &self,
        embedding: &[Tensor],
        prompt: &DecoderPrompt,
        before: Option<&[f32]>,
    ) -> Result<CandidateMasks, MaskError> {
        // Only the chosen mask is enlarged to the size of the image, outside of the network. The
        // network is asked for a small size.
        let size = floats(&[2], vec![CELL as f32; 2])?;
        let mut answers = self.refined(embedding, prompt, before, &size, &[1, 4])?;
        Ok(CandidateMasks {
            clear: Some(answers.remove(0)),
            others: answers,
        })
    }

    /// As [`Self::run_sam`], for the decoder of Segment Anything 2, which adds the padding itself.
    ///
    /// A mask for clear prompts that is unstable is replaced by the best of the others, as in the
    /// official code (`dynamic_multimask_via_stability`).
    fn run_sam2(
        &self,
        embedding: &[Tensor],
        prompt: &DecoderPrompt,
        before: Option<&[f32]>,
    ) -> Result<CandidateMasks, MaskError> {
        let points = prompt.points.iter().zip(&prompt.kinds);
        let own = points.filter(|(_, kind)| **kind != PointKind::Padding);
        let (points, kinds) = own.map(|(at, kind)| (*at, *kind)).unzip();
        let prompt = DecoderPrompt { points, kinds };
        let size = Tensor::integers(&[2], vec![CELL as i64; 2])?;
        let mut others = self.refined(embedding, &prompt, before, &size, &[4])?;
        let mut clear = others.remove(0);
        if stability(&clear.logits) < LEAST_STABILITY
            && let Some(best) = others.iter().max_by(|a, b| a.score.total_cmp(&b.score))
        {
            clear = best.clone();
        }
        Ok(CandidateMasks {
            clear: Some(clear),
            others,
        })
    }

    /// Runs a decoder that takes an earlier answer; `size` is the image size it is asked for.
    fn refined(
        &self,
        embedding: &[Tensor],
        prompt: &DecoderPrompt,
        before: Option<&[f32]>,
        size: &Tensor,
        counts: &[usize],
    ) -> Result<Vec<MaskPrediction>, MaskError> {
        let (count, fine) = (prompt.points.len(), self.fine());
        let points = floats(&[1, count, 2], prompt.points.as_flattened().to_vec())?;
        let kinds = floats(
            &[1, count],
            prompt.kinds.iter().map(|kind| kind.number()).collect(),
        )?;
        let mask = floats(
            &[1, 1, fine, fine],
            before.map_or_else(|| vec![0.0; fine * fine], <[f32]>::to_vec),
        )?;
        let is_given = floats(&[1], vec![f32::from(u8::from(before.is_some()))])?;
        let mut fed: Vec<(&str, &Tensor)> = map_names(self.dialect)
            .iter()
            .copied()
            .zip(embedding)
            .collect();
        fed.extend([
            ("point_coords", &points),
            ("point_labels", &kinds),
            ("mask_input", &mask),
            ("has_mask_input", &is_given),
            ("orig_im_size", size),
        ]);
        self.answers(&fed, "low_res_masks", counts)
    }

    fn run_efficient(
        &self,
        embedding: &[Tensor],
        prompt: &DecoderPrompt,
    ) -> Result<CandidateMasks, MaskError> {
        // Masks have the size in which points are given; at the size of the logits nothing is
        // resampled.
        let (fine, side) = (self.fine(), self.canvas().side);
        let all = || prompt.points.iter().zip(&prompt.kinds);
        let corners: Vec<_> = all().filter(|(_, kind)| kind.is_corner()).collect();
        let clicks: Vec<_> = all()
            .filter(|(_, kind)| **kind == PointKind::Include)
            .collect();
        let latest = &clicks[clicks.len().saturating_sub(MOST_POINTS - corners.len())..];
        let used: Vec<_> = corners.iter().chain(latest).collect();
        let points = used
            .iter()
            .flat_map(|(at, _)| at.map(|at| at * (fine as f32 / side as f32)))
            .collect();
        let kinds = used.iter().map(|(_, kind)| kind.number()).collect();
        let points = floats(&[1, 1, used.len(), 2], points)?;
        let kinds = floats(&[1, 1, used.len()], kinds)?;
        let size = Tensor::integers(&[2], vec![fine as i64; 2])?;
        let [embedding] = embedding else {
            return Err(MaskError::Network("the embedding has several maps".into()));
        };
        let fed = [
            ("image_embeddings", embedding),
            ("batched_point_coords", &points),
            ("batched_point_labels", &kinds),
            ("orig_im_size", &size),
        ];
        Ok(CandidateMasks {
            clear: None,
            others: self.answers(&fed, "output_masks", &[3])?,
        })
    }

    /// Runs the network and returns its masks; their number must be one of `counts`.
    fn answers(
        &self,
        fed: &[(&str, &Tensor)],
        masks: &str,
        counts: &[usize],
    ) -> Result<Vec<MaskPrediction>, MaskError> {
        let given = self.network.run(fed)?;
        let ports = &self.network.signature().outputs;
        let named = |name: &str| {
            ports
                .iter()
                .position(|port| port.name == name)
                .and_then(|at| given.get(at))
        };
        let fine = self.fine();
        let all = named(masks)
            .zip(named("iou_predictions"))
            .and_then(|(masks, scores)| {
                let count = scores.as_floats().len();
                let fits = masks.shape().ends_with(&[count, fine, fine]) && counts.contains(&count);
                fits.then(|| {
                    masks
                        .as_floats()
                        .chunks_exact(fine * fine)
                        .zip(scores.as_floats())
                })
            });
        let path = self.network.path().display();
        let unfit = || {
            MaskError::Network(format!(
                "{path}: gives no masks of {fine}×{fine} with their scores"
            ))
        };
        let answer = |(logits, &score): (&[f32], &f32)| MaskPrediction {
            logits: logits.to_vec(),
            score,
            is_given: false,
        };
        Ok(all.ok_or_else(unfit)?.map(answer).collect())
    }
}

/// Returns the shape of the map that the network takes under a name.
fn map_shape(network: &Network, name: &str) -> Result<EmbeddingShape, NnError> {
    let ports = &network.signature().inputs;
    let port = ports.iter().find(|port| port.name == name);
    let mismatch = |what: String| NnError::Mismatch {
        path: network.path().to_owned(),
        what,
    };
    let Some([_, Some(channels), Some(rows), Some(columns)]) =
        port.map(|port| port.shape.as_slice())
    else {
        return Err(mismatch(format!(
            "expected the input `{name}` f32 [1, channels, cells, cells]"
        )));
    };
    if rows != columns {
        return Err(mismatch(format!(
            "expected as many rows as columns of cells, it takes {rows}×{columns}"
        )));
    }
    Ok(EmbeddingShape {
        channels: *channels,
        cells: *rows,
    })
}

/// Returns the share of a mask that remains when the threshold of its logits rises.
fn stability(logits: &[f32]) -> f64 {
    let above = |least: f32| logits.iter().filter(|&&logit| logit > least).count();
    let possible = above(-STABILITY_OFFSET);
    if possible == 0 {
        return 1.0;
    }
    above(STABILITY_OFFSET) as f64 / possible as f64
}

fn floats(shape: &[usize], values: Vec<f32>) -> Result<Tensor, MaskError> {
    Tensor::floats(shape, values).map_err(MaskError::from)
}
