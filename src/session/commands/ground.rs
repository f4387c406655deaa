use crate::job_task::JobTask;
use std::sync::Arc;

use anyhow::{Result, ensure};

use super::prompt::unread_depth;
use crate::Event;
use crate::engine_table::EngineId;
use crate::{
    FindByTextRequest, FoundThing, Grounding, PromptRequest, Session, TakeRequest, engines,
};
use crate::{JobCompletion, JobKind};
use ostra_core::job::JobId;
use ostra_masks::{Label, LabelId, LabelTree, Prompt, PxBox};
use ostra_project::mask_edits::{by_hand, mask_of};
use ostra_project::prompt::PromptMeaning;
use ostra_project::{Edit, Project};

impl Session {
    /// Finds objects by text and offers them, without changing the project.
    pub(crate) fn ground(&mut self, request: &FindByTextRequest) -> Result<JobId> {
        let project = self.snapshot()?;
        let frame = project.frame(request.frame)?.clone();
        ensure!(
            !request.phrases.is_empty(),
            "there is nothing to search for; enter one or more words"
        );
        request.grounder.installed()?;
        let (store, request) = (Arc::clone(&self.store), request.clone());
        Ok(
            self.start(JobTask::FindByText, JobKind::Short, move |context| {
                let grounder = engines::grounder(request.grounder)?;
                context.progress.stage("look")?;
                let query = ostra_masks::GroundRequest {
                    phrases: &request.phrases,
                    threshold: request.threshold,
                };
                let found = grounder.ground(&*store.image(&frame)?, &query, &context.progress)?;
                let thing = |found: ostra_masks::Grounded| FoundThing {
                    phrase: request.phrases[found.phrase].clone(),
                    extent: found.extent,
                    score: found.score,
                };
                let things: Vec<FoundThing> = found.into_iter().map(thing).collect();
                let grounding = Grounding {
                    frame: request.frame,
                    grounder: grounder.name(),
                    things,
                };
                Ok(Box::new(move |session: &mut Self| {
                    let (grounder, count) = (grounding.grounder, grounding.things.len());
                    session.events.push(Event::Notice(format!(
                        "grounder: {grounder}, {count} found"
                    )));
                    session.grounding = Some(grounding);
                    Ok(())
                }) as JobCompletion)
            }),
        )
    }

    /// Creates an instance label and a mask for each found object, in one step.
    pub(crate) fn take_found(&mut self, request: &TakeRequest) -> Result<JobId> {
        let project = self.snapshot()?;
        let frame = project.frame(request.frame)?.clone();
        ensure!(!request.things.is_empty(), "no found object was named");
        let segmenter = engines::segmenter(
            request.segmenter,
            self.prompting.geometry_for(&project.frames, &self.store),
        )?;
        let (prepared, store, request) = (
            Arc::clone(&self.prompting.prepared),
            Arc::clone(&self.store),
            request.clone(),
        );
        Ok(
            self.start("Add found objects", JobKind::Short, move |context| {
                let ready = prepared.get(segmenter.as_ref(), &frame, &store, &context.progress)?;
                context.progress.stage("segment")?;
                let image = store.image(&frame)?;
                let mut next = Project::clone(&project);
                let mut edits = Vec::new();
                for (done, (phrase, extent)) in request.things.iter().enumerate() {
                    context.progress.step(done, request.things.len())?;
                    let labels = instance_of(&next.labels, phrase)?;
                    let label = labels.last().map_or(LabelId::NONE, |label| label.id);
                    let labels = labels.into_iter().map(|label| Edit::SetLabel {
                        id: label.id,
                        label: Some(label),
                    });
                    apply(&mut next, &mut edits, labels.collect())?;
                    let prompt = Prompt {
                        boxes: vec![*extent],
                        ..Prompt::default()
                    };
                    let of = PromptRequest {
                        frame: request.frame,
                        label,
                        prompt,
                        segmenter: request.segmenter,
                    };
                    let meaning = PromptMeaning::new(&next, &of)?;
                    let region = meaning.segment(ready.as_ref(), &image, &context.progress)?;
                    let mask = meaning.compose(&next, &region)?;
                    let mut masks = by_hand(&next, request.frame, &mask);
                    masks.push(Edit::SetPrompt {
                        frame: of.frame,
                        label,
                        prompt: Some(of.prompt),
                    });
                    apply(&mut next, &mut edits, masks)?;
                }
                let warning = unread_depth(&frame, &store)?;
                Ok(Box::new(move |session: &mut Self| {
                    let now = session.snapshot()?;
                    ensure!(
                        now.labels == project.labels
                            && mask_of(&now, request.frame)? == mask_of(&project, request.frame)?,
                        "labels or the mask of frame {} changed meanwhile; take it again",
                        request.frame
                    );
                    let extents: Vec<_> =
                        request.things.iter().map(|(_, extent)| *extent).collect();
                    session.drop_found(request.frame, &extents);
                    session.commit(
                        &format!("Add found objects on frame {}", request.frame),
                        edits,
                    )?;
                    session.warn_all(warning.into_iter().collect());
                    Ok(())
                }) as JobCompletion)
            }),
        )
    }

    /// Returns the last result of a search by text, without the objects that were taken since.
    #[must_use]
    pub fn grounding(&self) -> Option<&Grounding> {
        self.grounding.as_ref()
    }

    /// Removes requested objects from the offered ones.
    pub(super) fn drop_found(&mut self, frame: usize, extents: &[PxBox]) {
        if let Some(grounding) = self
            .grounding
            .as_mut()
            .filter(|grounding| grounding.frame == frame)
        {
            grounding
                .things
                .retain(|thing| !extents.contains(&thing.extent));
        }
    }
}

/// Applies new edits to the project and appends them to the list.
fn apply(project: &mut Project, edits: &mut Vec<Edit>, new: Vec<Edit>) -> Result<()> {
    for edit in &new {
        project.apply(edit.clone())?;
    }
    edits.extend(new);
    Ok(())
}

/// Returns a label for a new instance of a class.
///
/// If the class has no label yet, its label comes first.
fn instance_of(tree: &LabelTree, kind: &str) -> Result<Vec<Label>> {
    let mut tree = tree.clone();
    let mut made = Vec::new();
    let class = match tree.by_name(kind) {
        Some(class) => class.id,
        None => add(&mut tree, &mut made, kind.to_owned(), None)?,
    };
    let free = (1..)
        .map(|number| format!("{kind} {number}"))
        .find(|name| tree.by_name(name).is_none());
    add(&mut tree, &mut made, free.unwrap_or_default(), Some(class))?;
    Ok(made)
}

fn add(
    tree: &mut LabelTree,
    made: &mut Vec<Label>,
    name: String,
    parent: Option<LabelId>,
) -> Result<LabelId> {
    let id = tree.next_id();
    ensure!(
        id != LabelId::NONE,
        "all 65535 label ids are taken; remove a label first"
    );
    let label = Label {
        id,
        name,
        color: LabelTree::color_for(id),
        parent,
    };
    tree.set(label.clone())?;
    made.push(label);
    Ok(id)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_object_is_an_instance_of_its_class() {
        let mut tree = LabelTree::default();
        for expected in [&["banana", "banana 1"][..], &["banana 2"], &["banana 3"]] {
            let made = instance_of(&tree, "banana").unwrap();
            assert_eq!(
                made.iter()
                    .map(|label| label.name.as_str())
                    .collect::<Vec<_>>(),
                expected
            );
            made.into_iter().for_each(|label| tree.set(label).unwrap());
        }
        let class = tree.by_name("banana").unwrap().id;
        assert!(
            (1..=3).all(|n| tree.by_name(&format!("banana {n}")).unwrap().parent == Some(class))
        );
    }
}
