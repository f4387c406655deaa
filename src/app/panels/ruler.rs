use egui::{DragValue, Ui};
use glam::Vec3;

use crate::app::tips::action_button;
use crate::app::{Action, ViewState};
use crate::session::{Command, ScaleEnd, ScaleRequest};
use crate::view::Line;

const COLOR: [u8; 4] = [255, 90, 90, 255];

/// Two points of the 3-D view and how far they are known to be apart.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ruler {
    /// Whether clicks in the 3-D view set its ends.
    pub in_hand: bool,
    /// None, one or both ends in world units.
    pub ends: Vec<Vec3>,
    /// The known length; 0 = not said yet.
    pub length: f64,
}

impl Ruler {
    /// Sets the next end; a third begins anew.
    pub fn click(&mut self, at: Vec3) {
        if self.ends.len() == 2 {
            self.ends.clear();
        }
        self.ends.push(at);
    }

    /// The distance of its ends in world units.
    #[must_use]
    pub fn distance(&self) -> Option<f64> {
        let [a, b] = self.ends[..] else { return None };
        Some(f64::from(a.distance(b)))
    }

    /// Its line, and a cross of `size` world units on each end.
    #[must_use]
    pub fn lines(&self, size: f32) -> Vec<Line> {
        let line = |a: Vec3, b: Vec3| [a, b].map(|end| Line { position: end.to_array(), color: COLOR });
        let cross = |&at: &Vec3| [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| line(at - size * axis, at + size * axis));
        let crosses = self.ends.iter().flat_map(cross).flatten();
        let between = match self.ends[..] {
            [a, b] => line(a, b).to_vec(),
            _ => Vec::new(),
        };
        crosses.chain(between).collect()
    }

    /// What sets the scale; none before both ends and the length are known.
    #[must_use]
    pub fn command(&self) -> Option<Command> {
        let [a, b] = self.ends[..] else { return None };
        let ends = [a, b].map(|end| ScaleEnd::World(end.as_dvec3()));
        (self.length > 0.0 && a != b).then_some(Command::Scale(ScaleRequest { ends, length: self.length }))
    }
}

/// What the ruler measures, and the length it should.
pub(super) fn ruler_ui(ui: &mut Ui, view: &mut ViewState, wishes: &mut Vec<Action>) {
    if !view.ruler.in_hand {
        return;
    }
    let Some(distance) = view.ruler.distance() else {
        ui.weak(if view.ruler.ends.is_empty() { "Click one end of a known length" } else { "Click the other end" });
        return;
    };
    ui.label(format!("{distance:.4}")).on_hover_text("Distance of the two points in world units");
    ui.label("is really");
    let length = DragValue::new(&mut view.ruler.length).range(0.0..=1e9).speed(0.01).max_decimals(6);
    ui.name_inputs("Known length", |ui| ui.add(length)).on_hover_text("In the unit that the scene shall have");
    let possible = view.ruler.command().is_some();
    if action_button(ui, &view.prefs.shortcuts, Action::SetScale, "Set scale", possible).clicked() {
        wishes.push(Action::SetScale);
    }
}
