use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::canvas::Canvas;
use super::decoder::{Answer, Answers, Decoder, Dialect, PointKind, Question};
use super::embedding::Embedding;
use super::enlarge::enlarged;
use super::everything::EverythingOptions;
use super::network::told;
use super::objects::Objects;
use super::part::Part;
use crate::{Click, MaskError, PreparedFrame, Prompt, Proposal, PxBox, Region, SegmentRequest};
use ostra_compute::nn::Tensor;
use ostra_core::job::Progress;

/// A picture, or a part of one, that answers prompts by runs of the decoder alone.
#[derive(Debug)]
pub struct SamFrame {
    decoder: Arc<Decoder>,
    embedding: Tensor,
    width: u32,
    height: u32,
    part: Part,
    /// The latest answers: a click more asks one question more, moving the pointer asks the last one anew.
    known: Mutex<VecDeque<(Asked, Arc<Answer>)>>,
}

/// What was asked, refining which answer. That answer is kept as long as this is, so that its address is its own.
#[derive(Debug)]
struct Asked {
    question: Question,
    before: Option<Arc<Answer>>,
}

/// Answers kept.
const KNOWN: usize = 48;

impl SamFrame {
    pub(super) fn new(decoder: Arc<Decoder>, embedding: &Embedding) -> Result<Self, MaskError> {
        let Embedding {
            width,
            height,
            part,
            channels,
            cells,
            ..
        } = *embedding;
        if decoder.embedding() != (channels, cells) {
            let what = format!(
                "an embedding of {channels}×{cells}×{cells} is not of this network; make it anew"
            );
            return Err(MaskError::Network(what));
        }
        let tensor =
            Tensor::floats(&[1, channels, cells, cells], embedding.values.clone()).map_err(told)?;
        Ok(Self {
            decoder,
            embedding: tensor,
            width,
            height,
            part,
            known: Mutex::default(),
        })
    }

    /// Columns and rows of the picture.
    pub(super) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The part of the picture that the network saw.
    #[must_use]
    pub fn part(&self) -> Part {
        self.part
    }

    /// The square that the network sees the part on.
    pub(super) fn canvas(&self) -> Canvas {
        self.decoder.canvas()
    }

    /// Logits along each side of an answer.
    pub(super) fn fine(&self) -> usize {
        self.decoder.fine()
    }

    /// The answer for one object. A single click is ambiguous: of its three masks the one with the highest predicted
    /// IoU is taken, of more prompts the one mask made for them, where the network makes one.
    pub(super) fn ask(
        &self,
        clicks: &[Click],
        within: Option<&PxBox>,
        before: Option<&Arc<Answer>>,
    ) -> Result<Arc<Answer>, MaskError> {
        let question = self.question(clicks, within);
        let is_same = |asked: &Asked| {
            let same_before = match (&asked.before, before) {
                (Some(a), Some(b)) => Arc::ptr_eq(a, b),
                (a, b) => a.is_none() && b.is_none(),
            };
            same_before && asked.question == question
        };
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, answer)) = known.iter().find(|(asked, _)| is_same(asked)) {
            return Ok(Arc::clone(answer));
        }
        drop(known);
        let answer = Arc::new(match self.decoder.dialect() {
            Dialect::Sam => {
                let is_ambiguous = clicks.len() == 1 && within.is_none() && before.is_none();
                let logits = before.map(|answer| answer.logits.as_slice());
                chosen(
                    self.decoder.run(&self.embedding, &question, logits)?,
                    is_ambiguous,
                )?
            }
            Dialect::Efficient => self.heed(clicks, within, before.map(|before| &**before))?,
        });
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.push_back((
            Asked {
                question,
                before: before.cloned(),
            },
            Arc::clone(&answer),
        ));
        if known.len() > KNOWN {
            known.pop_front();
        }
        Ok(answer)
    }

    /// All masks that a click may mean, with the network's scores; nothing of it is kept.
    pub(super) fn masks_at(&self, click: Click) -> Result<Vec<Answer>, MaskError> {
        let Answers { clear, others } = self.masks(&[click], None)?;
        Ok(if others.is_empty() {
            clear.into_iter().collect()
        } else {
            others
        })
    }

    /// All masks that clicks and a box may mean.
    pub(super) fn masks(
        &self,
        clicks: &[Click],
        within: Option<&PxBox>,
    ) -> Result<Answers, MaskError> {
        self.decoder
            .run(&self.embedding, &self.question(clicks, within), None)
    }

    fn question(&self, clicks: &[Click], within: Option<&PxBox>) -> Question {
        let (part, canvas) = (self.part, self.canvas());
        let mut question = Question::default();
        for click in clicks {
            let kind = if click.include {
                PointKind::Include
            } else {
                PointKind::Exclude
            };
            question.tell(part.told_click(click.at_px, canvas), kind);
        }
        if let Some(within) = within {
            let [first, last] = part.told_box(within, canvas);
            question.tell(first, PointKind::FirstCorner);
            question.tell(last, PointKind::LastCorner);
        } else {
            question.tell([0.0; 2], PointKind::Padding);
        }
        question
    }

    /// Logit of an answer under a click.
    pub(super) fn logit_at(&self, answer: &Answer, click: &Click) -> f32 {
        let (fine, canvas) = (self.fine(), self.canvas());
        let cell =
            |at: f32| (((at + 0.5) * fine as f32 / canvas.side as f32) as usize).min(fine - 1);
        let [x, y] = self.part.told_click(click.at_px, canvas).map(cell);
        answer.logits[y * fine + x]
    }

    /// Logits of an answer at the size of the part, row by row.
    pub(super) fn enlarged(&self, answer: &Answer) -> Vec<f32> {
        enlarged(&answer.logits, self.fine(), self.part, self.canvas())
    }

    /// The pixels inside an answer.
    pub(super) fn region(&self, answer: &Answer) -> Region {
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

    fn check(&self, request: &SegmentRequest<'_>) -> Result<(), MaskError> {
        let Part {
            x,
            y,
            width,
            height,
        } = self.part;
        let shown = format!("the {width}×{height} pixels from {x}, {y} that are looked at");
        let prompt = request.prompt;
        if prompt.is_empty() {
            return Err(MaskError::Request(
                "there is no click and no box; click on the object first".into(),
            ));
        }
        if let Some(click) = prompt
            .clicks
            .iter()
            .find(|click| !self.part.holds(click.at_px))
        {
            let at = click.at_px;
            return Err(MaskError::Request(format!(
                "the click at {}, {} lies outside {shown}",
                at.x, at.y
            )));
        }
        let (first, last) = (
            glam::DVec2::new(x.into(), y.into()),
            glam::DVec2::new(width.into(), height.into()),
        );
        let crosses = |part: &PxBox| {
            let common = part.max_px.min(first + last) - part.min_px.max(first);
            common.min_element() > 0.0
        };
        if let Some(part) = prompt.boxes.iter().find(|part| !crosses(part)) {
            let (a, b) = (part.min_px, part.max_px);
            let text = format!(
                "the box from {}, {} to {}, {} holds no pixel of {shown}",
                a.x, a.y, b.x, b.y
            );
            return Err(MaskError::Request(text));
        }
        let fits = |region: &Region| (region.width, region.height) == (self.width, self.height);
        if [request.previous, request.taken]
            .into_iter()
            .flatten()
            .all(fits)
        {
            return Ok(());
        }
        let (width, height) = self.size();
        Err(MaskError::Request(format!(
            "a mask given does not have the picture's size of {width}×{height}"
        )))
    }

    /// The object's pixels before other labels are looked at.
    fn found(
        &self,
        prompt: &Prompt,
        previous: Option<&Region>,
        taken: Option<&Region>,
    ) -> Result<Region, MaskError> {
        let (Some(previous), Some((last, earlier))) = (previous, prompt.clicks.split_last()) else {
            return Ok(Objects::of(self, &prompt.boxes, &prompt.clicks)?.region());
        };
        let mut objects = Objects::of(self, &prompt.boxes, earlier)?;
        if !objects.agree_with(previous, taken) {
            objects = Objects::of_region(self, previous, earlier);
        }
        objects.add(last)?;
        Ok(objects.region())
    }
}

impl PreparedFrame for SamFrame {
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        _progress: &Progress,
    ) -> Result<Region, MaskError> {
        self.check(request)?;
        let SegmentRequest {
            prompt,
            previous,
            taken,
        } = *request;
        let mut region = self.found(prompt, previous, taken)?;
        prompt
            .clicks
            .iter()
            .for_each(|click| hold(&mut region, click));
        if let Some(taken) = taken {
            region.subtract(taken);
        }
        Ok(region)
    }

    fn proposals(&self, progress: &Progress) -> Result<Option<Vec<Proposal>>, MaskError> {
        self.everything(&EverythingOptions::default(), progress)
            .map(Some)
    }

    fn bytes(&self) -> usize {
        bytes_of(&self.decoder)
    }
}

/// Bytes that a frame of this decoder holds.
pub(super) fn bytes_of(decoder: &Decoder) -> usize {
    let (channels, cells) = decoder.embedding();
    (channels * cells * cells + KNOWN * decoder.fine() * decoder.fine()) * size_of::<f32>()
}

/// The mask for a clear question, or the surest of those for an ambiguous one; a network that gives one chose.
fn chosen(Answers { clear, mut others }: Answers, is_ambiguous: bool) -> Result<Answer, MaskError> {
    // Stable: of equal scores the first is taken.
    others.sort_by(|a, b| b.score.total_cmp(&a.score));
    let surest = others.into_iter().next();
    let answer = if is_ambiguous {
        surest.or(clear)
    } else {
        clear.or(surest)
    };
    answer.ok_or_else(|| MaskError::Network("the network gives no mask".into()))
}

/// What was clicked is as the click says, whatever the network thinks: the pixel and those that touch it.
pub(super) fn hold(region: &mut Region, click: &Click) {
    let (x, y) = (click.at_px.x as u32, click.at_px.y as u32);
    for y in y.saturating_sub(1)..=(y + 1).min(region.height - 1) {
        for x in x.saturating_sub(1)..=(x + 1).min(region.width - 1) {
            region.inside[y as usize * region.width as usize + x as usize] = click.include;
        }
    }
}
