use std::sync::Arc;

use ostra_project::Project;
use ostra_session::Session;

use crate::{Panes, SessionView, ViewState};

/// Returns what the session shows in a view; `nothing` is the project while none is open.
///
/// Images, layers, jobs, engines, networks, recent projects, the mask before the last step and
/// the revision are left out.
pub(super) fn view_of<'a>(
    session: &'a Session,
    nothing: &'a Arc<Project>,
    view: &ViewState,
) -> SessionView<'a> {
    let conflicts = session.conflicts();
    let measures = &view.measures;
    SessionView {
        project: session.project().unwrap_or(nothing),
        revision: 0,
        root: session.root(),
        cloud: session.cloud(),
        votes: session.votes(),
        proposed: view
            .instances
            .and_then(|request| session.proposed_instances(request)),
        has_surface: session.surface_voxel().is_some(),
        surface: view
            .shown
            .surface()
            .and_then(|surface| session.surface(surface)),
        preview_cloud: session.preview_cloud(),
        depth_points: (view.prefs.panes != Panes::Image)
            .then(|| session.depth_points(view.frame, view.prefs.scene.frame_points))
            .flatten(),
        sparse: session.sparse(),
        chosen: session.selected(),
        inspected: session.inspected(),
        images: None,
        layers: None,
        hovered: session.hovered(),
        jobs: &[],
        engines: &[],
        models: &[],
        last_prompt: session.last_prompt(),
        undo: session.undo_title(),
        redo: session.redo_title(),
        recent: &[],
        recent_projects: None,
        survey: None,
        survey_images: None,
        before: None,
        suggestions: session.suggestions(),
        grounding: session.grounding(),
        conflicts,
        vote_mismatch: view
            .shows_mismatch(conflicts)
            .then(|| session.vote_mismatch(view.frame))
            .flatten(),
        traits: measures
            .open
            .then(|| session.traits(measures.settings))
            .flatten(),
        angles: measures.open.then(|| session.angles(measures.pairs())),
        unit: session.length_unit(),
        unfinished: None,
    }
}
