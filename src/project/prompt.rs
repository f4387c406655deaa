//! The meaning of a prompt on a frame.
//!
//! It consists of the mask that the prompt refines, the questions to the segmenter, and the pixels
//! that the answer may take. Window, command line, preview and simulated users all use
//! [`PromptMeaning`], so that they agree.

use anyhow::{Context, Result, ensure};

use crate::mask_edits::{by_hand, keyframe, label_name, mask_of};
use crate::{Edit, FrameMask, Project, PromptRequest};
use ostra_core::job::Progress;
use ostra_masks::{
    Click, LabelAnswer, LabelId, LabelMask, LabelTree, PreparedFrame, Prompt, Region,
    SegmentRequest, compose, erase, landmarks, taken_by_others,
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
    /// The pixels that the first question refines.
    previous: Option<Region>,
    /// Questions in order. Each refines the answer to the one before, and the last answer counts.
    questions: Vec<Question>,
    /// Labels whose pixels the answer may take.
    yielding: Vec<LabelId>,
    of: State,
}

/// One request to the segmenter.
#[derive(Debug, Clone)]
struct Question {
    prompt: Prompt,
    /// Pixels that the answer may not take.
    taken: Option<Region>,
}

/// The state that a meaning depends on, apart from the prompt itself.
#[derive(Debug, Clone, PartialEq)]
struct State {
    mask: Option<FrameMask>,
    prompts: Vec<(LabelId, Prompt)>,
    labels: LabelTree,
}

impl State {
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
        let previous = refines(before, corrects, &request.prompt)
            .then(|| mask.region(request.label))
            .filter(|region| region.area() > 0);
        let clicks = request.prompt.clicks.len();
        let first = if corrects {
            // If a mask gets several new clicks, each click is answered separately.
            clicks.min(1 + before.map_or(0, |before| before.clicks.len()))
        } else {
            clicks
        };
        let questions = (first..=clicks).map(|clicks| {
            let mut request = request.clone();
            request.prompt.clicks.truncate(clicks);
            Question {
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
            questions: questions.collect(),
            yielding: giving_way(project, &mask, request),
            of: State::of(project, request.frame),
            mask,
        })
    }

    /// Returns whether the prompt still has this meaning for the project.
    #[must_use]
    pub fn is_of(&self, project: &Project) -> bool {
        self.of == State::of(project, self.frame)
    }

    /// Segments the pixels that the prompt asks for, given everything else on the frame.
    ///
    /// # Errors
    ///
    /// Returns an error if the segmenter fails or is stopped.
    pub fn segment(&self, ready: &dyn PreparedFrame, progress: &Progress) -> Result<Region> {
        let mut answer = None;
        for question in &self.questions {
            let request = SegmentRequest {
                prompt: &question.prompt,
                previous: answer.as_ref().or(self.previous.as_ref()),
                taken: question.taken.as_ref(),
            };
            answer = Some(ready.segment(&request, progress)?);
        }
        answer.context("the prompt is empty; add a click or a box")
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

/// Returns whether the clicks correct a mask that the label had on the frame before any of them.
fn corrects(before: Option<&Prompt>, mask: &LabelMask, request: &PromptRequest) -> bool {
    let Prompt { clicks, boxes, .. } = &request.prompt;
    match before {
        Some(before) => {
            before.corrects && *boxes == before.boxes && clicks.starts_with(&before.clicks)
        }
        None => boxes.is_empty() && mask.ids.contains(&request.label),
    }
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
