//! Icons of the tool rows, drawn as shapes so that no font has to have them.

use egui::{
    Align2, Button, Color32, FontId, Painter, Pos2, Rect, Response, Role, Sense, Shape, Stroke, Ui,
    Vec2, WidgetInfo,
};

use super::tooltips::explained;

/// Icon of a tool or switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Icon {
    Arrow,
    Brush,
    Eraser,
    Polygon,
    Border,
    Stem,
    Magnet,
    Fit,
    ActualSize,
    Eye,
    Outline,
    Holes,
    Specks,
    Frustum,
    Picture,
    Contrast,
    Links,
    Sliders,
    Clip,
    Camera,
    Lasso,
    Ruler,
    More,
    Grip,
    Maximise,
    Restore,
    Play,
    Pause,
    Loop,
    Flag,
}

/// Size of an icon button in points.
pub(super) const ICON_SIZE: Vec2 = Vec2::new(26.0, 22.0);

/// Look of an icon button and its texts.
#[derive(Clone, Copy)]
pub(super) struct IconButton<'a> {
    pub icon: Icon,
    /// Name for screen readers and for the menu of what does not fit.
    pub name: &'a str,
    pub tip: &'a str,
    /// `None` for a button that is no switch.
    pub selected: Option<bool>,
    /// Why it is disabled; `None` while it is enabled.
    pub unavailable: Option<&'a str>,
}

impl IconButton<'_> {
    /// Adds the button to a row, or to a menu as a line of text.
    pub(super) fn show(self, ui: &mut Ui, in_menu: bool) -> Response {
        let response = if in_menu {
            self.line(ui)
        } else {
            self.icon(ui)
        };
        explained(response, self.tip, self.unavailable)
    }

    fn line(self, ui: &mut Ui) -> Response {
        let selected = self.selected.unwrap_or(false);
        let enabled = self.unavailable.is_none();
        ui.add_enabled(enabled, Button::selectable(selected, self.name))
    }

    fn icon(self, ui: &mut Ui) -> Response {
        ui.add_enabled_ui(self.unavailable.is_none(), |ui| {
            let (rect, response) = ui.allocate_exact_size(ICON_SIZE, Sense::click_and_drag());
            let (enabled, name) = (ui.is_enabled(), self.name);
            response.widget_info(|| match self.selected {
                Some(selected) => WidgetInfo::selected(Role::Button, enabled, selected, name),
                None => WidgetInfo::labeled(Role::Button, enabled, name),
            });
            let selected = self.selected.unwrap_or(false);
            let visuals = ui.style().interact_selectable(&response, selected);
            if selected || response.hovered() || response.has_focus() {
                ui.painter().rect_filled(rect, 4.0, visuals.weak_bg_fill);
            }
            if response.has_focus() {
                let stroke = ui.visuals().selection.stroke;
                ui.painter()
                    .rect_stroke(rect, 4.0, stroke, egui::StrokeKind::Inside);
            }
            paint_icon(ui.painter(), rect.center(), self.icon, visuals.text_color());
            response
        })
        .inner
    }
}

/// Paints an icon of about 14 points around a place.
pub(super) fn paint_icon(painter: &Painter, at: Pos2, icon: Icon, color: Color32) {
    let pen = Pen {
        painter,
        at,
        stroke: Stroke::new(1.4, color),
    };
    match icon {
        Icon::Arrow
        | Icon::Brush
        | Icon::Eraser
        | Icon::Polygon
        | Icon::Border
        | Icon::Stem
        | Icon::Magnet => pen.tool(icon),
        Icon::Fit
        | Icon::ActualSize
        | Icon::Eye
        | Icon::Outline
        | Icon::Holes
        | Icon::Specks
        | Icon::Contrast
        | Icon::Picture => pen.image(icon),
        Icon::Frustum
        | Icon::Links
        | Icon::Sliders
        | Icon::Clip
        | Icon::Camera
        | Icon::Lasso
        | Icon::Ruler => pen.scene(icon),
        Icon::More | Icon::Grip | Icon::Maximise | Icon::Restore => pen.frame(icon),
        Icon::Play | Icon::Pause | Icon::Loop | Icon::Flag => pen.playback(icon),
    }
}

struct Pen<'a> {
    painter: &'a Painter,
    at: Pos2,
    stroke: Stroke,
}

impl Pen<'_> {
    fn places(&self, points: &[(f32, f32)]) -> Vec<Pos2> {
        points
            .iter()
            .map(|&(x, y)| self.at + Vec2::new(x, y))
            .collect()
    }

    fn line(&self, points: &[(f32, f32)]) {
        self.painter
            .add(Shape::line(self.places(points), self.stroke));
    }

    fn ring(&self, points: &[(f32, f32)]) {
        self.painter
            .add(Shape::closed_line(self.places(points), self.stroke));
    }

    fn dot(&self, x: f32, y: f32, radius: f32) {
        let at = self.at + Vec2::new(x, y);
        self.painter.circle_filled(at, radius, self.stroke.color);
    }

    fn circle(&self, x: f32, y: f32, radius: f32) {
        let at = self.at + Vec2::new(x, y);
        self.painter.circle_stroke(at, radius, self.stroke);
    }

    fn frame_of(&self, x: f32, y: f32, half: Vec2) {
        let rect = Rect::from_center_size(self.at + Vec2::new(x, y), 2.0 * half);
        self.painter
            .rect_stroke(rect, 1.5, self.stroke, egui::StrokeKind::Middle);
    }

    fn tool(&self, icon: Icon) {
        match icon {
            Icon::Arrow => self.ring(&[
                (-4.0, -7.0),
                (-4.0, 5.0),
                (-1.0, 2.5),
                (1.0, 7.0),
                (3.0, 6.0),
                (1.0, 1.8),
                (5.0, 1.5),
            ]),
            Icon::Brush => {
                self.line(&[(6.5, -6.5), (0.0, 0.5)]);
                self.line(&[(5.0, -6.5), (-1.0, 0.0)]);
                self.dot(-3.0, 3.5, 3.4);
            }
            Icon::Eraser => {
                self.ring(&[(1.0, -6.0), (6.5, -0.5), (0.0, 6.0), (-5.5, 0.5)]);
                self.line(&[(-2.2, -2.8), (3.2, 2.8)]);
            }
            Icon::Polygon => {
                let corners = [
                    (-6.0, -2.0),
                    (1.0, -6.5),
                    (6.5, -1.0),
                    (3.0, 6.0),
                    (-4.0, 5.0),
                ];
                self.ring(&corners);
                corners.iter().for_each(|&(x, y)| self.dot(x, y, 1.8));
            }
            Icon::Border => {
                self.line(&[
                    (-1.0, -7.0),
                    (1.0, -3.5),
                    (-1.0, 0.0),
                    (1.0, 3.5),
                    (-1.0, 7.0),
                ]);
                self.line(&[(3.0, 0.0), (7.0, 0.0)]);
                self.line(&[(5.0, -2.0), (7.2, 0.0), (5.0, 2.0)]);
                self.line(&[(-3.0, 0.0), (-7.0, 0.0)]);
                self.line(&[(-5.0, -2.0), (-7.2, 0.0), (-5.0, 2.0)]);
            }
            Icon::Stem => {
                let bends = [(-5.5, 6.0), (-3.0, 0.5), (1.5, -1.0), (6.0, -6.0)];
                self.line(&bends);
                bends.iter().for_each(|&(x, y)| self.dot(x, y, 1.9));
            }
            _ => {
                self.line(&[(-5.0, -6.0), (-5.0, 1.0), (-3.0, 5.0), (0.0, 6.2)]);
                self.line(&[(5.0, -6.0), (5.0, 1.0), (3.0, 5.0), (0.0, 6.2)]);
                self.line(&[(-6.5, -3.0), (-3.5, -3.0)]);
                self.line(&[(3.5, -3.0), (6.5, -3.0)]);
            }
        }
    }

    fn image(&self, icon: Icon) {
        match icon {
            Icon::Fit => {
                for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                    let corner = [(2.5 * x, 6.0 * y), (6.5 * x, 6.0 * y), (6.5 * x, 2.0 * y)];
                    self.line(&corner);
                }
            }
            Icon::ActualSize => {
                let font = FontId::proportional(12.0);
                self.painter.text(
                    self.at,
                    Align2::CENTER_CENTER,
                    "1:1",
                    font,
                    self.stroke.color,
                );
            }
            Icon::Eye => {
                let lid = |sign: f32| {
                    (-7..=7)
                        .map(|x| (x as f32, sign * 4.4 * (1.0 - (x as f32 / 7.0).powi(2))))
                        .collect::<Vec<_>>()
                };
                self.line(&lid(1.0));
                self.line(&lid(-1.0));
                self.dot(0.0, 0.0, 2.0);
            }
            Icon::Outline => {
                self.ring(&[
                    (-2.0, -6.0),
                    (4.0, -5.0),
                    (6.0, 1.0),
                    (2.0, 6.0),
                    (-5.0, 4.0),
                    (-6.0, -2.0),
                ]);
            }
            Icon::Holes => {
                self.circle(0.0, 0.0, 6.0);
                self.dot(0.0, 0.0, 2.6);
            }
            Icon::Contrast => {
                self.circle(0.0, 0.0, 6.0);
                let half = (-8..=8).map(|k| {
                    let angle = std::f32::consts::FRAC_PI_2 * k as f32 / 8.0;
                    self.at + 6.0 * Vec2::angled(angle)
                });
                let half = Shape::convex_polygon(half.collect(), self.stroke.color, Stroke::NONE);
                self.painter.add(half);
            }
            Icon::Specks => {
                self.circle(-2.0, 1.0, 4.2);
                self.dot(5.0, -4.0, 1.4);
                self.dot(5.8, 3.6, 1.2);
                self.dot(1.6, -5.8, 1.1);
            }
            _ => {
                self.frame_of(0.0, 0.0, Vec2::new(6.5, 5.2));
                self.line(&[
                    (-5.5, 4.0),
                    (-1.5, -0.5),
                    (1.0, 2.0),
                    (3.0, 0.5),
                    (5.5, 4.0),
                ]);
                self.dot(2.8, -2.2, 1.2);
            }
        }
    }

    fn scene(&self, icon: Icon) {
        match icon {
            Icon::Frustum => {
                self.ring(&[(0.0, -5.5), (6.5, -5.5), (6.5, 5.5), (0.0, 5.5)]);
                self.line(&[(0.0, -5.5), (-6.5, 0.0), (0.0, 5.5)]);
            }
            Icon::Links => {
                self.circle(-4.2, 2.8, 2.6);
                self.circle(4.2, -2.8, 2.6);
                self.line(&[(-2.0, 1.4), (2.0, -1.4)]);
            }
            Icon::Sliders => {
                for (y, knob) in [(-5.0, 2.5), (0.0, -2.5), (5.0, 1.0)] {
                    self.line(&[(-6.5, y), (6.5, y)]);
                    self.dot(knob, y, 2.0);
                }
            }
            Icon::Clip => {
                self.frame_of(0.0, 0.0, Vec2::splat(5.0));
                self.line(&[(-7.5, 4.0), (7.5, -4.0)]);
            }
            Icon::Camera => {
                self.frame_of(0.0, 1.0, Vec2::new(6.8, 4.6));
                self.circle(0.0, 1.0, 2.4);
                self.line(&[(-3.0, -3.6), (-2.0, -5.6), (2.0, -5.6), (3.0, -3.6)]);
            }
            Icon::Lasso => {
                let path: Vec<Pos2> = (0..=20)
                    .map(|k| {
                        let turn = Vec2::angled(k as f32 / 20.0 * std::f32::consts::TAU);
                        self.at + Vec2::new(6.5 * turn.x, 4.6 * turn.y - 1.0)
                    })
                    .collect();
                self.painter
                    .extend(Shape::dashed_line(&path, self.stroke, 3.0, 2.0));
                self.line(&[(-3.0, 3.0), (-4.5, 7.0)]);
            }
            _ => {
                self.ring(&[(-7.0, 2.5), (3.0, -6.5), (7.0, -2.5), (-3.0, 6.5)]);
                self.line(&[(-4.0, 0.0), (-2.4, 1.7)]);
                self.line(&[(-1.5, -2.3), (0.1, -0.6)]);
                self.line(&[(1.0, -4.5), (2.6, -2.8)]);
            }
        }
    }

    fn playback(&self, icon: Icon) {
        let fill = |points: &[(f32, f32)]| {
            let (places, color) = (self.places(points), self.stroke.color);
            let shape = Shape::convex_polygon(places, color, Stroke::NONE);
            self.painter.add(shape);
        };
        match icon {
            Icon::Play => fill(&[(-4.0, -6.0), (6.0, 0.0), (-4.0, 6.0)]),
            Icon::Pause => {
                fill(&[(-5.0, -5.5), (-1.8, -5.5), (-1.8, 5.5), (-5.0, 5.5)]);
                fill(&[(1.8, -5.5), (5.0, -5.5), (5.0, 5.5), (1.8, 5.5)]);
            }
            Icon::Loop => {
                self.line(&[
                    (2.5, -4.5),
                    (-6.5, -4.5),
                    (-6.5, 4.5),
                    (6.5, 4.5),
                    (6.5, -1.0),
                ]);
                fill(&[(2.0, -7.5), (6.5, -4.5), (2.0, -1.5)]);
            }
            _ => {
                self.line(&[(-4.5, 7.0), (-4.5, -6.5)]);
                fill(&[(-4.5, -6.5), (6.0, -3.2), (-4.5, 0.5)]);
            }
        }
    }

    fn frame(&self, icon: Icon) {
        match icon {
            Icon::More => [-4.5, 0.0, 4.5].iter().for_each(|&x| self.dot(x, 0.0, 1.5)),
            Icon::Grip => {
                for x in [-2.2, 2.2] {
                    [-4.5, 0.0, 4.5].iter().for_each(|&y| self.dot(x, y, 1.2));
                }
            }
            Icon::Maximise => self.frame_of(0.0, 0.0, Vec2::new(5.5, 4.8)),
            _ => {
                self.frame_of(-1.2, 1.2, Vec2::splat(4.2));
                self.line(&[(-3.0, -5.0), (5.2, -5.0), (5.2, 3.0)]);
            }
        }
    }
}
