//! The meaning of a prompt on a frame.
//!
//! It consists of the mask that the prompt refines, the queries of the segmenter, and the pixels
//! that the answer may take. Window, command line, preview and simulated users all use
//! [`PromptMeaning`], so that they agree.

use anyhow::{Context, Result, ensure};
use glam::DVec2;

use crate::mask_edits::{by_hand, keyframe, label_name, mask_of};
use crate::{Edit, FrameMask, Project, PromptRequest};
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{
    AnswerSize, AnswerSource, Click, LabelAnswer, LabelId, LabelMask, LabelTree, PreparedFrame,
    Prompt, PxBox, Region, SegmentRequest, compose, erase, landmarks, obey, taken_by_others,
};

/// The meaning of a prompt on a frame, given the frame's mask, prompts and labels.
#[derive(Debug, Clone)]
pub struct PromptMeaning {
    frame: usize,
    label: LabelId,
    /// The prompt as the project stores it.
    prompt: Prompt,
    /// The mask that the answer is composed into.
    mask: LabelMask,
    /// The pixels that the first query refines.
    previous: Option<Region>,
    /// Questions in order. Each refines the answer to the one before, and the last answer counts.
    queries: Vec<SegmentQuery>,
    /// Pixels of a mask that was not built from prompts, outside the boxes added to it.
    kept: Option<Region>,
    /// Labels whose pixels the answer may take.
    yielding: Vec<LabelId>,
    of: PromptInputs,
}

/// One request to the segmenter.
#[derive(Debug, Clone)]
struct SegmentQuery {
    prompt: Prompt,
    /// Pixels that the answer may not take.
    taken: Option<Region>,
}

/// The state that a meaning depends on, apart from the prompt itself.
#[derive(Debug, Clone, PartialEq)]
struct PromptInputs {
    mask: Option<FrameMask>,
    prompts: Vec<(LabelId, Prompt)>,
    labels: LabelTree,
}

impl PromptInputs {
    fn of(project: &Project, frame: usize) -> Self {
        let range = (frame, LabelId(0))..=(frame, LabelId(u16::MAX));
        let prompts = project.prompts.range(range);
        Self {
            mask: project.masks.get(&frame).cloned(),
            prompts: prompts
                .map(|(&(_, label), prompt)| (label, prompt.clone()))
                .collect(),
            labels: project.labels.clone(),
        }
    }
}

impl PromptMeaning {
    /// Interprets a prompt for the current project.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such frame.
    pub fn new(project: &Project, request: &PromptRequest) -> Result<Self> {
        let mask = mask_of(project, request.frame)?;
        let before = project.prompts.get(&(request.frame, request.label));
        let corrects = corrects(before, &mask, request);
        let mut asked = request.clone();
        let (known_clicks, known_boxes) =
            before.map_or((0, 0), |before| (before.clicks.len(), before.boxes.len()));
        let adds_boxes = corrects && request.prompt.boxes.len() > known_boxes;
        let mut kept = None;
        if adds_boxes {
            asked.prompt.boxes.drain(..known_boxes);
            asked.prompt.clicks.drain(..known_clicks);
            kept = outside(&mask.region(request.label), &asked.prompt.boxes);
        }
        let previous = (!adds_boxes && refines(before, corrects, &request.prompt))
            .then(|| mask.region(request.label))
            .filter(|region| region.area() > 0);
        let clicks = asked.prompt.clicks.len();
        let first = if corrects && !adds_boxes {
            // If a mask gets several new clicks, each click is answered separately.
            clicks.min(1 + known_clicks)
        } else {
            clicks
        };
        let queries = (first..=clicks).map(|count| {
            let mut request = asked.clone();
            request.prompt.clicks.truncate(count);
            if count < clicks {
                request.prompt.size = AnswerSize::Automatic;
            }
            SegmentQuery {
                taken: taken(project, &mask, &request),
                prompt: Prompt {
                    corrects,
                    ..against_rivals(project, &mask, &request)
                },
            }
        });
        Ok(Self {
            frame: request.frame,
            label: request.label,
            prompt: Prompt {
                corrects,
                ..request.prompt.clone()
            },
            previous,
            queries: queries.collect(),
            kept,
            yielding: giving_way(project, &mask, request),
            of: PromptInputs::of(project, request.frame),
            mask,
        })
    }

    /// Returns whether the prompt still has this meaning for the project.
    #[must_use]
    pub fn is_of(&self, project: &Project) -> bool {
        self.of == PromptInputs::of(project, self.frame)
    }

    /// Segments the pixels that the prompt asks for, given everything else on the frame.
    ///
    /// The answer obeys the last click, whatever the segmenter predicts. `image` is the frame's.
    ///
    /// # Errors
    ///
    /// Returns an error if the segmenter fails or is stopped, or the image has another size.
    pub fn segment(
        &self,
        ready: &dyn PreparedFrame,
        image: &Image,
        progress: &Progress,
    ) -> Result<Region> {
        let (answer, _) = self.segment_with_source(ready, image, progress)?;
        Ok(answer)
    }

    /// Segments as [`Self::segment`], and returns which segmenter answered the last click or box if
    /// the frame chose among several.
    ///
    /// # Errors
    ///
    /// As [`Self::segment`].
    pub fn segment_with_source(
        &self,
        ready: &dyn PreparedFrame,
        image: &Image,
        progress: &Progress,
    ) -> Result<(Region, Option<AnswerSource>)> {
        let (mut answer, mut source) = (None, None);
        for query in &self.queries {
            let request = SegmentRequest {
                prompt: &query.prompt,
                previous: answer.as_ref().or(self.previous.as_ref()),
                taken: query.taken.as_ref(),
            };
            source = ready.source(&request);
            answer = Some(ready.segment(&request, progress)?);
        }
        let mut answer = answer.context("the prompt is empty; add a click or a box")?;
        ensure!(
            (answer.width, answer.height) == (image.width, image.height),
            "the answer of the segmenter does not have the image's size"
        );
        if let Some(kept) = &self.kept {
            answer.unite(kept);
        }
        let taken = self.queries.last().and_then(|query| query.taken.as_ref());
        obey(&mut answer, &self.prompt.clicks, taken, image);
        Ok((answer, source))
    }

    /// Returns whether pixels outside new boxes are kept, because they were not made by prompts.
    #[must_use]
    pub fn keeps_outside(&self) -> bool {
        self.kept.is_some()
    }

    /// Returns the size of the answer.
    #[must_use]
    pub fn size(&self) -> AnswerSize {
        self.prompt.size
    }

    /// Returns the frame's mask with an answer composed into it.
    ///
    /// # Errors
    ///
    /// Returns an error if the size of the answer differs from that of the frame.
    pub fn compose(&self, project: &Project, region: &Region) -> Result<LabelMask> {
        let mut mask = self.mask.clone();
        let answer = LabelAnswer {
            region,
            label: self.label,
            prompt: &self.prompt,
            replaceable: &self.yielding,
        };
        compose(&mut mask, &answer, &project.labels)?;
        Ok(mask)
    }

    /// Returns the edits that store the prompt and compose an answer into the frame's mask.
    ///
    /// # Errors
    ///
    /// Returns an error if the size of the answer differs from that of the frame.
    pub fn edits(&self, project: &Project, region: &Region) -> Result<Vec<Edit>> {
        let mask = self.compose(project, region)?;
        let mut edits = vec![Edit::SetPrompt {
            frame: self.frame,
            label: self.label,
            prompt: Some(self.prompt.clone()),
        }];
        edits.extend(by_hand(project, self.frame, &mask));
        Ok(edits)
    }

    /// Returns why an answer changes no pixel of the frame's mask, or `None` if it changes some.
    ///
    /// `edits` are those of the answer.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such label.
    pub fn why_unchanged(&self, project: &Project, edits: &[Edit]) -> Result<Option<String>> {
        let is_change = |edit: &Edit| match edit {
            Edit::SetMask {
                mask: Some(mask), ..
            } => mask.runs.decode() != self.mask,
            _ => false,
        };
        if edits.iter().any(is_change) {
            return Ok(None);
        }
        let newest = self.prompt.clicks.last().copied();
        let clicked = newest.and_then(|click| {
            let at = click.pixel_in(self.mask.width, self.mask.height)?;
            Some((click.include, self.mask.ids[at]))
        });
        let Some((include, there)) = clicked else {
            return Ok(Some(
                "The box changed nothing; draw it around what is missing".to_owned(),
            ));
        };
        let why = self.why_ineffective(project, include, there)?;
        Ok(Some(format!("The click changed nothing: {why}")))
    }

    /// Returns why a click on a pixel of label `there` has no effect, and what to do.
    fn why_ineffective(&self, project: &Project, include: bool, there: LabelId) -> Result<String> {
        let own = label_name(project, self.label)?;
        let is_part = project.labels.descendants(self.label).contains(&there);
        if there != LabelId::NONE && project.locked_on(self.frame).contains(&there) {
            let other = label_name(project, there)?;
            return Ok(format!(
                "'{other}' is locked on frame {}; unlock it there first",
                self.frame
            ));
        }
        if is_part {
            let part = label_name(project, there)?;
            return Ok(format!(
                "this place belongs to '{part}', a part of '{own}'; select that label"
            ));
        }
        Ok(match (include, there == self.label) {
            (true, true) => format!(
                "'{own}' is here already; click where it is missing, or make the frame a keyframe to confirm its mask"
            ),
            (false, false) => {
                format!("'{own}' is not here; exclude a place that it covers by mistake")
            }
            _ => "try another place, or the brush".to_owned(),
        })
    }
}

/// Returns the edits that remove a label from a frame.
///
/// A frame without any remaining label is no longer a keyframe.
///
/// # Errors
///
/// Returns an error if the frame or label is missing, or the label is not on the frame.
pub fn without_label(project: &Project, frame: usize, label: LabelId) -> Result<Vec<Edit>> {
    let mut mask = mask_of(project, frame)?;
    let everywhere = Region {
        inside: vec![true; mask.ids.len()],
        width: mask.width,
        height: mask.height,
    };
    let taken = erase(&mut mask, &everywhere, Some(label))?;
    let name = label_name(project, label)?;
    let given = project.prompts.contains_key(&(frame, label));
    ensure!(given || taken > 0, "label '{name}' is not on frame {frame}");
    let mut edits = vec![Edit::SetPrompt {
        frame,
        label,
        prompt: None,
    }];
    if taken > 0 {
        let others = project
            .prompts
            .keys()
            .any(|&(of, other)| of == frame && other != label);
        let left = others || mask.ids.iter().any(|&id| id != LabelId::NONE);
        edits.push(Edit::SetMask {
            frame,
            mask: left.then(|| keyframe(&mask)),
        });
    }
    Ok(edits)
}

/// Returns whether the answer refines the label's current mask.
///
/// This holds if the new prompt is the former one plus one click, or the first click on a tracked
/// mask. A mask that is being corrected may get several clicks more. Clicking faster than answers
/// arrive then does not lose the mask under the clicks.
fn refines(before: Option<&Prompt>, corrects: bool, prompt: &Prompt) -> bool {
    let nothing = Prompt::default();
    let before = before.unwrap_or(&nothing);
    let goes_on = prompt.boxes == before.boxes && prompt.clicks.starts_with(&before.clicks);
    goes_on && (prompt.clicks.len() == before.clicks.len() + 1 || corrects)
}

/// Returns whether the prompt corrects a mask that the label had on the frame before it.
///
/// Boxes may be added to such a mask as well as clicks.
fn corrects(before: Option<&Prompt>, mask: &LabelMask, request: &PromptRequest) -> bool {
    let Prompt { clicks, boxes, .. } = &request.prompt;
    match before {
        Some(before) => {
            before.corrects
                && boxes.starts_with(&before.boxes)
                && clicks.starts_with(&before.clicks)
        }
        None => mask.ids.contains(&request.label),
    }
}

/// Returns the pixels of a region outside all boxes, or `None` if there are none.
fn outside(region: &Region, boxes: &[PxBox]) -> Option<Region> {
    let mut region = region.clone();
    let width = region.width as usize;
    for (at, inside) in region.inside.iter_mut().enumerate() {
        let centre = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        *inside &= !boxes
            .iter()
            .any(|px_box| centre.cmpge(px_box.min_px).all() && centre.cmple(px_box.max_px).all());
    }
    (!region.is_empty()).then_some(region)
}

/// Returns the label's prompt with excluding clicks where other labels of the frame were clicked.
///
/// Ancestors and descendants of the label are not excluded. For a mask without clicks, the deepest
/// points of its parts stand in.
fn against_rivals(project: &Project, mask: &LabelMask, request: &PromptRequest) -> Prompt {
    let mut prompt = request.prompt.clone();
    let Some(newest) = prompt.clicks.last().map(|click| click.at_px) else {
        return prompt;
    };
    let kin = [
        project.labels.path(request.label),
        project.labels.descendants(request.label),
    ]
    .concat();
    let prompted = |id: LabelId| project.prompts.get(&(request.frame, id));
    let stand_ins = |id: LabelId, include: bool| -> Vec<Click> {
        let points = landmarks(&mask.region(id), STAND_INS);
        let away = points
            .into_iter()
            .filter(|point| point.distance(newest) > STAND_IN_AWAY_PX);
        away.map(|at_px| Click { at_px, include }).collect()
    };
    let mut given = Vec::new();
    for id in project
        .labels
        .iter()
        .map(|label| label.id)
        .filter(|id| !kin.contains(id))
    {
        match prompted(id) {
            Some(rival) => {
                let includes = rival.clicks.iter().filter(|click| click.include);
                given.extend(includes.map(|click| Click {
                    include: false,
                    ..*click
                }));
            }
            None => given.extend(stand_ins(id, false)),
        }
    }
    if prompted(request.label).is_none() {
        given.extend(stand_ins(request.label, true));
    }
    prompt.clicks.splice(0..0, given);
    prompt
}

/// Maximum number of parts of a mask without clicks that get a stand-in.
const STAND_INS: usize = 8;
/// Minimum distance of a stand-in from the newest click, because the mask may be wrong near it.
const STAND_IN_AWAY_PX: f64 = 20.0;

/// Returns the label under the newest click, which gives way to an answer, if the click includes.
///
/// The click marks that label as wrong there.
fn giving_way(project: &Project, mask: &LabelMask, request: &PromptRequest) -> Vec<LabelId> {
    let newest = request.prompt.clicks.last().filter(|click| click.include);
    let contested = newest
        .and_then(|click| click.pixel_in(mask.width, mask.height))
        .map(|at| mask.ids[at]);
    let below = project.labels.descendants(request.label);
    contested
        .into_iter()
        .filter(|id| *id != LabelId::NONE && !below.contains(id))
        .collect()
}

/// Returns the pixels of other labels, which an answer may not take.
///
/// Descendants of the label are excepted.
fn taken(project: &Project, mask: &LabelMask, request: &PromptRequest) -> Option<Region> {
    let mut open = giving_way(project, mask, request);
    open.extend(project.labels.descendants(request.label));
    let taken = taken_by_others(mask, request.label, &open, &project.labels);
    taken.inside.contains(&true).then_some(taken)
}

#[cfg(test)]
mod tests;
