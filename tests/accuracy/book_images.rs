//! The screenshots of the book, made by the window itself on the projects of the tutorials.
//!
//! With `OSTRA_UPDATE_BOOK` set they are written to `docs/book/src/images`; otherwise each of them
//! is only drawn.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Duration;

use egui::{Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};
use glam::{DVec2, Vec3};
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, RgbImage};
use ostra_app::{Dialog, Panes, Prefs, Shell, Shown, ViewState, Window};
use ostra_cloud::measure::LengthUnit;
use ostra_masks::LabelId;
use ostra_session::{Command, Recent};
use ostra_view::Coloring;

use crate::book_pages::commands;
use crate::networks::{self, Needs};
use crate::tutorials;

const SIZE: Vec2 = Vec2::new(1280.0, 800.0);
const QUALITY: u8 = 88;

/// The window on a project.
struct Stage {
    harness: Harness<'static, Option<Window>>,
}

impl Stage {
    fn open(project: Option<&Path>) -> Self {
        let gpu = create_render_state(
            default_wgpu_setup(),
            egui_wgpu::RendererOptions::PREDICTABLE,
        );
        let renderer = WgpuTestRenderer::from_render_state(gpu.clone());
        let harness = Harness::builder()
            .with_size(SIZE)
            .with_theme(egui::Theme::Dark)
            .with_context_setup(ostra_app::set_theme)
            .renderer(renderer)
            .build_ui_state(
                move |ui, window: &mut Option<Window>| {
                    let window = window.get_or_insert_with(|| {
                        let shell = Shell::new(Prefs::default(), Some(&gpu));
                        Window::with(shell, Recent::default(), ui.ctx())
                    });
                    window.poll(ui.ctx());
                    window.show(ui);
                },
                None,
            );
        let mut stage = Self { harness };
        stage.harness.run_steps(2);
        if let Some(project) = project {
            stage.window().act(Command::Open(project.to_owned()));
            stage.settle();
        }
        stage
    }

    fn window(&mut self) -> &mut Window {
        self.harness.state_mut().as_mut().unwrap()
    }

    fn view(&mut self) -> &mut ViewState {
        &mut self.window().shell().view
    }

    /// Runs the window until no job runs and what it computes in the background is drawn.
    fn settle(&mut self) {
        let mut calm = 0;
        while calm < 80 {
            self.harness.run_steps(1);
            std::thread::park_timeout(Duration::from_millis(10));
            let is_busy = !self.window().session().jobs().is_empty();
            calm = if is_busy { 0 } else { calm + 1 };
        }
    }

    /// Shows the image alone, the 3-D view alone or both, and a frame.
    fn show(&mut self, panes: Panes, frame: usize) {
        let view = self.view();
        view.prefs.panes = panes;
        view.frame = frame;
        view.coloring = Coloring::Label;
        self.settle();
    }

    fn press(&mut self, modifiers: Modifiers, key: Key) {
        self.harness.key_press_modifiers(modifiers, key);
        self.harness.run_steps(2);
    }

    /// Returns the place of an image position on the screen while the image fits its pane.
    fn on_screen(&mut self, x: f32, y: f32) -> Pos2 {
        let frame = self.view().frame;
        let project = self.window().session().project().unwrap();
        let frame = &project.frames[frame];
        let size = Vec2::new(frame.width as f32, frame.height as f32);
        let name = format!("Image {}", frame.name);
        let pane = self.harness.get_by_label(&name).rect();
        let free = pane.size() - Vec2::splat(20.0);
        let scale = (free.x / size.x).min(free.y / size.y);
        pane.center() + (Vec2::new(x, y) - size / 2.0) * scale
    }

    fn type_into(&mut self, label: &str, text: &str) {
        self.harness.get_by_label(label).focus();
        self.harness.run_steps(1);
        self.harness.event(egui::Event::Text(text.into()));
        self.harness.run_steps(2);
    }

    fn button(&mut self, pos: Pos2, pressed: bool) {
        self.harness.hover_at(pos);
        self.harness.run_steps(1);
        self.harness.event(egui::Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        });
        self.harness.run_steps(2);
    }

    /// Clicks and waits long enough that the next click is not the second of a double click.
    fn click(&mut self, pos: Pos2) {
        self.button(pos, true);
        self.button(pos, false);
        self.harness.run_steps(40);
    }

    /// Drags through some places and holds the button at the last one.
    fn hold(&mut self, places: &[Pos2]) {
        self.button(places[0], true);
        for &place in &places[1..] {
            self.harness.hover_at(place);
            self.harness.run_steps(2);
        }
    }

    /// Draws the window, checks that it is not blank, and writes it into the book if asked.
    fn save(&mut self, name: &str) {
        self.harness.run_steps(4);
        let drawn = DynamicImage::from(self.harness.render().unwrap()).to_rgb8();
        check_and_write(&drawn, name);
    }
}

/// Checks that an image is not blank, and writes it into the book if asked.
fn check_and_write(drawn: &RgbImage, name: &str) {
    let first = drawn.get_pixel(0, 0);
    let others = drawn.pixels().filter(|pixel| *pixel != first).count();
    assert!(others * 10 > drawn.pixels().len(), "{name} is blank");
    if std::env::var_os("OSTRA_UPDATE_BOOK").is_some() {
        write(drawn, name);
    }
}

fn write(drawn: &RgbImage, name: &str) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book/src/images");
    fs::create_dir_all(&folder).unwrap();
    let file = File::create(folder.join(format!("{name}.jpg"))).unwrap();
    let encoder = JpegEncoder::new_with_quality(BufWriter::new(file), QUALITY);
    drawn.write_with_encoder(encoder).unwrap();
}

/// Returns a copy of a project that a screenshot may change.
fn copy(project: &Path) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("plant");
    tutorials::copy(project, &target);
    (folder, target)
}

fn pages_on_labelling_and_3d() {
    let (_folder, project) = copy(&tutorials::rgbd().join("plant"));
    let mut stage = Stage::open(Some(&project));
    stage.view().label = Some(LabelId(1));
    stage.show(Panes::Both, 6);
    stage.save("window");
    stage.show(Panes::Image, 6);
    stage.save("clicks");

    stage.press(Modifiers::NONE, Key::W);
    for (x, y) in [(240.0, 470.0), (262.0, 330.0), (285.0, 200.0)] {
        let at = stage.on_screen(x, y);
        stage.click(at);
    }
    stage.settle();
    stage.save("stem");
    stage.press(Modifiers::NONE, Key::Escape);

    stage.show(Panes::Scene, 6);
    stage.save("cloud");
    stage.view().shown = Shown::Mesh;
    stage.settle();
    stage.save("mesh");
    stage.view().shown = Shown::Points;
    stage.view().prefs.links = true;
    stage.settle();
    stage.save("links");
    stage.view().prefs.links = false;

    stage.press(Modifiers::SHIFT, Key::S);
    let middle = stage.harness.get_by_label("3-D view").rect().center();
    let around = (0..=24).map(|step| {
        let angle = std::f32::consts::TAU * step as f32 / 24.0;
        middle + Vec2::new(70.0 * angle.cos(), 90.0 * angle.sin() - 120.0)
    });
    let around: Vec<Pos2> = around.collect();
    stage.hold(&around);
    stage.button(around[24], false);
    stage.settle();
    stage.save("select-3d");
    stage.press(Modifiers::NONE, Key::Escape);
    stage.press(Modifiers::NONE, Key::Escape);

    stage.press(Modifiers::NONE, Key::F8);
    stage.settle();
    stage.save("traits");
    stage.press(Modifiers::NONE, Key::F8);

    for (dialog, name) in [(Dialog::Export, "export"), (Dialog::Models, "networks")] {
        stage.view().dialog = Some(dialog);
        stage.settle();
        if dialog == Dialog::Export {
            stage.harness.get_by_label("Export folder").focus();
            stage.press(Modifiers::COMMAND, Key::A);
            stage.type_into("Export folder", "/results/plant");
        }
        stage.save(name);
        stage.view().dialog = None;
    }
}

fn pages_on_conflicts_and_borders() {
    let (_folder, project) = copy(&tutorials::rgbd().join("plant"));
    let mut stage = Stage::open(Some(&project));
    stage.view().label = Some(LabelId(1));
    let worst = {
        let conflicts = stage.window().session().conflicts();
        let share = |conflict: &ostra_cloud::conflicts::FrameConflict| conflict.share();
        let worst = conflicts
            .iter()
            .max_by(|a, b| share(a.1).total_cmp(&share(b.1)));
        worst.map_or(0, |(frame, _)| *frame)
    };
    stage.show(Panes::Both, worst);
    stage.save("conflicts");

    stage.show(Panes::Image, 6);
    stage.press(Modifiers::SHIFT, Key::G);
    let places = [(209.0, 560.0), (195.0, 556.0), (182.0, 552.0)];
    stage.view().label = Some(LabelId(2));
    let places = places.map(|(x, y)| stage.on_screen(x, y));
    stage.hold(&places);
    stage.save("move-border");
    stage.button(places[2], false);
}

fn pages_on_videos() {
    let (_folder, project) = copy(&tutorials::video().join("walk"));
    let mut stage = Stage::open(Some(&project));
    stage.view().label = Some(LabelId(1));
    stage.show(Panes::Image, 0);
    stage.save("video-clicks");
    stage.show(Panes::Image, 20);
    stage.save("keyframes");
    stage.show(Panes::Image, 30);
    stage.save("track");
}

fn pages_on_photos() {
    let folder = tempfile::tempdir().unwrap();
    let recording = tutorials::rgbd().join("example/recording/color");
    let recording = recording.display();
    for line in [
        format!("ostra new plant --frames {recording}"),
        "ostra reconstruct plant --method sfm".to_owned(),
    ] {
        tutorials::run(&line, folder.path());
    }
    let mut stage = Stage::open(Some(&folder.path().join("plant")));
    stage.show(Panes::Both, 6);
    stage.save("cameras");
    stage.press(Modifiers::NONE, Key::F6);
    stage.settle();
    stage.save("matches");
    stage.press(Modifiers::NONE, Key::F6);
    stage.view().dialog = Some(Dialog::NewProject);
    stage.settle();
    // A short path that looks like that of a user.
    let photos = std::env::temp_dir().join("photos/rice");
    tutorials::copy(&tutorials::rgbd().join("example/recording/color"), &photos);
    stage.type_into("Frames", photos.to_str().unwrap());
    for _ in 0..6000 {
        if stage.harness.query_by_label_contains("16 images").is_some() {
            break;
        }
        stage.harness.run_steps(1);
        std::thread::park_timeout(Duration::from_millis(10));
    }
    stage.harness.get_by_label_contains("16 images");
    stage.settle();
    stage.save("new-project");
    drop(stage);
    std::fs::remove_dir_all(photos).unwrap();
    for line in [
        "ostra reconstruct plant --method mvs --max-side 320",
        "ostra fuse plant",
    ] {
        tutorials::run(line, folder.path());
    }
    page_on_scale(&folder.path().join("plant"));
}

/// Measures the upper edge of a poster, whose ends the tutorial on photos gives as pixels.
fn page_on_scale(project: &Path) {
    const FRAME: usize = 6;
    const ENDS_PX: [(f64, f64); 2] = [(34.0, 352.0), (148.0, 348.0)];
    let mut stage = Stage::open(Some(project));
    stage.show(Panes::Scene, FRAME);
    stage.view().coloring = Coloring::Rgb;
    stage.press(Modifiers::NONE, Key::L);
    stage.harness.get_by_label("Ruler").click();
    stage.harness.run_steps(2);
    let session = stage.window().session();
    let (camera, pose) = session.project().unwrap().frames[FRAME]
        .posed_camera()
        .unwrap();
    let positions = &session.cloud().unwrap().positions;
    let ends = ENDS_PX.map(|(x, y)| {
        let off_px = |point: Vec3| {
            let at_px = camera.project(pose.transform(point.as_dvec3()));
            at_px.map_or(f64::INFINITY, |at_px| at_px.distance(DVec2::new(x, y)))
        };
        let nearest = positions
            .iter()
            .min_by(|a, b| off_px(**a).total_cmp(&off_px(**b)));
        *nearest.unwrap()
    });
    let ruler = &mut stage.view().ruler;
    for end in ends {
        ruler.click(end);
    }
    (ruler.length, ruler.length_unit) = (234.0, LengthUnit::Millimetre);
    stage.settle();
    stage.harness.get_by_label("Set scale");
    stage.save("scale");
}

fn pages_on_the_demo() {
    let (_folder, project) = copy(&tutorials::rgbd().join("example/project"));
    let mut stage = Stage::open(Some(&project));
    stage.show(Panes::Scene, 6);
    stage.save("instances");
    stage.view().shown = Shown::Voxels;
    stage.settle();
    stage.save("voxels");
    let file = stage.harness.get_by_label("File");
    file.click();
    stage.harness.run_steps(3);
    stage
        .harness
        .get_by_label_contains("Save history as recipe…")
        .click();
    stage.harness.run_steps(3);
    stage.type_into("Recipe file", "/recipes/rice.json");
    stage.save("recipes");
    let mut empty = Stage::open(None);
    empty.save("welcome");
}

/// Fuses and draws the project of the demo with the commands of the page.
fn page_on_servers() {
    let (folder, _) = copy(&tutorials::example().join("example/project"));
    let page =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book/src/how-to/headless-servers.md");
    let lines = commands(&fs::read_to_string(page).unwrap());
    for start in ["ostra fuse plant", "ostra shot plant plant.png"] {
        let line = lines.iter().find(|line| line.starts_with(start));
        tutorials::run(line.expect(start), folder.path());
    }
    let drawn = image::open(folder.path().join("plant.png")).unwrap();
    check_and_write(&drawn.to_rgb8(), "headless-servers");
}

/// Names the project in the process that has the network in its data folder.
const PROJECT: &str = "OSTRA_BOOK_PROJECT";

/// Finds bananas in a photo, in another process of this test: the data folder is that of a process.
fn page_on_text_prompts() {
    if let Some(project) = std::env::var_os(PROJECT) {
        let mut stage = Stage::open(Some(Path::new(&project)));
        stage.show(Panes::Image, 3);
        stage.type_into("Text to find", "banana; cup");
        stage.harness.get_by_label("Find").click();
        stage.settle();
        stage.harness.get_by_label("Minimum score");
        stage.save("text-prompts");
        return;
    }
    let needs = Needs::of("banana");
    let folder = tempfile::tempdir().unwrap();
    let network = needs.networks.join("yolox_nano.onnx");
    let project = folder.path().join("bananas");
    let frames = needs.set.join("images");
    let words = |words: &[&str], path: &Path| {
        let words = words.iter().map(OsString::from);
        words.chain([path.into()]).collect::<Vec<OsString>>()
    };
    let mut new = words(&["new"], &project);
    new.extend(words(&["--frames"], &frames));
    for args in [words(&["models", "add", "yolox"], &network), new] {
        let (code, _, text) = networks::ostra(folder.path(), Some(&needs.runtime), &args);
        assert_eq!(code, Some(0), "{args:?}: {text}");
    }
    let status = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "book_images::page_on_text_prompts"])
        .env("XDG_DATA_HOME", folder.path())
        .env(PROJECT, &project)
        .status();
    assert!(status.unwrap().success());
}

/// Clicks the pot on a photo, in another process of this test, in whose data folder is no network.
fn page_on_networks() {
    if let Some(project) = std::env::var_os(PROJECT) {
        let mut stage = Stage::open(Some(Path::new(&project)));
        stage.show(Panes::Image, 6);
        let pot = stage.on_screen(240.0, 615.0);
        stage.click(pot);
        stage.settle();
        stage
            .harness
            .get_by_label_contains("MobileSAM (45 MB, Apache-2.0)");
        stage.save("network-offer");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let example = tutorials::example().join("example/recording/color");
    tutorials::copy(&example, &folder.path().join("color"));
    for line in ["ostra new plant --frames color", "ostra label plant pot"] {
        tutorials::run(line, folder.path());
    }
    let status = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "book_images::page_on_networks"])
        .env("XDG_DATA_HOME", folder.path().join("data"))
        .env_remove("OSTRA_NETWORKS")
        .env(PROJECT, folder.path().join("plant"))
        .status();
    assert!(status.unwrap().success());
}

crate::registry::tests! {
    Nothing => page_on_networks;
    Nothing => pages_on_labelling_and_3d, pages_on_conflicts_and_borders, pages_on_photos;
    Nothing => pages_on_the_demo, page_on_servers;
    Networks(&["banana"]) => page_on_text_prompts;
    Ffmpeg => pages_on_videos;
}
