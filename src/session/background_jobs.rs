use crate::job_task::JobTitle;
use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use crate::jobs::{JobContext, JobKind};
use crate::live_preview::PreviewSink;
use crate::queries::{
    Angles, CloudState, MeasuredCloud, PromptTools, Snapshot, choose_points, find_angles,
    find_conflicts, find_vote_mismatch, label_points, load_cloud, load_mesh, load_sparse_model,
    make_surface, measure_traits, place_all, place_frame, preview_prompt, propose_instances,
    survey_frames, under,
};
use crate::query::{Query, QueryKey, WithWarnings};
use crate::session::Background;
use crate::{Event, JobCompletion, Session};
use ostra_cloud::LabelledCloud;
use ostra_core::job::{Progress, Stopped};
use ostra_masks::LabelTree;
use ostra_project::voted_cloud::VotedCloud;

/// Accessor for a query in the background state.
type QueryAccessor<K, V> = fn(&mut Background) -> &mut Query<K, V>;

impl Session {
    /// Starts the jobs of all values that were requested and are not available.
    pub(crate) fn start_background_jobs(&mut self) {
        if self.background.preview.gather() {
            self.events.push(Event::CloudChanged);
        }
        self.note_end_of_preview();
        self.start_for_project(|all| &mut all.cloud.loaded, load_cloud);
        self.start_for_project(|all| &mut all.mesh, load_mesh);
        self.start_for_project(|all| &mut all.surface, make_surface);
        self.start_for_project(
            |all| &mut all.sparse,
            |snapshot, key, _| load_sparse_model(snapshot, key),
        );
        self.start_for_project(|all| &mut all.frame_points, place_frame);
        self.start_for_project(|all| &mut all.all_points, place_all);
        self.start_for_project(
            |all| &mut all.depth_points,
            |_, key, progress| label_points(key, progress),
        );
        self.start_for_project(|all| &mut all.instances, propose_instances);
        self.start_revote();
        self.start_conflicts();
        self.start_vote_mismatch();
        self.start_traits();
        self.start_angles();
        self.start_selection();
        self.start_prompt_preview();
        self.start_survey();
    }

    /// Notes with which frames the job of the preview ended.
    fn note_end_of_preview(&mut self) {
        let is_over = !self.is_previewing();
        let frames = self.project().map(|project| Arc::clone(&project.frames));
        let preview = &mut self.background.preview;
        if let (true, Some(frames)) = (is_over, frames) {
            preview.end(&frames);
        }
    }

    fn next<K: QueryKey, V>(&mut self, slot: QueryAccessor<K, V>) -> Option<K> {
        slot(&mut self.background).next(&mut self.jobs)
    }

    /// Starts the job of a query that works on a snapshot of the project, if it is due.
    fn start_for_project<
        K: QueryKey,
        V: Send + Sync + 'static,
        R: Into<WithWarnings<V>> + 'static,
    >(
        &mut self,
        slot: QueryAccessor<K, V>,
        make: fn(&Snapshot, &K, &Progress) -> Result<R>,
    ) {
        if let Some(key) = self.next(slot)
            && let Some(snapshot) = self.query_snapshot()
        {
            self.start_query(slot, key, move |key, progress| {
                Ok(make(&snapshot, key, progress)?.into())
            });
        }
    }

    /// Starts the job that computes the value of a key.
    fn start_query<K: QueryKey, V: Send + Sync + 'static>(
        &mut self,
        slot: QueryAccessor<K, V>,
        key: K,
        make: impl FnOnce(&K, &Progress) -> Result<WithWarnings<V>> + Send + 'static,
    ) {
        let of_job = key.clone();
        let title = JobTitle {
            text: K::TITLE.to_owned(),
            task: K::TASK,
        };
        let job = self.start(title, key.kind(), move |context| {
            let WithWarnings { value, warnings } = make(&of_job, &context.progress)?;
            let (job, value) = (context.id(), Arc::new(value));
            Ok(Box::new(move |session: &mut Self| {
                if slot(&mut session.background).finished(job, value) {
                    session.warn_all(warnings);
                    session.events.extend(K::EVENT);
                }
                Ok(())
            }) as JobCompletion)
        });
        slot(&mut self.background).started(key, job);
    }

    fn query_snapshot(&self) -> Option<Snapshot> {
        let state = self.cloud_state();
        let loaded =
            state.and_then(|state| Some((state, self.background.cloud.voted(state.version)?)));
        Some(Snapshot {
            project: self.snapshot().ok()?,
            root: self.root().map(Path::to_owned)?,
            store: Arc::clone(&self.store),
            loaded,
        })
    }

    /// Returns the cloud in memory if it is in this state.
    fn voted_cloud(&self, state: CloudState) -> Option<VotedCloud> {
        let voted = self.background.cloud.voted(state.version)?;
        (self.cloud_state() == Some(state)).then_some(voted)
    }

    fn start_conflicts(&mut self) {
        let Some(key) = self.next(|all| &mut all.conflicts) else {
            return;
        };
        let Some(voted) = self.voted_cloud(key.cloud) else {
            return;
        };
        let conflicts = &mut self.background.conflicts;
        conflicts.amend(|of, known| {
            if of.cloud != key.cloud {
                known.retain(|frame, _| key.masks.contains_key(frame));
            }
        });
        let before = conflicts.latest().cloned();
        self.start_query(
            |all| &mut all.conflicts,
            key,
            move |key, progress| {
                let found = find_conflicts(&voted, key, before.as_ref(), progress)?;
                Ok(found.into())
            },
        );
    }

    fn start_vote_mismatch(&mut self) {
        if let Some(key) = self.next(|all| &mut all.vote_mismatch)
            && let Some(voted) = self.voted_cloud(key.cloud)
            && let Ok(project) = self.snapshot()
        {
            let store = Arc::clone(&self.store);
            self.start_query(
                |all| &mut all.vote_mismatch,
                key,
                move |key, _| Ok(find_vote_mismatch(&project, &store, &voted, key)?.into()),
            );
        }
    }

    /// Returns the cloud and label tree to measure if they still match the cloud in memory.
    fn measurable_as(&self, of: &MeasuredCloud) -> Option<(Arc<LabelledCloud>, LabelTree)> {
        let (cloud, tree) = self.measurable()?;
        (MeasuredCloud::new(cloud, tree) == *of).then(|| (Arc::clone(cloud), tree.clone()))
    }

    fn start_survey(&mut self) {
        if let Some(key) = self.next(|all| &mut all.survey) {
            self.start_query(
                |all| &mut all.survey,
                key,
                |key, progress| Ok(survey_frames(key, progress)?.into()),
            );
        }
    }

    fn start_traits(&mut self) {
        if let Some(key) = self.next(|all| &mut all.traits)
            && let Some((cloud, tree)) = self.measurable_as(&key.of)
        {
            self.start_query(
                |all| &mut all.traits,
                key,
                move |key, progress| Ok(measure_traits(&under(cloud, tree), key, progress)?.into()),
            );
        }
    }

    fn start_angles(&mut self) {
        if let Some(key) = self.next(|all| &mut all.angles)
            && let Some((cloud, tree)) = self.measurable_as(&key.of)
        {
            let known = self.background.angles.known(&key);
            let known = known.map_or_else(Angles::new, |known| Angles::clone(known.value));
            self.start_query(
                |all| &mut all.angles,
                key,
                move |key, progress| {
                    let cloud = under(cloud, tree);
                    Ok(find_angles(&cloud, &key.pairs, known, progress)?.into())
                },
            );
        }
    }

    pub(crate) fn start_selection(&mut self) {
        if let Some(key) = self.next(|all| &mut all.selection)
            && let Some(cloud) = self.cloud().filter(|cloud| key.is_in(cloud)).cloned()
            && let Ok(project) = self.snapshot()
        {
            let selector = self.selector_of(&cloud);
            self.start_query(
                |all| &mut all.selection,
                key,
                move |key, progress| {
                    let steps = &key.steps;
                    Ok(choose_points(&cloud, selector, &project, steps, progress)?.into())
                },
            );
        }
    }

    pub(crate) fn start_prompt_preview(&mut self) {
        let Some(request) = self.next(|all| &mut all.prompt_preview) else {
            return;
        };
        let Ok(project) = self.snapshot() else { return };
        let Some(segmenter) = self.preview_segmenter(&project, &request) else {
            return;
        };
        let tools = PromptTools {
            segmenter,
            prepared: Arc::clone(&self.prompting.prepared),
            store: Arc::clone(&self.store),
        };
        self.start_query(
            |all| &mut all.prompt_preview,
            request,
            move |request, progress| Ok(preview_prompt(&project, request, &tools, progress).into()),
        );
    }

    /// Starts a new vote of the frames whose masks changed.
    fn start_revote(&mut self) {
        let revote = &mut self.background.revote;
        let is_voting = revote.job.is_some_and(|job| self.jobs.is_working(job));
        if is_voting
            || self.check_no_long_job().is_err()
            || !self.background.revote.is_wanted.take()
        {
            return;
        }
        let (Some(open), Some(version)) = (self.open.as_ref(), self.cloud_version()) else {
            return;
        };
        let (project, revision) = (Arc::clone(open.project()), open.revision());
        let Some(voted) = self.background.cloud.voted(version) else {
            return;
        };
        let revote = &mut self.background.revote;
        let Some(changed) = revote.changed_voters(&project, revision, &voted) else {
            return;
        };
        let store = Arc::clone(&self.store);
        let job = self.start("vote again", JobKind::Background, move |context| {
            let frames = &changed.frames;
            let relabelled = voted.relabelled(&project, &store, frames, &context.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                let Background { cloud, revote, .. } = &mut session.background;
                let Some(relabelled) = relabelled else {
                    revote.counted = Some(changed.inputs);
                    return Ok(());
                };
                let votes = Arc::clone(&relabelled.votes);
                if cloud.revote(&voted.votes, relabelled) {
                    revote.counted = Some(changed.inputs.counted_in(&votes));
                    session.events.push(Event::CloudChanged);
                }
                Ok(())
            }) as JobCompletion)
        });
        self.background.revote.job = Some(job);
    }
}

impl PreviewSink for JobContext<Session> {
    fn is_watched(&self) -> bool {
        JobContext::is_watched(self)
    }

    fn show(&self, frame: usize, points: LabelledCloud) -> Result<(), Stopped> {
        let job = self.id();
        self.send(move |session| {
            session.background.preview.add(job, frame, points);
            Ok(())
        })
    }
}
