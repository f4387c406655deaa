use std::collections::VecDeque;
use std::sync::Arc;

use egui::{Pos2, Ui};
use glam::{Vec2, Vec3};

use crate::scene::LabelledCloud;
use crate::view::{Appearance, Clip, Picking, ViewCamera};

/// What a point is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Purpose {
    /// To tell its label and who voted.
    Ask,
    /// To show its label alone.
    Isolate,
    /// To set the next point of the ruler.
    Measure,
    /// To turn the view about it.
    Recentre,
    /// To zoom to what is at this place of the window.
    Zoom(Pos2),
}

/// What was found.
pub(super) struct Picked {
    pub purpose: Purpose,
    pub cloud: Arc<LabelledCloud>,
    /// `None` = no point lies there.
    pub point: Option<usize>,
}

impl Picked {
    /// Where the point is, world units.
    pub fn place(&self) -> Option<Vec3> {
        self.point.map(|point| self.cloud.positions[point])
    }
}

/// Points of the 3-D view that are looked for in the background, for a hand that does not wait: in the order of its clicks.
#[derive(Default)]
pub(super) struct ScenePicks {
    waiting: VecDeque<(Purpose, Arc<LabelledCloud>, Picking)>,
}

impl ScenePicks {
    /// Begins to look for the point that is seen within `radius_px` of a pixel of the view.
    pub fn begin(
        &mut self,
        ui: &Ui,
        purpose: Purpose,
        cloud: &Arc<LabelledCloud>,
        near: (Vec2, f32),
        (camera, appearance, clip): (&ViewCamera, &Appearance, &Clip),
    ) {
        let (waker, seen) = (ui.ctx().clone(), (appearance.clone(), *clip));
        let picking = Picking::begin(Arc::clone(cloud), *camera, near, seen, move || waker.request_repaint());
        self.waiting.push_back((purpose, Arc::clone(cloud), picking));
    }

    /// The next that is known; later ones wait for those before.
    pub fn next(&mut self) -> Option<Picked> {
        let point = self.waiting.front()?.2.next()?;
        let (purpose, cloud, _) = self.waiting.pop_front()?;
        Some(Picked { purpose, cloud, point })
    }
}
