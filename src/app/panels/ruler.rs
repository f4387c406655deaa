use egui::{ComboBox, DragValue, Key, Ui};
use glam::Vec3;

use super::measures::unit_ui;
use crate::tips::action_button;
use crate::{Action, Look, ViewState};
use ostra_cloud::measure::{Dimension, GroundChoice, LengthUnit};
use ostra_project::{ScaleEnd, ScaleRequest};
use ostra_session::Command;
use ostra_view::Line;

const COLOR: [u8; 4] = [255, 90, 90, 255];

/// What the ruler measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RulerKind {
    /// The length of the line through all points; of two it is their distance.
    #[default]
    Length,
    /// The angle at the second of three points.
    Angle,
}

/// Points of the 3-D view, and how far the first two are known to be apart.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ruler {
    /// Whether clicks in the 3-D view set its points.
    pub in_hand: bool,
    /// What is measured.
    pub kind: RulerKind,
    /// In world units, in the order of the clicks.
    pub points: Vec<Vec3>,
    /// The known length; 0 = not given yet.
    pub length: f64,
    /// What the known length is given in.
    pub length_unit: LengthUnit,
}

impl Ruler {
    /// Sets the next point; a fourth of an angle begins anew.
    pub fn click(&mut self, at: Vec3) {
        if self.kind == RulerKind::Angle && self.points.len() >= 3 {
            self.points.clear();
        }
        self.points.push(at);
    }

    /// Takes the last point back.
    pub fn undo_click(&mut self) {
        self.points.pop();
    }

    /// What it measures: a length in world units or an angle in degrees, 0–180; none before there are points enough.
    #[must_use]
    pub fn value(&self) -> Option<(f64, Dimension)> {
        match (self.kind, &self.points[..]) {
            (RulerKind::Length, points @ [_, _, ..]) => {
                let steps = points
                    .windows(2)
                    .map(|pair| pair[0].as_dvec3().distance(pair[1].as_dvec3()));
                Some((steps.sum(), Dimension::Length))
            }
            (RulerKind::Angle, &[a, corner, b, ..]) => {
                let [a, b] = [a, b].map(|end| (end - corner).as_dvec3());
                let angle = a.angle_between(b).to_degrees();
                angle.is_finite().then_some((angle, Dimension::Angle))
            }
            _ => None,
        }
    }

    /// The plane through three points, whose upper side is that of `up`; none through fewer, or more, or three in a row.
    #[must_use]
    pub fn plane(&self, up: Vec3) -> Option<GroundChoice> {
        let [a, b, c] = self.points[..] else {
            return None;
        };
        let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
        let normal = (b - a).cross(c - a).try_normalize()?;
        let normal = if normal.dot(up.as_dvec3()) < 0.0 {
            -normal
        } else {
            normal
        };
        Some(GroundChoice::Plane {
            normal: normal.to_array(),
            offset: normal.dot(a),
        })
    }

    /// Its line, and a cross of `size` world units on each point.
    #[must_use]
    pub fn lines(&self, size: f32) -> Vec<Line> {
        let line = |a: Vec3, b: Vec3| {
            [a, b].map(|end| Line {
                position: end.to_array(),
                color: COLOR,
            })
        };
        let cross = |&at: &Vec3| {
            [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| line(at - size * axis, at + size * axis))
        };
        let crosses = self.points.iter().flat_map(cross).flatten();
        let between = self
            .points
            .windows(2)
            .flat_map(|pair| line(pair[0], pair[1]));
        crosses.chain(between).collect()
    }

    /// What sets the scale; none before the length of two points is known.
    #[must_use]
    pub fn command(&self) -> Option<Command> {
        let (RulerKind::Length, &[a, b]) = (self.kind, &self.points[..]) else {
            return None;
        };
        let ends = [a, b].map(|end| ScaleEnd::World(end.as_dvec3()));
        let length = self.length_unit.metres(self.length);
        (length > 0.0 && a != b).then_some(Command::Scale(ScaleRequest { ends, length }))
    }

    /// Follows a scene whose lengths were multiplied.
    pub fn scale_by(&mut self, factor: f64) {
        for point in &mut self.points {
            *point = (point.as_dvec3() * factor).as_vec3();
        }
    }

    fn hint(&self) -> &'static str {
        match (self.kind, self.points.len()) {
            (RulerKind::Length, 0) => "Click the first point",
            (RulerKind::Length, _) => "Click the next point",
            (RulerKind::Angle, 0) => "Click a point on one leg",
            (RulerKind::Angle, 1) => "Click the corner",
            (RulerKind::Angle, _) => "Click a point on the other leg",
        }
    }
}

/// What the ruler measures, and the length it should.
pub(super) fn ruler_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &mut ViewState,
    wishes: &mut Vec<Action>,
) {
    if !view.ruler.in_hand {
        return;
    }
    kind_ui(ui, &mut view.ruler);
    if view.ruler.kind == RulerKind::Length {
        unit_ui(ui, "Ruler unit", &mut view.measures.unit, look);
    }
    match view.ruler.value() {
        Some((value, dimension)) => {
            let unit = view.measures.unit.unwrap_or(look.unit);
            ui.label(unit.text(value, dimension))
                .on_hover_text(tip(&view.ruler, unit));
        }
        None => {
            ui.weak(view.ruler.hint());
        }
    }
    undo_ui(ui, &mut view.ruler);
    let has_cameras = look
        .project
        .frames
        .iter()
        .any(|frame| frame.posed_camera().is_some());
    if has_cameras && view.ruler.kind == RulerKind::Length && view.ruler.points.len() == 2 {
        scale_ui(ui, view, wishes);
    }
}

fn kind_ui(ui: &mut Ui, ruler: &mut Ruler) {
    let kinds = [
        (
            RulerKind::Length,
            "Distance",
            "The length of the line through two or more points",
        ),
        (
            RulerKind::Angle,
            "Angle",
            "The angle at the second of three points",
        ),
    ];
    for (kind, text, tip) in kinds {
        if ui
            .selectable_label(ruler.kind == kind, text)
            .on_hover_text(tip)
            .clicked()
            && ruler.kind != kind
        {
            (ruler.kind, ruler.points) = (kind, Vec::new());
        }
    }
}

fn tip(ruler: &Ruler, unit: LengthUnit) -> String {
    let steps = ruler
        .points
        .windows(2)
        .map(|pair| f64::from(pair[0].distance(pair[1])));
    let steps: Vec<String> = steps
        .map(|step| unit.text(step, Dimension::Length))
        .collect();
    format!(
        "Through {} points of the cloud: {}",
        ruler.points.len(),
        steps.join(", ")
    )
}

fn undo_ui(ui: &mut Ui, ruler: &mut Ruler) {
    if ruler.points.is_empty() {
        return;
    }
    let by_key =
        !ui.ctx().text_edit_focused() && ui.input(|input| input.key_pressed(Key::Backspace));
    if ui
        .button("Undo click")
        .on_hover_text("Takes the last point back (Backspace or right click)")
        .clicked()
        || by_key
    {
        ruler.undo_click();
    }
    if ui
        .button("Clear")
        .on_hover_text("Takes all points away")
        .clicked()
    {
        ruler.points.clear();
    }
}

fn scale_ui(ui: &mut Ui, view: &mut ViewState, wishes: &mut Vec<Action>) {
    ui.label("is really");
    let length = DragValue::new(&mut view.ruler.length)
        .range(0.0..=1e9)
        .speed(0.01)
        .max_decimals(6);
    ui.name_inputs("Known length", |ui| ui.add(length))
        .on_hover_text("How far the two points are apart in reality");
    let unit = &mut view.ruler.length_unit;
    let choice = ComboBox::from_id_salt("known length unit")
        .selected_text(unit.sign())
        .width(50.0)
        .show_ui(ui, |ui| {
            for metric in LengthUnit::METRIC {
                ui.selectable_value(unit, metric, metric.sign());
            }
        });
    choice
        .response
        .on_hover_text("The unit of the known length")
        .accessible_name("Unit of the known length");
    let possible = view.ruler.command().is_some();
    if action_button(
        ui,
        &view.prefs.shortcuts,
        Action::SetScale,
        "Set scale",
        possible,
    )
    .clicked()
    {
        wishes.push(Action::SetScale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_add_up_and_angles_are_at_the_second_point() {
        let mut ruler = Ruler::default();
        for at in [Vec3::ZERO, 3.0 * Vec3::X, 3.0 * Vec3::X + 4.0 * Vec3::Y] {
            ruler.click(at);
        }
        assert_eq!(ruler.value(), Some((7.0, Dimension::Length)));
        ruler.length = 2.0;
        assert_eq!(ruler.command(), None, "a scale is set by two points");
        ruler.kind = RulerKind::Angle;
        assert_eq!(ruler.value(), Some((90.0, Dimension::Angle)));
        ruler.kind = RulerKind::Length;
        ruler.undo_click();
        assert_eq!(ruler.value(), Some((3.0, Dimension::Length)));
        assert!(ruler.command().is_some());
        ruler.undo_click();
        assert_eq!(ruler.value(), None);
    }

    #[test]
    fn three_points_make_a_plane_whose_upper_side_is_up() {
        let mut ruler = Ruler {
            points: vec![Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z + Vec3::Y],
            ..Ruler::default()
        };
        let plane = |z, offset| {
            Some(GroundChoice::Plane {
                normal: [0.0, 0.0, z],
                offset,
            })
        };
        assert_eq!(ruler.plane(Vec3::Z), plane(1.0, 1.0));
        assert_eq!(ruler.plane(Vec3::new(0.3, 0.0, -1.0)), plane(-1.0, -1.0));
        ruler.points[2] = Vec3::Z + 3.0 * Vec3::X;
        assert_eq!(ruler.plane(Vec3::Z), None, "three in a row");
        ruler.undo_click();
        assert_eq!(ruler.plane(Vec3::Z), None);
    }

    #[test]
    fn a_fourth_point_of_an_angle_begins_anew() {
        let mut ruler = Ruler {
            kind: RulerKind::Angle,
            ..Ruler::default()
        };
        (0..4).for_each(|k| ruler.click(Vec3::splat(k as f32)));
        assert_eq!(ruler.points, [Vec3::splat(3.0)]);
    }
}
