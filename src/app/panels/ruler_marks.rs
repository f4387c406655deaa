use egui::{
    Align2, Color32, FontId, Id, Painter, Pos2, Rect, Role, Sense, Stroke, Ui, Vec2, WidgetInfo,
};
use glam::Vec3;

use super::scene_content::SceneViewport;
use super::scene_overlay::to_screen;
use super::scene_tools::{Ruler, RulerKind};
use ostra_cloud::measure::{Dimension, LengthUnit};

const DOT: Color32 = Color32::from_rgb(196, 32, 32);
/// Radius of a numbered point, in screen points.
const RADIUS: f32 = 8.0;

/// Draws the numbers of the ruler's points, and the measured values next to its lines.
///
/// Points behind the view are left out.
pub(super) fn ruler_marks(ui: &Ui, viewport: &SceneViewport, ruler: &Ruler, unit: LengthUnit) {
    let painter = ui.painter_at(viewport.rect);
    let seen = |at: Vec3| Some(to_screen(viewport, viewport.camera.project(at)?.0));
    for (place, (text, at)) in values(ruler, unit).into_iter().enumerate() {
        if let Some(at) = seen(at) {
            let rect = tag(&painter, at, &text);
            announce(ui, rect, ("ruler value", place), &format!("Ruler: {text}"));
        }
    }
    for (place, &at) in ruler.points.iter().enumerate() {
        if let Some(at) = seen(at) {
            let number = (place + 1).to_string();
            let rect = point(&painter, at, &number);
            announce(
                ui,
                rect,
                ("ruler point", place),
                &format!("Ruler point {number}"),
            );
        }
    }
}

/// Returns the measured values with their positions in world units.
///
/// A line has the length of each segment at its middle, an angle its value at the corner.
fn values(ruler: &Ruler, unit: LengthUnit) -> Vec<(String, Vec3)> {
    match ruler.kind {
        RulerKind::Length => ruler
            .points
            .windows(2)
            .map(|ends| {
                let length = ends[0].as_dvec3().distance(ends[1].as_dvec3());
                (
                    unit.text(length, Dimension::Length),
                    ends[0].midpoint(ends[1]),
                )
            })
            .collect(),
        RulerKind::Angle => {
            let value = ruler.value().zip(ruler.points.get(1));
            value
                .map(|((angle, dimension), &at)| (unit.text(angle, dimension), at))
                .into_iter()
                .collect()
        }
    }
}

/// Lets screen readers and tests find a drawn text; clicks go through it.
fn announce(ui: &Ui, rect: Rect, id: (&str, usize), text: &str) {
    let response = ui.interact(rect, Id::unique(id), Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, text));
}

fn point(painter: &Painter, at: Pos2, number: &str) -> Rect {
    painter.circle(at, RADIUS, DOT, Stroke::new(1.5, Color32::WHITE));
    let font = FontId::proportional(11.0);
    painter.text(at, Align2::CENTER_CENTER, number, font, Color32::WHITE);
    Rect::from_center_size(at, Vec2::splat(2.0 * RADIUS))
}

/// Draws a text on a dark plate above a position, readable on any background.
fn tag(painter: &Painter, at: Pos2, text: &str) -> Rect {
    let font = FontId::proportional(13.0);
    let galley = painter.layout_no_wrap(text.to_owned(), font, Color32::WHITE);
    let size = galley.size() + Vec2::new(10.0, 4.0);
    let rect = Rect::from_center_size(at - Vec2::new(0.0, RADIUS + 0.5 * size.y + 2.0), size);
    painter.rect_filled(rect, 4.0, Color32::from_black_alpha(200));
    painter.galley(rect.min + Vec2::new(5.0, 2.0), galley, Color32::WHITE);
    rect
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_segment_has_its_length_and_an_angle_one_value() {
        let mut ruler = Ruler {
            points: vec![Vec3::ZERO, 0.2 * Vec3::X, Vec3::new(0.2, 0.1, 0.0)],
            ..Ruler::default()
        };
        let texts = |ruler: &Ruler| -> Vec<String> {
            let values = values(ruler, LengthUnit::Centimetre);
            values.into_iter().map(|(text, _)| text).collect()
        };
        assert_eq!(texts(&ruler), ["20.00 cm", "10.00 cm"]);
        ruler.kind = RulerKind::Angle;
        assert_eq!(texts(&ruler), ["90.0°"]);
        ruler.points.pop();
        assert_eq!(texts(&ruler), Vec::<String>::new());
    }
}
