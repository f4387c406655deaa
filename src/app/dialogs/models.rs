use ostra_session::JobTask;

use egui::{Button, ComboBox, ProgressBar, ScrollArea, Ui};

use super::picker::{FileKind, PathField, Pick, PickTarget, path_field_ui, typed_path};
use crate::panels::progress_text;
use crate::tooltips::{add_explained, modal};
use crate::{SessionView, ViewState};
use ostra_compute::nn::{ModelStatus, Provider, TestResult, VariantStatus};
use ostra_session::{Command, InstallRequest, JobView, ModelRequest, ModelTask};

/// Draws the list of known networks with their purpose, state and installation.
pub(crate) fn models_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let response = modal(ui, "models", 760.0, |ui| {
        ui.horizontal(|ui| {
            ui.heading("Networks");
            ui.weak("Optional models that improve individual steps");
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if ui
                    .button("Close")
                    .on_hover_text("Close the list (Esc); downloads go on")
                    .clicked()
                {
                    view.dialog = None;
                }
                provider_ui(ui, view);
                ui.label("Run on");
            });
        });
        ui.add_space(6.0);
        let height = (ui.ctx().content_rect().height() - 150.0).max(200.0);
        ScrollArea::vertical()
            .max_height(height)
            .min_scrolled_height(height)
            .auto_shrink([false, true])
            .show(ui, |ui| {
                for row in session.models {
                    ui.separator();
                    row_ui(ui, session, view, row, out);
                }
            });
    });
    if response.should_close() {
        view.dialog = None;
    }
}

/// Draws the choice of the device that runs networks.
pub(super) fn provider_ui(ui: &mut Ui, view: &mut ViewState) {
    let chosen = Provider::chosen();
    let tip = "What networks run on that are loaded from now on; where it does not start, the processor does it";
    let choice = ComboBox::from_id_salt("provider")
        .selected_text(text(chosen))
        .width(110.0)
        .show_ui(ui, |ui| {
            for provider in Provider::ALL {
                if ui
                    .selectable_label(provider == chosen, text(provider))
                    .clicked()
                {
                    provider.choose();
                    view.prefs.provider = provider;
                }
            }
        });
    choice
        .response
        .on_hover_text(tip)
        .accessible_name("Run networks on");
}

fn text(provider: Provider) -> &'static str {
    match provider {
        Provider::Cpu => "Processor",
        Provider::Cuda => "CUDA",
        Provider::TensorRt => "TensorRT",
        Provider::CoreMl => "CoreML",
        Provider::DirectMl => "DirectML",
    }
}

fn row_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    row: &ModelStatus,
    out: &mut Vec<Command>,
) {
    ui.horizontal(|ui| {
        let name = ui.strong(&row.name).rect.width();
        ui.add_space((130.0 - name).max(0.0));
        state_ui(ui, row);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let job = job_of(session, &row.name);
            match job {
                Some(job) => running_ui(ui, job),
                None => buttons_ui(ui, view, row, out),
            }
        });
    });
    ui.weak(format!("{}. Licence: {}", row.purpose, row.licence));
    if view.models.adding.as_ref() == Some(&row.name) {
        adding_ui(ui, view, row, out);
    }
    if view.models.accepting.as_ref() == Some(&row.name) {
        accepting_ui(ui, view, row, out);
    }
    if view.models.removing.as_ref() == Some(&row.name) {
        removing_ui(ui, view, row, out);
    }
}

/// Asks before files are deleted that cannot be downloaded again.
fn removing_ui(ui: &mut Ui, view: &mut ViewState, row: &ModelStatus, out: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        ui.label("These files cannot be downloaded again.");
        let remove = ui
            .button("Delete files")
            .on_hover_text("Delete the model files");
        let keep = ui.button("Keep").on_hover_text("Keep the model files");
        if remove.clicked() {
            out.push(Command::Model(ModelRequest {
                name: row.name.clone(),
                task: ModelTask::Remove,
            }));
        }
        if remove.clicked() || keep.clicked() {
            view.models.removing = None;
        }
    });
}

/// Shows whether a network is installed, its size and, on hover, its paths.
fn state_ui(ui: &mut Ui, row: &ModelStatus) {
    let Some(installed) = &row.installed else {
        let size = row
            .download_text()
            .map_or(String::new(), |size| format!(", {size}"));
        ui.weak(format!("not installed{size}"))
            .on_hover_text(format!("It comes from {}", row.source));
        return;
    };
    let paths: Vec<String> = installed
        .paths
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    let variant = row
        .installed_variant
        .as_ref()
        .map_or(String::new(), |variant| format!(" ({variant})"));
    ui.label(format!(
        "installed, {}{variant}",
        megabytes(installed.bytes)
    ))
    .on_hover_text(paths.join("\n"));
    match &row.tested {
        Some(TestResult::Passed) => {
            ui.weak("test passed");
        }
        Some(TestResult::Failed(what)) => {
            ui.colored_label(ui.visuals().warn_fg_color, "test failed, not used")
                .on_hover_text(what);
        }
        None => {}
    }
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

fn buttons_ui(ui: &mut Ui, view: &mut ViewState, row: &ModelStatus, out: &mut Vec<Command>) {
    let name = &row.name;
    let mut ask = |task| {
        out.push(Command::Model(ModelRequest {
            name: name.clone(),
            task,
        }));
    };
    let add = ui
        .button("Add…")
        .on_hover_text(format!("Add from files: {}", row.files.join(", ")));
    if add.accessible_name(format!("Add {name}")).clicked() {
        view.models.adding = if view.models.adding.as_ref() == Some(name) {
            None
        } else {
            Some(name.clone())
        };
        view.models.path.clear();
    }
    if row.installed.is_some() {
        let check = ui
            .button("Check")
            .on_hover_text("Check the model files and test the network");
        if check.accessible_name(format!("Check {name}")).clicked() {
            ask(ModelTask::Check);
        }
        let remove = ui.button("Remove").on_hover_text("Delete the model files");
        if remove.accessible_name(format!("Remove {name}")).clicked() {
            if row.has_address {
                ask(ModelTask::Remove);
            } else {
                view.models.removing = Some(name.clone());
            }
        }
    } else {
        install_ui(ui, view, row, out);
    }
}

/// Offers the download of a network, with a choice if it has several variants.
fn install_ui(ui: &mut Ui, view: &mut ViewState, row: &ModelStatus, out: &mut Vec<Command>) {
    let name = &row.name;
    let variant = chosen_variant(view, row);
    let size = variant
        .map_or_else(|| row.download_text(), VariantStatus::download_text)
        .map_or(String::new(), |size| format!(" {size}"));
    let tip = format!("Download{size} (licence: {})", row.licence);
    let reason = format!("Has no address to be fetched from; see {}", row.source);
    let reason = (!row.has_address).then_some(reason.as_str());
    let install = add_explained(ui, Button::new("Install"), &tip, reason);
    if install.accessible_name(format!("Install {name}")).clicked() {
        if row.licence_to_accept.is_some() {
            view.models.accepting = Some(name.clone());
        } else {
            out.push(install_command(row, variant, false));
        }
    }
    if row.variants.len() < 2 {
        return;
    }
    let shown = variant.map_or("", |variant| variant.name.as_str());
    let choice = ComboBox::from_id_salt(("variant", name))
        .selected_text(shown)
        .width(90.0)
        .show_ui(ui, |ui| {
            for variant in &row.variants {
                let chosen = ui
                    .selectable_label(variant.name == shown, &variant.name)
                    .on_hover_text(variant_text(variant));
                if chosen.clicked() {
                    let variants = &mut view.models.variants;
                    variants.insert(name.clone(), variant.name.clone());
                }
            }
        });
    let tip = variant.map_or(String::new(), variant_text);
    choice
        .response
        .on_hover_text(tip)
        .accessible_name(format!("Variant of {name}"));
}

/// Returns the variant to download: the chosen one, or the recommended one.
fn chosen_variant<'a>(view: &ViewState, row: &'a ModelStatus) -> Option<&'a VariantStatus> {
    let chosen = view.models.variants.get(&row.name);
    let is_chosen = |variant: &&VariantStatus| Some(&variant.name) == chosen;
    let variants = &row.variants;
    variants.iter().find(is_chosen).or(variants.first())
}

fn install_command(
    row: &ModelStatus,
    variant: Option<&VariantStatus>,
    accept_licence: bool,
) -> Command {
    Command::Model(ModelRequest {
        name: row.name.clone(),
        task: ModelTask::Install(InstallRequest {
            variant: variant.map(|variant| variant.name.clone()),
            accept_licence,
        }),
    })
}

fn variant_text(variant: &VariantStatus) -> String {
    let size = variant.download_text();
    let memory = variant
        .memory_mb
        .map(|mb| format!("about {mb} MB of memory"));
    let facts: Vec<String> = [Some(variant.summary.clone()), size, memory]
        .into_iter()
        .flatten()
        .collect();
    facts.join(", ")
}

/// Shows the licence that has to be accepted before a download.
fn accepting_ui(ui: &mut Ui, view: &mut ViewState, row: &ModelStatus, out: &mut Vec<Command>) {
    let Some(address) = &row.licence_to_accept else {
        view.models.accepting = None;
        return;
    };
    ui.horizontal(|ui| {
        ui.label(format!("Read the licence {}:", row.licence));
        ui.hyperlink(address);
        let accept = ui
            .button("Accept and install")
            .on_hover_text("Accept the licence and download the network");
        if accept.clicked() {
            out.push(install_command(row, chosen_variant(view, row), true));
            view.models.accepting = None;
        }
        if ui
            .button("Cancel")
            .on_hover_text("Do not install the network")
            .clicked()
        {
            view.models.accepting = None;
        }
    });
}

fn running_ui(ui: &mut Ui, job: &JobView) {
    let fraction = job.overview.fraction;
    let bar = ProgressBar::new(fraction.unwrap_or(0.0) as f32)
        .desired_width(110.0)
        .desired_height(6.0)
        .animate(fraction.is_none());
    ui.add(bar)
        .accessible_name(format!("Progress of {}", job.title));
    ui.weak(progress_text(job));
}

/// Asks for the files of a network, or for the folder that contains them.
fn adding_ui(ui: &mut Ui, view: &mut ViewState, row: &ModelStatus, out: &mut Vec<Command>) {
    let (hint, pick) = match row.files.as_slice() {
        [_] => ("its file", Pick::File(FileKind::NETWORK)),
        _ => ("folder that holds them", Pick::Folder),
    };
    ui.weak(format!("From {}", row.source));
    ui.weak(format!("Files: {}", row.files.join(", ")));
    ui.horizontal(|ui| {
        let form = &mut view.models;
        let field = PathField {
            name: "Network files",
            hint,
            pick,
            target: PickTarget::Network,
        };
        path_field_ui(ui, &mut view.picker, &field, &mut form.path);
        let path = typed_path(&form.path);
        let reason = path.is_none().then_some("Enter or choose a path first");
        let tip = "Check the files and copy them";
        let add = add_explained(ui, Button::new("Add files"), tip, reason);
        if let Some(path) = path.filter(|_| add.clicked()) {
            let task = ModelTask::Add(vec![path]);
            out.push(Command::Model(ModelRequest {
                name: row.name.clone(),
                task,
            }));
            view.models.adding = None;
            view.models.path.clear();
        }
    });
}

/// Returns the running job of a network.
fn job_of<'a>(session: &'a SessionView<'a>, name: &str) -> Option<&'a JobView> {
    session.running(&JobTask::Network(name.to_owned()))
}
