use std::collections::VecDeque;
use std::sync::Arc;

use egui::{Pos2, Ui};
use glam::{Vec2, Vec3};

use ostra_cloud::LabelledCloud;
use ostra_view::{Appearance, Clip, Picking, ViewCamera};

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

/// A point that is being looked for.
struct Pick {
    purpose: Purpose,
    cloud: Arc<LabelledCloud>,
    picking: Picking,
}

/// Points of the 3-D view that are looked for in the background, for a hand that does not wait: those of clicks in their order,
/// and one for the wheel at a time.
#[derive(Default)]
pub(super) struct ScenePicks {
    clicks: VecDeque<Pick>,
    wheel: Option<Pick>,
}

impl ScenePicks {
    /// Begins to look for the point that is seen within `radius_px` of a pixel of the view. The wheel's turn is passed over
    /// while another is looked for.
    pub fn begin(
        &mut self,
        ui: &Ui,
        purpose: Purpose,
        cloud: &Arc<LabelledCloud>,
        near: (Vec2, f32),
        (camera, appearance, clip): (&ViewCamera, &Appearance, &Clip),
    ) {
        let is_wheel = matches!(purpose, Purpose::Zoom(_));
        if is_wheel && self.wheel.is_some() {
            return;
        }
        let (waker, seen) = (ui.ctx().clone(), (appearance.clone(), *clip));
        let picking = Picking::begin(Arc::clone(cloud), *camera, near, seen, move || {
            waker.request_repaint()
        });
        let pick = Pick {
            purpose,
            cloud: Arc::clone(cloud),
            picking,
        };
        if is_wheel {
            self.wheel = Some(pick);
        } else {
            self.clicks.push_back(pick);
        }
    }

    /// The next that is known; clicks wait for those before.
    pub fn next(&mut self) -> Option<Picked> {
        let known = |pick: &Pick| pick.picking.next();
        let wheel = self
            .wheel
            .as_ref()
            .and_then(known)
            .and_then(|point| Some((self.wheel.take()?, point)));
        let click = || {
            let point = self.clicks.front().and_then(known)?;
            Some((self.clicks.pop_front()?, point))
        };
        let (Pick { purpose, cloud, .. }, point) = wheel.or_else(click)?;
        Some(Picked {
            purpose,
            cloud,
            point,
        })
    }
}
