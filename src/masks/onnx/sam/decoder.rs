use super::part::Canvas;
use crate::MaskError;
use ostra_compute::nn::{Network, NnError, Tensor};

/// The network that answers prompts from an embedding.
#[derive(Debug)]
pub(super) struct Decoder {
    network: Network,
    dialect: Dialect,
    channels: usize,
    cells: usize,
}

/// Shape of an embedding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct EmbeddingShape {
    pub channels: usize,
    /// Number of cells along each side.
    pub cells: usize,
}

/// Interface of a decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dialect {
    /// Segment Anything.
    ///
    /// Knows exclude clicks, can refine an earlier answer, and gives one mask for clear prompts and
    /// three for ambiguous ones.
    Sam,
    /// `EfficientSAM` (Xiong et al., CVPR 2024).
    ///
    /// Takes include clicks and boxes, at most [`MOST_POINTS`] points, and gives three masks. Its
    /// official files are used unchanged: an image (or a part of one) fills its square, and it does
    /// not choose among its masks. Exclude clicks are handled outside of the network
    /// (`SamFrame::ask_include_only`).
    Efficient,
}

/// Maximum number of points for `EfficientSAM`, including corners of a box.
const MOST_POINTS: usize = 6;

/// Pixels of the encoder's square along each side of a cell of the embedding.
const CELL: usize = 16;
/// Logits along each side of a cell.
const FINE: usize = 4;

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
    /// Creates a decoder; the interface is recognised by the names of the inputs.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if the network does not take a square embedding.
    pub fn new(network: Network) -> Result<Self, NnError> {
        let named = |name: &str| {
            network
                .signature()
                .inputs
                .iter()
                .find(|port| port.name == name)
        };
        let dialect = if named("batched_point_coords").is_some() {
            Dialect::Efficient
        } else {
            Dialect::Sam
        };
        let sizes = named("image_embeddings").map(|port| port.shape.as_slice());
        let Some([_, Some(channels), Some(rows), Some(columns)]) = sizes else {
            let what =
                "expected the input `image_embeddings` f32 [1, channels, cells, cells]".to_owned();
            return Err(NnError::Mismatch {
                path: network.path().to_owned(),
                what,
            });
        };
        if rows != columns {
            let what =
                format!("expected as many rows as columns of cells, it takes {rows}×{columns}");
            return Err(NnError::Mismatch {
                path: network.path().to_owned(),
                what,
            });
        }
        let (channels, cells) = (*channels, *rows);
        Ok(Self {
            network,
            dialect,
            channels,
            cells,
        })
    }

    /// Returns the interface.
    pub fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// Returns the square that the encoder sees.
    pub fn canvas(&self) -> Canvas {
        Canvas {
            side: self.cells * CELL,
            is_filled: self.dialect == Dialect::Efficient,
        }
    }

    /// Returns the shape of the embeddings that the decoder takes.
    pub fn embedding(&self) -> EmbeddingShape {
        EmbeddingShape {
            channels: self.channels,
            cells: self.cells,
        }
    }

    /// Returns the number of logits along each side of a mask, padding included.
    pub fn fine(&self) -> usize {
        self.cells * FINE
    }

    /// Returns the candidate masks for a prompt.
    ///
    /// `before` are the logits of an earlier answer to refine; they are ignored if the network
    /// cannot refine.
    pub fn run(
        &self,
        embedding: &Tensor,
        prompt: &DecoderPrompt,
        before: Option<&[f32]>,
    ) -> Result<CandidateMasks, MaskError> {
        match self.dialect {
            Dialect::Sam => self.run_sam(embedding, prompt, before),
            Dialect::Efficient => self.run_efficient(embedding, prompt),
        }
    }

    fn run_sam(
        &self,
        embedding: &Tensor,
        prompt: &DecoderPrompt,
        before: Option<&[f32]>,
    ) -> Result<CandidateMasks, MaskError> {
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
        // Only the chosen mask is enlarged to the size of the image, outside of the network. The
        // network is asked for a small size.
        let size = floats(&[2], vec![CELL as f32; 2])?;
        let fed = [
            ("image_embeddings", embedding),
            ("point_coords", &points),
            ("point_labels", &kinds),
            ("mask_input", &mask),
            ("has_mask_input", &is_given),
            ("orig_im_size", &size),
        ];
        let mut answers = self.answers(&fed, "low_res_masks", &[1, 4])?;
        Ok(CandidateMasks {
            clear: Some(answers.remove(0)),
            others: answers,
        })
    }

    fn run_efficient(
        &self,
        embedding: &Tensor,
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
        let size = Tensor::integers(&[2], vec![fine as i64; 2]).map_err(network_error)?;
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
        let given = self.network.run(fed).map_err(network_error)?;
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

fn floats(shape: &[usize], values: Vec<f32>) -> Result<Tensor, MaskError> {
    Tensor::floats(shape, values).map_err(network_error)
}

/// Converts an error of a network.
#[expect(
    clippy::needless_pass_by_value,
    reason = "`map_err` passes it by value"
)]
pub(super) fn network_error(error: NnError) -> MaskError {
    MaskError::Network(error.to_string())
}
