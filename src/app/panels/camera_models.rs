//! The list of models that the images fall into.

use egui::{RadioButton, Ui};

use crate::SessionView;
use crate::tooltips::{grouped, section_heading};
use ostra_project::ResultKind;
use ostra_session::{Command, JobTask};

/// Long work, during which cameras stay as they are.
const LONG: [JobTask; 3] = [JobTask::Reconstruct, JobTask::Track, JobTask::Fuse];

/// Draws the models that the images fall into; a click uses another one. Nothing is drawn if there
/// is only one.
pub(super) fn camera_models_ui(ui: &mut Ui, session: &SessionView<'_>, out: &mut Vec<Command>) {
    let record = session.project.results.get(&ResultKind::Cameras);
    let Some(record) = record.filter(|record| record.models.len() > 1) else {
        return;
    };
    section_heading(ui, "Models");
    ui.weak("Nothing connects these groups of images.")
        .on_hover_text("Add images that show both places and reconstruct again to join models");
    let in_use = record.model_in_use();
    let is_busy = LONG.iter().any(|task| session.running(task).is_some());
    for (index, model) in record.models.iter().enumerate() {
        let (number, is_in_use) = (index + 1, in_use == Some(index));
        let text = format!(
            "Model {number}: {} images, {} points",
            model.frames,
            grouped(model.points)
        );
        let button = RadioButton::new(is_in_use, text);
        let tip = "Use the cameras of this model. Depth maps and the cloud of the other one become stale.";
        let response = ui
            .add_enabled(!is_busy, button)
            .on_hover_text(tip)
            .on_disabled_hover_text("Wait until the running work has ended, or stop it");
        if response.clicked() && !is_in_use {
            out.push(Command::SelectModel { model: number });
        }
    }
    if let Some(note) = cloud_note(session) {
        ui.label(note);
    }
}

/// Returns a note that the cloud belongs to a model that is not in use, if that is so.
fn cloud_note(session: &SessionView<'_>) -> Option<&'static str> {
    let world = session.project.coordinates().world;
    let is_of_other = session.cloud.is_some()
        && session.project.results.contains_key(&ResultKind::Cloud)
        && session
            .project
            .cloud_coordinates()
            .is_none_or(|cloud| cloud.world != world);
    is_of_other.then_some("The cloud is of another model. Reconstruct and fuse again.")
}
