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

/// The shape of an embedding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct EmbeddingShape {
    pub channels: usize,
    /// Cells along each side.
    pub cells: usize,
}

/// How a decoder is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dialect {
    /// Segment Anything: exclude clicks, an earlier answer to refine, one mask for clear questions and three for others.
    Sam,
    /// `EfficientSAM` (Xiong et al., CVPR 2024): include clicks and boxes, at most [`MOST_POINTS`] points, three masks.
    /// Its official files are used unchanged: an image (or a part of one) fills its square, it chooses none of its masks, and
    /// exclude clicks are answered outside of the network (`SamFrame::ask_include_only`).
    Efficient,
}

/// Points that `EfficientSAM` takes, corners of a box among them.
const MOST_POINTS: usize = 6;

/// Pixels of the encoder's square along each side of a cell of the embedding.
const CELL: usize = 16;
/// Logits along each side of a cell.
const FINE: usize = 4;

/// What is asked.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Question {
    /// Positions in pixels of the encoder's square, counted from the middle of the first.
    pub points: Vec<[f32; 2]>,
    /// What each is.
    pub kinds: Vec<PointKind>,
}

/// What a point of a question is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PointKind {
    Exclude,
    Include,
    FirstCorner,
    LastCorner,
    /// Stands where there is no box.
    Padding,
}

/// What a question may mean.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Answers {
    /// The mask for clear questions; `None` of a network that leaves the choice.
    pub clear: Option<Answer>,
    /// Those for ambiguous ones; none of a network that chose.
    pub others: Vec<Answer>,
}

/// A mask and how good the network thinks it is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Answer {
    /// Row by row, [`Decoder::fine`] along each side; above 0 = inside.
    pub logits: Vec<f32>,
    /// Predicted IoU.
    pub score: f32,
    /// Whether it stands for a mask from elsewhere, which the network had no part in.
    pub is_given: bool,
}

impl Question {
    /// Notes one more point.
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
    /// Finds the dialect by the names of the inputs.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] where it takes no square embedding.
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

    /// How it is asked.
    pub fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// The square that the encoder sees.
    pub fn canvas(&self) -> Canvas {
        Canvas {
            side: self.cells * CELL,
            is_filled: self.dialect == Dialect::Efficient,
        }
    }

    /// The shape of the embeddings that it takes.
    pub fn embedding(&self) -> EmbeddingShape {
        EmbeddingShape {
            channels: self.channels,
            cells: self.cells,
        }
    }

    /// Logits along each side of a mask, padding included.
    pub fn fine(&self) -> usize {
        self.cells * FINE
    }

    /// The masks that a question may mean. `before` are logits of an earlier answer that is to be refined, where the
    /// network can.
    pub fn run(
        &self,
        embedding: &Tensor,
        asked: &Question,
        before: Option<&[f32]>,
    ) -> Result<Answers, MaskError> {
        match self.dialect {
            Dialect::Sam => self.run_sam(embedding, asked, before),
            Dialect::Efficient => self.run_efficient(embedding, asked),
        }
    }

    fn run_sam(
        &self,
        embedding: &Tensor,
        asked: &Question,
        before: Option<&[f32]>,
    ) -> Result<Answers, MaskError> {
        let (count, fine) = (asked.points.len(), self.fine());
        let points = floats(&[1, count, 2], asked.points.as_flattened().to_vec())?;
        let kinds = floats(
            &[1, count],
            asked.kinds.iter().map(|kind| kind.number()).collect(),
        )?;
        let mask = floats(
            &[1, 1, fine, fine],
            before.map_or_else(|| vec![0.0; fine * fine], <[f32]>::to_vec),
        )?;
        let is_given = floats(&[1], vec![f32::from(u8::from(before.is_some()))])?;
        // The masks at the picture's size are made here, of the one that is chosen; of all they are asked for small.
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
        Ok(Answers {
            clear: Some(answers.remove(0)),
            others: answers,
        })
    }

    fn run_efficient(&self, embedding: &Tensor, asked: &Question) -> Result<Answers, MaskError> {
        // Masks come at the size that points are given in: at that of the logits nothing is resampled.
        let (fine, side) = (self.fine(), self.canvas().side);
        let all = || asked.points.iter().zip(&asked.kinds);
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
        Ok(Answers {
            clear: None,
            others: self.answers(&fed, "output_masks", &[3])?,
        })
    }

    /// The masks of one run, as many as one of the `counts`.
    fn answers(
        &self,
        fed: &[(&str, &Tensor)],
        masks: &str,
        counts: &[usize],
    ) -> Result<Vec<Answer>, MaskError> {
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
        let answer = |(logits, &score): (&[f32], &f32)| Answer {
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

/// The error of masks for an error of a network.
#[expect(
    clippy::needless_pass_by_value,
    reason = "`map_err` passes it by value"
)]
pub(super) fn network_error(error: NnError) -> MaskError {
    MaskError::Network(error.to_string())
}
