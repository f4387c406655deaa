use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use egui::{Pos2, Response, Ui};
use glam::Vec2;

use super::asked::label_ui;
use super::scene_bar::labels_of;
use crate::app::{Look, ViewState};
use crate::scene::LabelledCloud;
use crate::view::{Appearance, Clip, ViewCamera, pick_point};

/// How long the pointer rests before the point under it is looked for, in seconds.
const REST_S: f64 = 0.15;
/// How far a point may lie from the pointer, in points of the screen.
const NEAR: f32 = 6.0;

/// The point of the cloud under the pointer, told at the pointer. It is looked for in the background: clouds are large.
#[derive(Default)]
pub(super) struct SceneHover {
    rest: Option<Rest>,
    looking: Option<(Place, Receiver<Option<usize>>)>,
    found: Option<(Place, Option<usize>)>,
}

/// Since when (seconds) the pointer rests at a place.
struct Rest {
    place: Place,
    since_s: f64,
}

/// A pixel of a view of a cloud.
#[derive(Clone)]
struct Place {
    at: Pos2,
    camera: ViewCamera,
    cloud: Arc<LabelledCloud>,
}

impl Place {
    fn is(&self, other: &Self) -> bool {
        self.at == other.at && self.camera == other.camera && Arc::ptr_eq(&self.cloud, &other.cloud)
    }
}

impl SceneHover {
    /// Follows the pointer over the view, and tells the label of the point that it rests on.
    pub fn ui(
        &mut self,
        ui: &Ui,
        response: &Response,
        look: &Look<'_>,
        view: &ViewState,
        (camera, clip, appearance): (&ViewCamera, &Clip, &Appearance),
    ) {
        self.take_found();
        let (Some(at), Some(cloud)) = (response.hover_pos(), look.cloud.filter(|_| may_tell(ui, look, view))) else {
            self.rest = None;
            return;
        };
        let place = Place { at, camera: *camera, cloud: Arc::clone(cloud) };
        let now = ui.input(|input| input.time);
        if !self.rest.as_ref().is_some_and(|rest| rest.place.is(&place)) {
            self.rest = Some(Rest { place: place.clone(), since_s: now });
        }
        let since_s = self.rest.as_ref().map_or(now, |rest| rest.since_s);
        if since_s + REST_S > now {
            return ui.ctx().request_repaint_after_secs((since_s + REST_S - now) as f32);
        }
        match &self.found {
            Some((of, Some(point))) if of.is(&place) => tell(response, look, cloud, *point),
            Some((of, None)) if of.is(&place) => {}
            _ if self.looking.is_none() => {
                let at = (at - response.rect.min) * ui.pixels_per_point();
                self.look_for(ui, place, Vec2::new(at.x, at.y), clip, appearance);
            }
            _ => {}
        }
    }

    fn take_found(&mut self) {
        let Some((place, looking)) = self.looking.take() else { return };
        match looking.try_recv() {
            Ok(found) => self.found = Some((place, found)),
            Err(TryRecvError::Empty) => self.looking = Some((place, looking)),
            Err(TryRecvError::Disconnected) => {}
        }
    }

    fn look_for(&mut self, ui: &Ui, place: Place, at_px: Vec2, clip: &Clip, appearance: &Appearance) {
        let (send, receive) = channel();
        let (cloud, camera, clip, appearance) = (Arc::clone(&place.cloud), place.camera, *clip, appearance.clone());
        let (waker, radius_px) = (ui.ctx().clone(), NEAR * ui.pixels_per_point());
        rayon::spawn(move || {
            // Whoever asked may be gone by now.
            let _ = send.send(pick_point(&cloud, &camera, at_px, radius_px, &appearance, &clip));
            waker.request_repaint();
        });
        self.looking = Some((place, receive));
    }
}

/// Whether the pointer is there to look: nothing is pressed or drawn, and the points shown are the cloud's.
fn may_tell(ui: &Ui, look: &Look<'_>, view: &ViewState) -> bool {
    let is_busy = view.scene_select.in_hand || view.scene.turning || ui.input(|input| input.pointer.any_down());
    look.growing.is_none() && look.proposed.is_none() && view.dialog.is_none() && !is_busy
}

fn tell(response: &Response, look: &Look<'_>, cloud: &LabelledCloud, point: usize) {
    response.clone().on_hover_ui_at_pointer(|ui| {
        label_ui(ui, labels_of(look), cloud.labels[point]);
        ui.weak(format!("{:.0} % of the votes; click for who voted what", 100.0 * cloud.confidence[point]));
    });
}
