//! Prompts to an embedded image, with exclude clicks for networks that do not support them.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::decoder::{
    CandidateMasks, Decoder, DecoderPrompt, EmbeddingShape, MaskPrediction, PointKind,
};
use super::embedding::{Embedding, EmbeddingMap};
use super::mask_logits::enlarged;
use super::part::{Canvas, ImagePart};
use crate::answer_size::sized;
use crate::{AnswerSize, Click, MaskError, PxBox, Region};
use ostra_compute::nn::{Dialect, Tensor};

/// An image, or a part of one, that answers prompts with runs of the decoder alone.
#[derive(Debug)]
pub struct SamFrame {
    decoder: Arc<Decoder>,
    embedding: Vec<Tensor>,
    width: u32,
    height: u32,
    part: ImagePart,
    /// Cache of the latest answers.
    ///
    /// A new click adds one prompt to those already answered; moving the pointer repeats the last
    /// one.
    known: Mutex<VecDeque<(AnswerKey, Arc<MaskPrediction>)>>,
}

/// A prompt and the answer that it refines.
///
/// The earlier answer is kept alive, so that its address stays unique.
#[derive(Debug)]
struct AnswerKey {
    prompt: DecoderPrompt,
    before: Option<Arc<MaskPrediction>>,
    size: AnswerSize,
}

/// Maximum number of cached answers.
const KNOWN: usize = 48;

impl SamFrame {
    pub(super) fn new(decoder: Arc<Decoder>, embedding: &Embedding) -> Result<Self, MaskError> {
        let shape = |map: &EmbeddingMap| EmbeddingShape {
            channels: map.channels,
            cells: map.cells,
        };
        if !embedding
            .maps
            .iter()
            .map(shape)
            .eq(decoder.maps().iter().copied())
        {
            let shapes: Vec<String> = embedding
                .maps
                .iter()
                .map(|map| format!("{0}×{1}×{1}", map.channels, map.cells))
                .collect();
            let what = format!(
                "an embedding of {} is not of this network; make it again",
                shapes.join(" and ")
            );
            return Err(MaskError::Network(what));
        }
        let tensor = |map: &EmbeddingMap| {
            let shape = [1, map.channels, map.cells, map.cells];
            Tensor::floats(&shape, map.values.clone()).map_err(MaskError::from)
        };
        let maps = embedding.maps.iter().map(tensor);
        Ok(Self {
            decoder,
            embedding: maps.collect::<Result<_, _>>()?,
            width: embedding.width,
            height: embedding.height,
            part: embedding.part,
            known: Mutex::default(),
        })
    }

    /// Returns the number of bytes held.
    pub(super) fn held_bytes(&self) -> usize {
        bytes_of(&self.decoder)
    }

    /// Returns columns and rows of the image.
    pub(super) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Returns the part of the image that the network saw.
    #[must_use]
    pub fn part(&self) -> ImagePart {
        self.part
    }

    /// Returns the square on which the network sees the part.
    pub(super) fn canvas(&self) -> Canvas {
        self.decoder.canvas()
    }

    /// Returns the number of logits along each side of an answer.
    pub(super) fn fine(&self) -> usize {
        self.decoder.fine()
    }

    /// Returns the answer for one object.
    ///
    /// A single click is ambiguous, so the one of its three masks with the highest predicted IoU is
    /// taken. For more prompts, the mask for clear prompts is taken, if the network gives one.
    /// `size` chooses another one of the masks.
    pub(super) fn ask(
        &self,
        clicks: &[Click],
        within: Option<&PxBox>,
        before: Option<&Arc<MaskPrediction>>,
        size: AnswerSize,
    ) -> Result<Arc<MaskPrediction>, MaskError> {
        let prompt = self.decoder_prompt(clicks, within);
        let is_same = |key: &AnswerKey| {
            let same_before = match (&key.before, before) {
                (Some(a), Some(b)) => Arc::ptr_eq(a, b),
                (a, b) => a.is_none() && b.is_none(),
            };
            same_before && key.prompt == prompt && key.size == size
        };
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, answer)) = known.iter().find(|(key, _)| is_same(key)) {
            return Ok(Arc::clone(answer));
        }
        drop(known);
        let answer = Arc::new(match self.decoder.dialect() {
            Dialect::EfficientSam => {
                self.ask_include_only(clicks, within, before.map(|before| &**before), size)?
            }
            _ => {
                let is_ambiguous = clicks.len() == 1 && within.is_none() && before.is_none();
                let logits = before.map(|answer| answer.logits.as_slice());
                chosen(
                    self.decoder.run(&self.embedding, &prompt, logits)?,
                    is_ambiguous,
                    size,
                )?
            }
        });
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.push_back((
            AnswerKey {
                prompt,
                before: before.cloned(),
                size,
            },
            Arc::clone(&answer),
        ));
        if known.len() > KNOWN {
            known.pop_front();
        }
        Ok(answer)
    }

    /// Returns all candidate masks for a click with the network's scores; they are not cached.
    pub(super) fn masks_at(&self, click: Click) -> Result<Vec<MaskPrediction>, MaskError> {
        let CandidateMasks { clear, others } = self.masks(&[click], None)?;
        Ok(if others.is_empty() {
            clear.into_iter().collect()
        } else {
            others
        })
    }

    /// Returns all candidate masks for clicks and a box.
    pub(super) fn masks(
        &self,
        clicks: &[Click],
        within: Option<&PxBox>,
    ) -> Result<CandidateMasks, MaskError> {
        self.decoder
            .run(&self.embedding, &self.decoder_prompt(clicks, within), None)
    }

    fn decoder_prompt(&self, clicks: &[Click], within: Option<&PxBox>) -> DecoderPrompt {
        let (part, canvas) = (self.part, self.canvas());
        let mut prompt = DecoderPrompt::default();
        for click in clicks {
            let kind = if click.include {
                PointKind::Include
            } else {
                PointKind::Exclude
            };
            prompt.add(part.canvas_point(click.at_px, canvas), kind);
        }
        if let Some(within) = within {
            let [first, last] = part.canvas_corners(within, canvas);
            prompt.add(first, PointKind::FirstCorner);
            prompt.add(last, PointKind::LastCorner);
        } else {
            prompt.add([0.0; 2], PointKind::Padding);
        }
        prompt
    }

    /// Returns the logit of an answer under a click.
    pub(super) fn logit_at(&self, answer: &MaskPrediction, click: &Click) -> f32 {
        let (fine, canvas) = (self.fine(), self.canvas());
        let cell =
            |at: f32| (((at + 0.5) * fine as f32 / canvas.side as f32) as usize).min(fine - 1);
        let [x, y] = self.part.canvas_point(click.at_px, canvas).map(cell);
        answer.logits[y * fine + x]
    }

    /// Returns the logits of an answer at the size of the part, row by row.
    pub(super) fn enlarged(&self, answer: &MaskPrediction) -> Vec<f32> {
        enlarged(&answer.logits, self.fine(), self.part, self.canvas())
    }

    /// Returns the pixels inside an answer.
    pub(super) fn region(&self, answer: &MaskPrediction) -> Region {
        let mut region = Region::empty(self.width, self.height);
        let columns = self.part.width as usize;
        let rows = region
            .inside
            .chunks_exact_mut(self.width as usize)
            .skip(self.part.y as usize);
        for (row, logits) in rows.zip(self.enlarged(answer).chunks_exact(columns)) {
            let row = &mut row[self.part.x as usize..][..columns];
            row.iter_mut()
                .zip(logits)
                .for_each(|(inside, &logit)| *inside = logit > 0.0);
        }
        region
    }
}

/// Returns the number of bytes that a frame of this decoder holds.
pub(super) fn bytes_of(decoder: &Decoder) -> usize {
    let values = |map: &EmbeddingShape| map.channels * map.cells * map.cells;
    let maps: usize = decoder.maps().iter().map(values).sum();
    (maps + KNOWN * decoder.fine() * decoder.fine()) * size_of::<f32>()
}

/// Returns the mask for a clear prompt, or the best one for an ambiguous prompt.
///
/// If the network gives only one kind, that kind is used. For another size than the automatic one,
/// masks of both kinds count.
fn chosen(
    CandidateMasks { clear, mut others }: CandidateMasks,
    is_ambiguous: bool,
    size: AnswerSize,
) -> Result<MaskPrediction, MaskError> {
    // Stable sort: the first of equal scores is taken.
    others.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut all = others;
    let at = if is_ambiguous { all.len() } else { 0 };
    all.splice(at..at, clear);
    // Masks are in the order of preference.
    of_size(all, size, |left| left.first().copied())
}

/// Returns the mask of a size; the first one is that of the automatic size.
fn of_size(
    mut masks: Vec<MaskPrediction>,
    size: AnswerSize,
    best: impl Fn(&[usize]) -> Option<usize>,
) -> Result<MaskPrediction, MaskError> {
    if masks.is_empty() {
        return Err(MaskError::Network("the network gives no mask".into()));
    }
    let area = |mask: &MaskPrediction| mask.logits.iter().filter(|&&logit| logit > 0.0).count();
    let areas: Vec<f32> = masks.iter().map(|mask| area(mask) as f32).collect();
    let at = sized(&areas, 0, size, best);
    Ok(masks.swap_remove(at))
}

impl SamFrame {
    /// Returns the mask for clicks and a box from a network without exclude clicks.
    ///
    /// The network's mask that satisfies the clicks best is taken. If it still covers an exclude
    /// click, the mask that a click there would find is subtracted. If `before` was given from
    /// outside and contains all include clicks, it is taken instead of the network's masks.
    pub(super) fn ask_include_only(
        &self,
        clicks: &[Click],
        within: Option<&PxBox>,
        before: Option<&MaskPrediction>,
        size: AnswerSize,
    ) -> Result<MaskPrediction, MaskError> {
        let holds_all = |answer: &&MaskPrediction| {
            self.matched_clicks(answer, clicks, true) == includes(clicks).count()
        };
        let found = match before.filter(|before| before.is_given).filter(holds_all) {
            Some(before) => vec![before.clone()],
            None => self.masks(clicks, within)?.others,
        };
        let found = self.by_match(found, clicks);
        let mut answer = of_size(found, size, |left| left.first().copied())?;
        for click in clicks.iter().filter(|click| !click.include) {
            if self.logit_at(&answer, click) > 0.0
                && let Some(other) = self.excluded(click, clicks, &answer)?
            {
                let logits = answer.logits.iter_mut().zip(&other.logits);
                logits.for_each(|(logit, other)| *logit = logit.min(-other));
            }
        }
        Ok(answer)
    }

    /// Returns the masks by the number of satisfied include clicks, most first.
    ///
    /// Ties are broken by the number of satisfied exclude clicks, then by score.
    fn by_match(&self, found: Vec<MaskPrediction>, clicks: &[Click]) -> Vec<MaskPrediction> {
        let mut ranked: Vec<([usize; 2], MaskPrediction)> = found
            .into_iter()
            .map(|answer| {
                (
                    [true, false].map(|kind| self.matched_clicks(&answer, clicks, kind)),
                    answer,
                )
            })
            .collect();
        ranked.sort_by(|a, b| b.0.cmp(&a.0).then(b.1.score.total_cmp(&a.1.score)));
        ranked.into_iter().map(|(_, answer)| answer).collect()
    }

    /// Returns how many clicks of a kind an answer satisfies.
    fn matched_clicks(&self, answer: &MaskPrediction, clicks: &[Click], include: bool) -> usize {
        let of_kind = clicks.iter().filter(|click| click.include == include);
        of_kind
            .filter(|click| (self.logit_at(answer, click) > 0.0) == include)
            .count()
    }

    /// Returns the mask at an exclude click that may be subtracted.
    ///
    /// It contains no include click and covers no more than half of the answer.
    fn excluded(
        &self,
        at: &Click,
        clicks: &[Click],
        answer: &MaskPrediction,
    ) -> Result<Option<MaskPrediction>, MaskError> {
        let at = Click {
            include: true,
            ..*at
        };
        let mut found = self.masks_at(at)?;
        found.retain(|other| {
            let is_in = |click: &Click| self.logit_at(other, click) > 0.0;
            let inside = answer
                .logits
                .iter()
                .zip(&other.logits)
                .filter(|(answer, _)| **answer > 0.0);
            let taken = inside.clone().filter(|(_, other)| **other > 0.0).count();
            is_in(&at) && !includes(clicks).any(is_in) && 2 * taken <= inside.count()
        });
        Ok(self.by_match(found, &[at]).into_iter().next())
    }
}

fn includes(clicks: &[Click]) -> impl Iterator<Item = &Click> {
    clicks.iter().filter(|click| click.include)
}
