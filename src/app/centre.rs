//! Panes in the middle of the window: image, 3-D view and traits, as tiles that can be moved.

use egui::{Ui, WidgetText};
use egui_tiles::{Behavior, SimplificationOptions, TileId, UiResponse};

use super::action::Requests;
use super::arrangement::Pane;
use super::canvas::image_pane_ui;
use super::panels::{ScenePane, measures_ui};
use super::textures::Textures;
use super::{Panes, SessionView, ViewState};

/// Draws the panes that are shown.
pub(super) fn centre_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    parts: Parts<'_>,
    requests: &mut Requests,
) {
    let mut arrangement = std::mem::take(&mut view.prefs.arrangement);
    arrangement.repair();
    let (panes, traits) = (view.prefs.panes, view.measures.open);
    let has_frames = session.has_frames();
    // An empty 3-D view takes no space from the image. It opens when its content begins to be
    // computed, while the pointer is at the button of that step.
    let shows_scene = match panes {
        Panes::Both => session.has_scene(),
        Panes::Image => false,
        Panes::Scene => true,
    };
    arrangement.show_only(|pane| match pane {
        Pane::Image => has_frames && panes != Panes::Scene,
        Pane::Scene => !has_frames || shows_scene,
        Pane::Traits => traits,
    });
    let mut drawing = Drawing {
        session,
        view,
        parts,
        requests,
    };
    arrangement.0.ui(&mut drawing, ui);
    view.prefs.arrangement = arrangement;
}

/// What the panes keep between frames of the window.
pub(super) struct Parts<'a> {
    pub textures: &'a mut Textures,
    pub scene: &'a mut ScenePane,
}

struct Drawing<'a, 'b> {
    session: &'a SessionView<'b>,
    view: &'a mut ViewState,
    parts: Parts<'a>,
    requests: &'a mut Requests,
}

impl Behavior<Pane> for Drawing<'_, '_> {
    fn pane_ui(&mut self, ui: &mut Ui, _tile_id: TileId, pane: &mut Pane) -> UiResponse {
        let (session, textures) = (self.session, &mut *self.parts.textures);
        ui.spacing_mut().item_spacing.y = 0.0;
        let is_dragged = match pane {
            Pane::Image => image_pane_ui(ui, session, self.view, textures, self.requests),
            Pane::Scene => {
                let actions = &mut self.requests.actions;
                self.parts
                    .scene
                    .ui(ui, session, self.view, textures, actions)
            }
            Pane::Traits => {
                egui::Frame::new().inner_margin(8).show(ui, |ui| {
                    ui.spacing_mut().item_spacing.y = 5.0;
                    measures_ui(ui, session, self.view);
                });
                false
            }
        };
        if is_dragged {
            UiResponse::DragStarted
        } else {
            UiResponse::None
        }
    }

    fn tab_title_for_pane(&mut self, pane: &Pane) -> WidgetText {
        match pane {
            Pane::Image => "Image",
            Pane::Scene => "3-D",
            Pane::Traits => "Traits",
        }
        .into()
    }

    fn gap_width(&self, _style: &egui::Style) -> f32 {
        2.0
    }

    fn min_size(&self) -> f32 {
        120.0
    }

    fn simplification_options(&self) -> SimplificationOptions {
        SimplificationOptions {
            all_panes_must_have_tabs: false,
            ..SimplificationOptions::default()
        }
    }
}
