use std::sync::Arc;

use anyhow::{Result, ensure};

use super::paint::{anchor, by_hand, check_unlocked, label_name, mask_of};
use crate::Event;
use crate::engines::geometry_segmenter;
use crate::{Kind, Landing};
use crate::{PromptRequest, Session, engines};
use ostra_cloud::SceneError;
use ostra_cloud::fuse::{naming, readable};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{
    Click, LabelId, LabelMask, PreparedFrame, Prompt, Region, SegmentRequest, compose, erase,
    landmarks, taken_by_others,
};
use ostra_project::{Edit, Project};
use ostra_tracking::supervoxels::GeometrySegmenter;

impl Session {
    pub(crate) fn prompt(&mut self, request: &PromptRequest) -> Result<Option<JobId>> {
        let project = self.snapshot()?;
        let frame = project.frame(request.frame)?.clone();
        check_unlocked(&project, request.frame, request.label)?;
        self.hover(None);
        if request.prompt.is_empty() {
            self.supersede(request);
            return self
                .take_off(&project, request.frame, request.label)
                .map(|()| None);
        }
        let segmenter = engines::segmenter(&request.segmenter, self.geometry_for(&project))?;
        self.supersede(request);
        if request.segmenter == "auto"
            && self.told_segmenter.replace(segmenter.name()) != Some(segmenter.name())
        {
            self.events
                .push(Event::Notice(format!("segmenter: {}", segmenter.name())));
        }
        let (prepared, store, request) = (
            Arc::clone(&self.prepared),
            Arc::clone(&self.store),
            request.clone(),
        );
        let kind = Kind::Prompt {
            frame: request.frame,
            label: request.label,
        };
        Ok(Some(self.start("Segment", kind, move |link| {
            let ready = prepared.get(segmenter.as_ref(), &frame, &store, &link.progress)?;
            link.progress.stage("segment")?;
            let region = answer(ready.as_ref(), &project, &request, &link.progress)?;
            let warning = unread_depth(&frame, &store)?;
            Ok(Box::new(move |session: &mut Self| {
                session.take_answer(&request, &region)?;
                session.warn_all(warning.into_iter().collect());
                Ok(())
            }) as Landing)
        })))
    }

    /// Makes a frame ready for prompts in the background, then its neighbours; the frame asked for last goes first.
    pub fn prepare(&mut self, frame: usize, segmenter: &str) {
        let Some(project) = self.project().map(Arc::clone) else {
            return;
        };
        let Some(name) = project.frames.get(frame).map(|frame| &frame.name) else {
            return;
        };
        if self.preparing.as_deref() == Some(name) {
            return;
        }
        let Ok(segmenter) = engines::previewer(segmenter, self.geometry_for(&project)) else {
            return;
        };
        self.jobs
            .iter()
            .filter(|job| job.title == PREPARE)
            .for_each(crate::jobs::Job::stop);
        self.preparing = Some(name.clone());
        let (prepared, store) = (Arc::clone(&self.prepared), Arc::clone(&self.store));
        self.start(PREPARE, Kind::Background, move |link| {
            for (done, of) in frames_around(&project.frames, frame).enumerate() {
                let ready = match prepared.get(segmenter.as_ref(), of, &store, &link.progress) {
                    // What is wrong with a neighbour is said where it is shown.
                    Err(_) if done > 0 => {
                        link.progress.check()?;
                        continue;
                    }
                    ready => ready?,
                };
                if done == 0 && !prepared.has_room_for(ready.bytes() * AHEAD.len()) {
                    break;
                }
            }
            Ok(Box::new(|_: &mut Self| Ok(())) as Landing)
        });
    }

    /// The segmenter that knows where a project's frames were taken from.
    pub(crate) fn geometry_for(&mut self, project: &Project) -> Arc<GeometrySegmenter> {
        let kept = self
            .geometry
            .take()
            .filter(|kept| kept.is_for(&project.frames));
        let make = || geometry_segmenter(Arc::clone(&project.frames), Arc::clone(&self.store));
        Arc::clone(self.geometry.insert(kept.unwrap_or_else(make)))
    }

    /// A prompt for the same label and frame that is still being answered is no longer wanted.
    fn supersede(&mut self, request: &PromptRequest) {
        let same = Kind::Prompt {
            frame: request.frame,
            label: request.label,
        };
        for job in self.jobs.iter_mut().filter(|job| job.kind == same) {
            job.stop();
            job.discarded = true;
        }
    }

    /// Composes an answer into the frame's mask as it is now.
    fn take_answer(&mut self, request: &PromptRequest, region: &Region) -> Result<()> {
        let project = self.snapshot()?;
        let PromptRequest {
            frame,
            label,
            prompt,
            ..
        } = request;
        let mask = with_answer(&project, request, region)?;
        let title = format!("Prompt {} on frame {frame}", label_name(&project, *label)?);
        let prompt = Prompt {
            corrects: corrects(&project, &mask_of(&project, *frame)?, request),
            ..prompt.clone()
        };
        let mut edits = vec![Edit::SetPrompt {
            frame: *frame,
            label: *label,
            prompt: Some(prompt),
        }];
        edits.extend(by_hand(&project, *frame, &mask));
        self.commit(&title, edits)
    }

    /// Takes a label off a frame; a frame on which nothing is left is no anchor any more.
    fn take_off(&mut self, project: &Project, frame: usize, label: LabelId) -> Result<()> {
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
                mask: left.then(|| anchor(&mask)),
            });
        }
        self.commit(&format!("Take {name} off frame {frame}"), edits)
    }
}

/// A line that names a frame where its depth cannot be read.
pub(super) fn unread_depth(frame: &Frame, store: &FrameStore) -> Result<Option<String>> {
    let depth = readable(store.depth(frame).map_err(SceneError::from))?;
    let unread = depth.is_none().then_some(frame.name.as_str());
    Ok(naming(
        "have a depth that cannot be read, and are segmented without it; check their files",
        unread.as_slice(),
    ))
}

/// The job that reads ahead.
const PREPARE: &str = "prepare";
/// Where the frames lie that are made ready, counted from the one shown.
const AHEAD: [isize; 5] = [0, 1, -1, 2, -2];

/// A frame and its neighbours, the nearest first.
fn frames_around(frames: &[Frame], at: usize) -> impl Iterator<Item = &Frame> {
    AHEAD
        .into_iter()
        .filter_map(move |step| frames.get(at.checked_add_signed(step)?))
}

/// The pixels that a prompt asks for, given all else that the frame shows.
pub fn answer(
    ready: &dyn PreparedFrame,
    project: &Project,
    request: &PromptRequest,
    progress: &Progress,
) -> Result<Region> {
    let mask = mask_of(project, request.frame)?;
    let mut previous = refines(project, &mask, request)
        .then(|| mask.region(request.label))
        .filter(|is| is.area() > 0);
    if corrects(project, &mask, request) {
        // Of several new clicks on a mask each is answered on its own.
        let before = project
            .prompts
            .get(&(request.frame, request.label))
            .map_or(0, |before| before.clicks.len());
        for clicks in before + 1..request.prompt.clicks.len() {
            let mut request = request.clone();
            request.prompt.clicks.truncate(clicks);
            previous = Some(ask(
                ready,
                (project, &mask),
                &request,
                previous.as_ref(),
                progress,
            )?);
        }
    }
    ask(
        ready,
        (project, &mask),
        request,
        previous.as_ref(),
        progress,
    )
}

/// One answer, which refines a `previous` one.
fn ask(
    ready: &dyn PreparedFrame,
    (project, mask): (&Project, &LabelMask),
    request: &PromptRequest,
    previous: Option<&Region>,
    progress: &Progress,
) -> Result<Region> {
    let taken = taken(project, mask, request);
    let prompt = Prompt {
        corrects: corrects(project, mask, request),
        ..against_rivals(project, mask, request)
    };
    Ok(ready.segment(
        &SegmentRequest {
            prompt: &prompt,
            previous,
            taken: taken.as_ref(),
        },
        progress,
    )?)
}

/// The frame's mask with the answer to a prompt composed into it.
pub fn with_answer(
    project: &Project,
    request: &PromptRequest,
    region: &Region,
) -> Result<LabelMask> {
    let mut mask = mask_of(project, request.frame)?;
    let yielding = giving_way(project, &mask, request);
    compose(
        &mut mask,
        region,
        request.label,
        &request.prompt,
        &yielding,
        &project.labels,
    )?;
    Ok(mask)
}

/// Whether the new prompt is the former one and one click more, or the first click on a mask that a tracker brought:
/// then the answer is refined, not begun anew. On a mask that is corrected there may be several clicks more: who clicks faster
/// than answers come does not lose what the clicks are on.
fn refines(project: &Project, mask: &LabelMask, request: &PromptRequest) -> bool {
    let nothing = Prompt::default();
    let before = project
        .prompts
        .get(&(request.frame, request.label))
        .unwrap_or(&nothing);
    let Prompt { clicks, boxes, .. } = &request.prompt;
    let goes_on = *boxes == before.boxes && clicks.starts_with(&before.clicks);
    goes_on && (clicks.len() == before.clicks.len() + 1 || corrects(project, mask, request))
}

/// Whether a prompt's clicks mend a mask that the label had on the frame before any of them.
pub fn corrects(project: &Project, mask: &LabelMask, request: &PromptRequest) -> bool {
    let Prompt { clicks, boxes, .. } = &request.prompt;
    match project.prompts.get(&(request.frame, request.label)) {
        Some(before) => {
            before.corrects && *boxes == before.boxes && clicks.starts_with(&before.clicks)
        }
        None => boxes.is_empty() && mask.ids.contains(&request.label),
    }
}

/// What is given for the label, and that the pixels where other labels of the frame were clicked are not it. Labels
/// above or below the label are no rivals. Where a mask came without clicks, the middles of its parts stand for them.
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

/// Parts of a mask without clicks that are stood for, and how far from the newest click: what lies there may be wrong.
const STAND_INS: usize = 8;
const STAND_IN_AWAY_PX: f64 = 20.0;

/// The label that gives way to an answer: the one in whose pixels the newest click lies, if it includes: the user says
/// that it is wrong there.
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

/// The pixels that an answer may not take: those of other labels, but for parts of the label.
fn taken(project: &Project, mask: &LabelMask, request: &PromptRequest) -> Option<Region> {
    let mut open = giving_way(project, mask, request);
    open.extend(project.labels.descendants(request.label));
    let taken = taken_by_others(mask, request.label, &open, &project.labels);
    taken.inside.contains(&true).then_some(taken)
}
