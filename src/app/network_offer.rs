//! Offers to install a network where it would help, and what follows the installation.

use egui::{Color32, Context, TextStyle, Ui};
use ostra_compute::nn::{ModelStatus, Runtime};
use ostra_project::{EngineName, SegmenterId};
use ostra_session::{Command, EngineKind, InstallRequest, JobTask, ModelRequest, ModelTask};

use crate::dialogs::Installation;
use crate::panels::progress_text;
use crate::{Dialog, SessionView, ViewState};

/// Library that runs all networks.
const LIBRARY: &str = "onnxruntime";

/// A network that is offered.
struct OfferedNetwork {
    /// Name in the list of networks.
    name: &'static str,
    title: &'static str,
    benefit: &'static str,
}

/// Network that is offered when a click was answered without one: small, fast, and with a licence
/// that permits everything.
const FOR_CLICKS: OfferedNetwork = OfferedNetwork {
    name: "mobile-sam",
    title: "MobileSAM",
    benefit: "better masks with fewer clicks",
};

/// Network that is offered for the search by text.
const FOR_TEXT: OfferedNetwork = OfferedNetwork {
    name: "grounding-dino",
    title: "Grounding DINO",
    benefit: "finds objects by their names",
};

/// Buttons of the offer for clicks.
const INSTALL: &str = "Install";
const NOT_NOW: &str = "Not now";
const NEVER: &str = "Never";

/// State of an installation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum InstallState {
    /// Nothing is being installed, or it failed.
    Idle,
    Running,
    /// The last network has just been installed.
    Finished,
}

impl Installation {
    /// Installs a network, after the library that runs it if that is missing.
    fn begin(
        &mut self,
        network: &'static str,
        ctx: &Context,
        session: &SessionView<'_>,
        out: &mut Vec<Command>,
    ) {
        let library = Runtime::find().is_err().then_some(LIBRARY);
        self.queue = library.into_iter().chain([network]).collect();
        self.install_next(ctx, session, out);
    }

    fn install_next(&mut self, ctx: &Context, session: &SessionView<'_>, out: &mut Vec<Command>) {
        self.asked_in = ctx.cumulative_frame_nr();
        let next = self.queue.first().and_then(|name| row(session, name));
        out.extend(next.map(|row| {
            let variant = row.variants.first().map(|variant| variant.name.clone());
            Command::Model(ModelRequest {
                name: row.name.clone(),
                task: ModelTask::Install(InstallRequest {
                    variant,
                    accept_licence: false,
                }),
            })
        }));
    }

    /// Follows the running installation, and begins that of the next network.
    ///
    /// An installation that failed has said why, and ends this one.
    fn follow(
        &mut self,
        ctx: &Context,
        session: &SessionView<'_>,
        out: &mut Vec<Command>,
    ) -> InstallState {
        let Some(&name) = self.queue.first() else {
            return InstallState::Idle;
        };
        let is_running = session.running(&JobTask::Network(name.into())).is_some();
        if is_running || ctx.cumulative_frame_nr() <= self.asked_in {
            return InstallState::Running;
        }
        if row(session, name).is_none_or(|row| row.installed.is_none()) {
            self.queue.clear();
            return InstallState::Idle;
        }
        self.queue.remove(0);
        if self.queue.is_empty() {
            return InstallState::Finished;
        }
        self.install_next(ctx, session, out);
        InstallState::Running
    }

    /// Returns what is being installed and how far it is.
    fn progress(&self, session: &SessionView<'_>) -> Option<String> {
        let name = self.queue.first()?;
        let mut offered = [FOR_CLICKS, FOR_TEXT].into_iter();
        let title = offered
            .find(|network| network.name == *name)
            .map_or("ONNX Runtime", |network| network.title);
        let job = session.running(&JobTask::Network((*name).into()));
        Some(match job {
            Some(job) => format!("Installing {title}: {}", progress_text(job)),
            None => format!("Installing {title}"),
        })
    }
}

fn row<'a>(session: &SessionView<'a>, name: &str) -> Option<&'a ModelStatus> {
    session.models.iter().find(|row| row.name == name)
}

/// Returns the row of a network that can be installed with one click.
fn available<'a>(session: &SessionView<'a>, network: &OfferedNetwork) -> Option<&'a ModelStatus> {
    let row = row(session, network.name)?;
    (row.has_address && row.installed.is_none()).then_some(row)
}

/// Returns the size of a download and the licence of a network.
fn facts(row: &ModelStatus) -> String {
    let whole = |bytes: u64| format!("{} MB, ", bytes.div_ceil(1_000_000));
    let about = row
        .about_bytes
        .map(|bytes| format!("about {}", whole(bytes)));
    let size = row.download_bytes.map(whole).or(about).unwrap_or_default();
    format!("{size}{}", row.licence)
}

/// Returns whether clicks are answered without a network although one could be used.
fn clicks_lack_a_network(session: &SessionView<'_>, view: &ViewState) -> bool {
    let has_network = session
        .engines_of(EngineKind::Segmenter)
        .any(|engine| engine.name == SegmenterId::Sam.name() && engine.installed);
    view.segmenter == SegmenterId::Auto && !has_network
}

/// What the offer for clicks shows.
pub(crate) enum ClickOffer {
    /// The network that can be installed.
    Offer(String),
    /// Progress of the installation.
    Installing(String),
    /// The network was installed just now; the last click should be answered again.
    Installed,
}

/// Follows the offer for clicks, and returns its state; `None` while nothing is offered.
pub(crate) fn click_offer(
    ctx: &Context,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) -> Option<ClickOffer> {
    let state = view.models.offers.for_clicks.follow(ctx, session, out);
    match state {
        InstallState::Running => {
            let text = view.models.offers.for_clicks.progress(session);
            return text.map(ClickOffer::Installing);
        }
        // A network that failed its test is not used.
        InstallState::Finished => {
            return (!clicks_lack_a_network(session, view)).then_some(ClickOffer::Installed);
        }
        InstallState::Idle => {}
    }
    let is_wanted = view.prefs.offer_networks
        && !view.models.offers.is_closed
        && session.last_prompt.is_some()
        && clicks_lack_a_network(session, view);
    let row = available(session, &FOR_CLICKS).filter(|_| is_wanted);
    let text = row.map(|row| {
        let OfferedNetwork { title, benefit, .. } = FOR_CLICKS;
        format!("{title} ({}): {benefit}", facts(row))
    });
    text.map(ClickOffer::Offer)
}

/// Draws the offer for clicks.
pub(crate) fn click_offer_ui(
    ui: &mut Ui,
    offer: &ClickOffer,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let text = match offer {
        ClickOffer::Offer(text) => text,
        ClickOffer::Installing(text) => {
            ui.horizontal_wrapped(|ui| {
                ui.spinner();
                ui.label(text);
            });
            return;
        }
        ClickOffer::Installed => return,
    };
    if fits_in_one_row(ui, text, &[INSTALL, NOT_NOW, NEVER]) {
        ui.horizontal(|ui| {
            ui.label(text);
            offer_buttons_ui(ui, session, view, out);
        });
    } else {
        ui.label(text);
        ui.horizontal(|ui| offer_buttons_ui(ui, session, view, out));
    }
}

/// Returns whether a text and buttons fit next to each other.
///
/// Wrapped, the last button would be alone in a row.
fn fits_in_one_row(ui: &Ui, text: &str, buttons: &[&str]) -> bool {
    let width = |text: &str, style: TextStyle| {
        let font = style.resolve(ui.style());
        let galley = ui
            .painter()
            .layout_no_wrap(text.to_owned(), font, Color32::PLACEHOLDER);
        galley.size().x
    };
    let spacing = ui.spacing();
    let around = spacing.item_spacing.x + 2.0 * spacing.button_padding.x;
    let buttons = buttons
        .iter()
        .map(|text| width(text, TextStyle::Button) + around);
    width(text, TextStyle::Body) + buttons.sum::<f32>() <= ui.available_width()
}

fn offer_buttons_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let install = ui
        .button(INSTALL)
        .on_hover_text("Download it in the background; the last click is answered again with it");
    if install.clicked() {
        install_or_ask(ui.ctx(), session, view, &FOR_CLICKS, out);
    }
    let later = ui
        .button(NOT_NOW)
        .on_hover_text("Ask again when the program is started the next time");
    if later.clicked() {
        view.models.offers.is_closed = true;
    }
    let never = ui
        .button(NEVER)
        .on_hover_text("Never offer networks; File › Networks and Preferences stay");
    if never.clicked() {
        view.prefs.offer_networks = false;
    }
}

/// Begins an installation, or shows the list of networks if a licence must be accepted first.
fn install_or_ask(
    ctx: &Context,
    session: &SessionView<'_>,
    view: &mut ViewState,
    network: &OfferedNetwork,
    out: &mut Vec<Command>,
) {
    if available(session, network).is_some_and(|row| row.licence_to_accept.is_some()) {
        view.dialog = Some(Dialog::Models);
        return;
    }
    let offers = &mut view.models.offers;
    let installation = if network.name == FOR_CLICKS.name {
        &mut offers.for_clicks
    } else {
        &mut offers.for_text
    };
    installation.begin(network.name, ctx, session, out);
}

/// Draws the offer of a network for the search by text, or the progress of its installation.
///
/// Returns `true` once it is installed.
pub(crate) fn text_offer_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) -> bool {
    match view.models.offers.for_text.follow(ui.ctx(), session, out) {
        InstallState::Finished => return true,
        InstallState::Running => {
            let text = view.models.offers.for_text.progress(session);
            ui.horizontal_wrapped(|ui| {
                ui.spinner();
                ui.weak(text.unwrap_or_default());
            });
            return false;
        }
        InstallState::Idle => {}
    }
    let has_grounder = session
        .engines_of(EngineKind::Grounder)
        .any(|engine| engine.installed);
    let is_wanted = view.prefs.offer_networks && !has_grounder;
    let Some(row) = available(session, &FOR_TEXT).filter(|_| is_wanted) else {
        return false;
    };
    let OfferedNetwork { title, benefit, .. } = FOR_TEXT;
    ui.horizontal_wrapped(|ui| {
        // The panel is narrow, and the heading above says what the search is for.
        ui.weak(format!("{title} ({})", facts(row)))
            .on_hover_text(format!("It {benefit}"));
        let install = ui
            .button("Install")
            .on_hover_text("Download it in the background; the text is searched for then");
        if install
            .accessible_name(format!("Install {title}"))
            .clicked()
        {
            install_or_ask(ui.ctx(), session, view, &FOR_TEXT, out);
        }
    });
    false
}
