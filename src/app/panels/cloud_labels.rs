use std::collections::BTreeMap;
use std::sync::Arc;

use egui::{RichText, Ui};

use super::fuse::grouped;
use super::labels::{eye_ui, listed};
use crate::tips::section_heading;
use crate::{Look, ViewState};
use ostra_cloud::LabelledCloud;
use ostra_masks::{LabelId, LabelTree};

/// Points per label, counted once for each cloud.
#[derive(Default)]
pub struct PointCounts {
    cloud: Option<Arc<LabelledCloud>>,
    counts: BTreeMap<LabelId, usize>,
}

impl PointCounts {
    /// Points that carry a label or one below it.
    pub(super) fn below(
        &mut self,
        cloud: &Arc<LabelledCloud>,
        tree: &LabelTree,
        id: LabelId,
    ) -> usize {
        let counts = self.of(cloud);
        let of = |id: &LabelId| counts.get(id).copied().unwrap_or(0);
        of(&id) + tree.descendants(id).iter().map(of).sum::<usize>()
    }

    fn of(&mut self, cloud: &Arc<LabelledCloud>) -> &BTreeMap<LabelId, usize> {
        if !self
            .cloud
            .as_ref()
            .is_some_and(|counted| Arc::ptr_eq(counted, cloud))
        {
            // A counter for every possible id: five million points are counted in milliseconds.
            let mut counters = vec![0; usize::from(u16::MAX) + 1];
            cloud
                .labels
                .iter()
                .for_each(|label| counters[usize::from(label.0)] += 1);
            let seen = counters
                .into_iter()
                .zip(0..=u16::MAX)
                .filter(|(count, _)| *count > 0);
            self.counts = seen.map(|(count, id)| (LabelId(id), count)).collect();
            self.cloud = Some(Arc::clone(cloud));
        }
        &self.counts
    }
}

/// The labels of a cloud that is inspected alone: how many points each has, shown or not.
pub(crate) fn cloud_labels_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState) {
    section_heading(ui, "Labels");
    let Some(cloud) = look.cloud else { return };
    let counts = view.point_counts.of(cloud).clone();
    let rows = listed(&cloud.tree);
    if rows.is_empty() {
        ui.weak("The file names no labels");
    }
    egui::ScrollArea::vertical()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            for (label, depth) in &rows {
                ui.horizontal(|ui| {
                    ui.add_space(*depth as f32 * 14.0);
                    let (rect, _) =
                        ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
                    let [r, g, b] = label.color;
                    ui.painter()
                        .rect_filled(rect, 3.0, egui::Color32::from_rgb(r, g, b));
                    ui.add(egui::Label::new(&label.name).truncate());
                    ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                        eye_ui(ui, view, label);
                        let points = counts.get(&label.id).copied().unwrap_or(0);
                        ui.label(RichText::new(grouped(points)).weak().size(11.0))
                            .on_hover_text("Points with this label");
                    });
                });
            }
            let unlabelled = counts.get(&LabelId::NONE).copied().unwrap_or(0);
            ui.weak(format!("{} points without a label", grouped(unlabelled)));
        });
}
