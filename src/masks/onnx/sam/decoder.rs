use super::network::told;
use crate::engine::nn::{Network, NnError, Tensor};
use crate::masks::MaskError;

/// The network that answers prompts from an embedding.
#[derive(Debug)]
pub(super) struct Decoder {
    network: Network,
    side: usize,
    channels: usize,
    cells: usize,
}

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

/// What a point told to the network is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PointKind {
    Exclude,
    Include,
    FirstCorner,
    LastCorner,
    /// Stands where there is no box.
    Padding,
}

/// A mask and how good the network thinks it is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Answer {
    /// Row by row, [`Decoder::fine`] along each side; above 0 = inside.
    pub logits: Vec<f32>,
    /// Predicted IoU.
    pub score: f32,
}

impl Question {
    /// Notes one more point.
    pub fn tell(&mut self, at: [f32; 2], kind: PointKind) {
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
}

impl Decoder {
    /// `None` where it does not take what an encoder of that side gives.
    pub fn new(network: Network, side: usize) -> Result<Option<Self>, NnError> {
        let port = network.signature().inputs.iter().find(|port| port.name == "image_embeddings");
        let sizes = port.map(|port| port.shape.as_slice());
        let Some([_, Some(channels), Some(rows), Some(columns)]) = sizes else {
            let what = "expected the input `image_embeddings` f32 [1, channels, cells, cells]".to_owned();
            return Err(NnError::Mismatch { path: network.path().to_owned(), what });
        };
        let (channels, cells) = (*channels, *rows);
        let fits = rows == columns && cells * CELL == side;
        Ok(fits.then_some(Self { network, side, channels, cells }))
    }

    /// Pixels along each side of the encoder's square.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Channels and cells along each side of an embedding.
    pub fn embedding(&self) -> (usize, usize) {
        (self.channels, self.cells)
    }

    /// Logits along each side of a mask, padding included.
    pub fn fine(&self) -> usize {
        self.cells * FINE
    }

    /// The masks that a question may mean: first the one for clear questions, then those for ambiguous ones, where the
    /// network gives them all. `before` are logits of an earlier answer that is to be refined.
    pub fn run(&self, embedding: &Tensor, asked: &Question, before: Option<&[f32]>) -> Result<Vec<Answer>, MaskError> {
        let (count, fine) = (asked.points.len(), self.fine());
        let floats = |shape: &[usize], values: Vec<f32>| Tensor::floats(shape, values).map_err(told);
        let points = floats(&[1, count, 2], asked.points.as_flattened().to_vec())?;
        let kinds = floats(&[1, count], asked.kinds.iter().map(|kind| kind.number()).collect())?;
        let mask = floats(&[1, 1, fine, fine], before.map_or_else(|| vec![0.0; fine * fine], <[f32]>::to_vec))?;
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
        let given = self.network.run(&fed).map_err(told)?;
        self.answers(&given)
    }

    fn answers(&self, given: &[Tensor]) -> Result<Vec<Answer>, MaskError> {
        let ports = &self.network.signature().outputs;
        let named = |name: &str| ports.iter().position(|port| port.name == name).and_then(|at| given.get(at));
        let fine = self.fine();
        let all = named("low_res_masks").zip(named("iou_predictions")).and_then(|(masks, scores)| {
            let count = scores.as_floats().len();
            let fits = masks.shape() == [1, count, fine, fine] && (count == 1 || count == 4);
            fits.then(|| masks.as_floats().chunks_exact(fine * fine).zip(scores.as_floats()))
        });
        let path = self.network.path().display();
        let unfit = || MaskError::Network(format!("{path}: gives no masks of {fine}×{fine} with their scores"));
        let answer = |(logits, &score): (&[f32], &f32)| Answer { logits: logits.to_vec(), score };
        Ok(all.ok_or_else(unfit)?.map(answer).collect())
    }
}
