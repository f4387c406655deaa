use std::sync::Arc;

use egui::{Color32, Pos2, Rect, Sense, Stroke, Ui, Vec2};
use glam::{DVec2, Vec3};

use super::asked_place::AskedPlace;
use crate::{Look, Panes, ViewState};
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::{Voter, Votes};
use ostra_masks::{LabelId, LabelTree};
use ostra_view::ViewCamera;

const COLOR: Color32 = Color32::from_rgb(255, 235, 90);
/// Length of an arm of the cross in the 3-D view, in points of the screen, and the gap around the point itself.
const ARM: f32 = 14.0;
const GAP: f32 = 4.0;
/// Of the window that tells of the point.
const WIDTH: f32 = 180.0;
/// Pixels between a place in a picture and a point that is seen there.
const NEAR_PX: f64 = 3.0;

/// A point of the cloud that the user asked about, and who voted on it.
#[derive(Debug, Clone)]
pub struct Asked {
    cloud: Arc<LabelledCloud>,
    point: usize,
    votes: Vec<(LabelId, u16)>,
    voters: Vec<Voter>,
}

impl Asked {
    /// Asks about a point by its number.
    #[must_use]
    pub fn new(cloud: &Arc<LabelledCloud>, votes: Option<&Arc<Votes>>, point: usize) -> Self {
        let histogram = votes
            .map(|votes| votes.histogram(point).to_vec())
            .unwrap_or_default();
        let mut voters = votes.map(|votes| votes.voters(point)).unwrap_or_default();
        // Who contradicts is what the user looks for; frames without a mask have nothing to say.
        voters.sort_by_key(|voter| match voter.label {
            Some(label) if label != cloud.labels[point] => 0,
            Some(_) => 1,
            None => 2,
        });
        Self {
            cloud: Arc::clone(cloud),
            point,
            votes: histogram,
            voters,
        }
    }

    /// Asks about the point that a frame sees nearest to a place in its picture.
    #[must_use]
    pub fn seen_at(
        cloud: &Arc<LabelledCloud>,
        votes: &Arc<Votes>,
        frame: usize,
        at_px: DVec2,
    ) -> Option<Self> {
        let off = |x: u32, y: u32| middle(x, y).distance_squared(at_px);
        let near = votes
            .sightings(frame)
            .filter(|&(_, x, y)| off(x, y) <= NEAR_PX * NEAR_PX);
        let (point, ..) = near.min_by(|a, b| off(a.1, a.2).total_cmp(&off(b.1, b.2)))?;
        Some(Self::new(cloud, Some(votes), point))
    }

    /// Where it is, world units.
    #[must_use]
    pub fn place(&self) -> Vec3 {
        self.cloud.positions[self.point]
    }

    /// Where a frame sees it.
    #[must_use]
    pub fn seen_in(&self, frame: usize) -> Option<DVec2> {
        self.voters
            .iter()
            .find(|voter| voter.frame == frame)
            .map(|voter| middle(voter.x, voter.y))
    }

    /// The same point of the cloud that is there now, with its votes of now; `None` where that has other points.
    #[must_use]
    pub fn on(self, cloud: &Arc<LabelledCloud>, votes: Option<&Arc<Votes>>) -> Option<Self> {
        if Arc::ptr_eq(cloud, &self.cloud) {
            return Some(self);
        }
        let same = cloud.len() == self.cloud.len() && cloud.positions[self.point] == self.place();
        same.then(|| Self::new(cloud, votes, self.point))
    }
}

fn middle(x: u32, y: u32) -> DVec2 {
    DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// A cross around the point asked about in the view that a camera gives, as large from near as from far, and seen before
/// anything light or dark. Where the middle of the cross is.
fn mark(ui: &Ui, rect: Rect, camera: &ViewCamera, asked: &Asked) -> Option<Pos2> {
    let (at, _) = camera.project(asked.place())?;
    let at = rect.min + Vec2::new(at.x, at.y) / ui.pixels_per_point();
    let painter = ui.painter().with_clip_rect(rect);
    for stroke in [Stroke::new(5.0, Color32::BLACK), Stroke::new(2.0, COLOR)] {
        for arm in [Vec2::X, Vec2::Y, -Vec2::X, -Vec2::Y] {
            painter.line_segment([at + GAP * arm, at + (GAP + ARM) * arm], stroke);
        }
    }
    Some(at)
}

/// A cross at the point asked about, and what is known of it in a corner of the 3-D view away from it: its label, who voted
/// what, and the way there.
pub(super) fn asked_ui(
    ui: &Ui,
    (rect, camera): (Rect, &ViewCamera),
    place: &mut AskedPlace,
    look: &Look<'_>,
    view: &mut ViewState,
) {
    view.asked = view
        .asked
        .take()
        .zip(look.cloud)
        .and_then(|(asked, cloud)| asked.on(cloud, look.votes));
    let Some(asked) = view.asked.clone() else {
        place.forget();
        return;
    };
    let at = mark(ui, rect, camera, &asked);
    let (mut open, mut to) = (true, None);
    // Small, so that much of the cloud stays in sight.
    let window = egui::Window::new(egui::RichText::new("Point").strong())
        .default_width(WIDTH)
        .resizable(false);
    let window = window
        .frame(egui::Frame::window(ui.style()).inner_margin(8))
        .open(&mut open);
    place
        .put(window, ui, rect, (asked.place(), at))
        .constrain_to(rect)
        .show(ui.ctx(), |ui| {
            let tree = if look.root.is_some() {
                &look.project.labels
            } else {
                &asked.cloud.tree
            };
            label_ui(ui, tree, asked.cloud.labels[asked.point]);
            let at = asked.place().as_dvec3() + asked.cloud.origin;
            ui.weak(format!("at {:.4}, {:.4}, {:.4}", at.x, at.y, at.z))
                .on_hover_text("World units");
            let confidence = asked.cloud.confidence[asked.point];
            ui.label(format!("{:.0} % of the votes", 100.0 * confidence));
            if asked.votes.is_empty() {
                ui.weak("No frame with a mask sees it.");
            }
            for &(label, votes) in &asked.votes {
                ui.horizontal(|ui| {
                    ui.monospace(format!("{votes:>4}"));
                    label_ui(ui, tree, label);
                });
            }
            if !asked.voters.is_empty() {
                ui.separator();
                egui::ScrollArea::vertical()
                    .max_height(100.0)
                    .auto_shrink([false, true])
                    .show(ui, |ui| {
                        for voter in &asked.voters {
                            ui.horizontal(|ui| {
                                let text = format!("frame {}", voter.frame);
                                let row = ui.selectable_label(view.frame == voter.frame, text);
                                if row
                                    .on_hover_text("Shows where this frame sees the point")
                                    .clicked()
                                {
                                    to = Some((voter.frame, middle(voter.x, voter.y)));
                                }
                                match voter.label {
                                    Some(label) => label_ui(ui, tree, label),
                                    None => drop(ui.weak("no mask")),
                                }
                            });
                        }
                    });
            }
        });
    if let Some((frame, at_px)) = to {
        view.go_to(frame);
        view.zoom.centre_px = at_px;
        if view.prefs.panes == Panes::Scene {
            view.prefs.panes = Panes::Both;
        }
    }
    if !open {
        view.asked = None;
    }
}

/// A label's path in its colour.
pub(super) fn label_ui(ui: &mut Ui, tree: &LabelTree, label: LabelId) {
    let Some(known) = tree.get(label) else {
        ui.weak(if label == LabelId::NONE {
            "nothing".to_owned()
        } else {
            format!("label {}", label.0)
        });
        return;
    };
    let names: Vec<&str> = tree
        .path(label)
        .iter()
        .filter_map(|&id| Some(tree.get(id)?.name.as_str()))
        .collect();
    let [r, g, b] = known.color;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let (patch, _) = ui.allocate_exact_size(Vec2::splat(10.0), Sense::hover());
        ui.painter()
            .rect_filled(patch, 2.0, Color32::from_rgb(r, g, b));
        ui.label(names.join(" › "));
    });
}
