//! Opens every part of the window in dark and light mode.
//!
//! With `OSTRA_GALLERY=DIR`, an image of each part is written to that folder, in the size of
//! `OSTRA_GALLERY_SIZE` (such as `1280x800x2`: points and scale).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};
use ostra_app::{Dialog, HelpPage, NewProjectForm, Panes, Prefs, Severity, Shell};
use ostra_cloud::LabelledCloud;
use ostra_cloud::ply::read_ply;
use ostra_core::job::Progress;
use ostra_frames::cameras::GivenCameras;
use ostra_frames::{FrameFolder, FrameStore, OpenRequest};
use ostra_masks::{Label, LabelId, LabelMask, LabelTree, RunMask};
use ostra_project::workflow::WorkflowStep;
use ostra_project::{FrameMask, MaskOrigin, Project};
use ostra_session::{FoundCameras, FoundDepth, Images, RecentProject, Survey};
use ostra_view::Coloring;

use crate::camera_models::with_models;
use crate::data::find_data;
use crate::desk::{Desk, image};

type Scene = (&'static str, fn() -> Desk, fn(&mut Desk));

const SCENES: [Scene; 24] = [
    ("shelf", shelf, |_| ()),
    ("shelf_labels", shelf, |desk| {
        desk.shell.view.coloring = Coloring::Label;
    }),
    ("shelf_alone", shelf, |desk| {
        desk.inspected = Some("/data/reference_labelled_cloud.ply".into());
        desk.project = Default::default();
        desk.root = None;
        desk.shell.view.coloring = Coloring::Label;
    }),
    ("welcome", Desk::empty, |desk| {
        welcome(desk);
    }),
    ("welcome_dragged", Desk::empty, |desk| {
        welcome(desk);
        desk.dragged = true;
    }),
    ("both", Desk::sample, |_| ()),
    ("models", with_models, |desk| {
        desk.shell.view.steps.open = Some(WorkflowStep::Geometry);
    }),
    ("picture", Desk::sample, |desk| {
        desk.shell.view.prefs.panes = Panes::Image;
    }),
    ("scene", Desk::sample, |desk| {
        desk.shell.view.prefs.panes = Panes::Scene;
        desk.shell.view.coloring = Coloring::Label;
    }),
    ("new_project", Desk::sample, |desk| {
        new_project(desk);
    }),
    ("welcome_small", Desk::empty, |desk| {
        welcome(desk);
        desk.size = egui::vec2(800.0, 600.0);
    }),
    ("new_project_small", Desk::sample, |desk| {
        new_project(desk);
        desk.size = egui::vec2(800.0, 600.0);
    }),
    ("guide", Desk::empty, |desk| {
        desk.shell.view.dialog = Some(Dialog::Help(HelpPage::Guide));
    }),
    ("about", Desk::empty, |desk| {
        desk.shell.view.dialog = Some(Dialog::Help(HelpPage::About));
    }),
    ("export", Desk::sample, |desk| {
        desk.shell.view.dialog = Some(Dialog::Export);
    }),
    ("exported", Desk::sample, |desk| {
        desk.shell.view.dialog = Some(Dialog::Exported);
        let item = |path: &str, files, bytes| ostra_session::ExportedItem {
            path: path.into(),
            files,
            bytes,
        };
        desk.shell.view.exported = vec![
            item("/projects/tiller-export/cloud.ply", None, 48_200_000),
            item("/projects/tiller-export/traits.csv", None, 5_321),
            item("/projects/tiller-export/masks", Some(17), 812_000),
        ];
    }),
    ("ruler", Desk::sample, |desk| {
        desk.unit = ostra_cloud::measure::LengthUnit::World;
        let ruler = &mut desk.shell.view.ruler;
        ruler.start();
        ruler.points = vec![
            glam::Vec3::new(-0.4, -0.4, 0.0),
            glam::Vec3::new(0.4, 0.2, 0.0),
        ];
        ruler.length = 20.0;
        let record = ostra_project::ResultRecord {
            coordinates: Some(ostra_project::Coordinates {
                world: 1,
                scale: 1.0,
                unit: ostra_cloud::measure::LengthUnit::World,
            }),
            ..Default::default()
        };
        let results = &mut desk.project.results;
        results.insert(ostra_project::ResultKind::Cameras, record);
    }),
    ("ruler_alone", Desk::sample, |desk| {
        desk.shell.view.prefs.panes = Panes::Scene;
        desk.shell.view.ruler.start();
        desk.shell.view.ruler.points = vec![
            glam::Vec3::new(-0.4, -0.4, 0.0),
            glam::Vec3::new(0.4, 0.2, 0.0),
            glam::Vec3::new(0.4, -0.4, 0.0),
        ];
    }),
    ("networks", Desk::sample, |desk| {
        desk.shell.view.dialog = Some(Dialog::Models);
    }),
    ("shortcuts", Desk::sample, |desk| {
        desk.shell.view.dialog = Some(Dialog::Shortcuts);
    }),
    ("palette", Desk::sample, |desk| {
        desk.shell.view.dialog = Some(Dialog::Palette);
    }),
    ("notices", Desk::sample, |desk| {
        let notices = &mut desk.shell.view.notices;
        notices.tell(
            Severity::Error,
            "/data/000012.png: cannot be read (No such file); check that it exists",
        );
        notices.tell(
            Severity::Warning,
            "3 frames have no depth and were left out: 000003, 000007, 000009",
        );
    }),
    ("notices_many", Desk::sample, |desk| {
        let notices = &mut desk.shell.view.notices;
        for frame in 430..438 {
            let text = format!(
                "DSC_0{frame}.jpg has no camera: no other image shows the same scene; take images between it and the others"
            );
            notices.tell(Severity::Warning, text);
        }
    }),
    ("confidence", Desk::sample, |desk| {
        desk.shell.view.prefs.panes = Panes::Scene;
        desk.shell.view.coloring = Coloring::Confidence;
    }),
];

/// Fills the first page: the example is offered, and one of three recent projects is missing.
fn welcome(desk: &mut Desk) {
    desk.shell.view.has_example = true;
    desk.size = egui::vec2(1280.0, 800.0);
    let roots = [
        "/home/me/rice-ostra",
        "/home/me/shelf",
        "/media/stick/maize-ostra",
    ];
    desk.recent = roots.map(PathBuf::from).to_vec();
    for (number, root) in roots[..2].iter().enumerate() {
        let state = RecentProject::Available {
            frames: 12,
            thumbnail: Some(Arc::new(image(number * 6))),
        };
        desk.recent_projects.insert(root.into(), state);
    }
    let missing = RecentProject::Unavailable("the folder is missing".into());
    desk.recent_projects.insert(roots[2].into(), missing);
}

/// Fills the form of a new project with a recording.
fn new_project(desk: &mut Desk) {
    desk.shell.view.dialog = Some(Dialog::NewProject);
    let form = NewProjectForm::with_paths(vec!["/data/shelf/color".into()]);
    desk.survey = Some(Arc::new(Survey {
        request: form.survey_request().unwrap(),
        sources: Vec::new(),
        frames: Arc::clone(&desk.project.frames),
        depth: Some(FoundDepth {
            frames: 11,
            folder: "/data/shelf/depth".into(),
        }),
        cameras: Some(FoundCameras {
            path: "/data/shelf/sparse".into(),
            frames: 12,
        }),
        intrinsics: None,
        root: Some("/data/shelf-ostra".into()),
        warnings: vec!["1 of 12 frames have no depth: 000007.png".into()],
        error: None,
    }));
    desk.shell.view.new_project = form;
    desk.size = egui::vec2(1280.0, 800.0);
}

#[test]
fn everything_opens_dark_and_light() {
    let keep = std::env::var_os("OSTRA_GALLERY").map(PathBuf::from);
    for (name, desk, change) in SCENES {
        for theme in [egui::Theme::Dark, egui::Theme::Light] {
            show(name, desk(), change, theme, keep.as_deref());
        }
    }
}

/// Returns the size in points and the scale of `OSTRA_GALLERY_SIZE`, such as `1280x800x2`.
fn size_wanted() -> (egui::Vec2, f32) {
    let text = std::env::var("OSTRA_GALLERY_SIZE").unwrap_or_default();
    let numbers: Vec<f32> = text
        .split('x')
        .filter_map(|number| number.parse().ok())
        .collect();
    match numbers[..] {
        [width, height, scale] => (egui::vec2(width, height), scale),
        [width, height] => (egui::vec2(width, height), 1.0),
        _ => (egui::vec2(1400.0, 900.0), 1.0),
    }
}

fn show(
    name: &str,
    mut desk: Desk,
    change: fn(&mut Desk),
    theme: egui::Theme,
    keep: Option<&Path>,
) {
    let mut builder = egui_kittest::Harness::builder()
        .with_theme(theme)
        .with_context_setup(ostra_app::set_theme);
    let (size, scale) = size_wanted();
    builder = builder.with_pixels_per_point(scale);
    if keep.is_some() {
        let gpu = create_render_state(
            default_wgpu_setup(),
            egui_wgpu::RendererOptions::PREDICTABLE,
        );
        desk.shell = Shell::new(Prefs::default(), Some(&gpu));
        builder = builder.renderer(WgpuTestRenderer::from_render_state(gpu));
    }
    change(&mut desk);
    let mut harness = desk.shown_at(builder, size);
    for _ in 0..if keep.is_some() { 80 } else { 6 } {
        harness.run_steps(1);
        std::thread::park_timeout(std::time::Duration::from_millis(10));
    }
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new(), "{name}");
    if let Some(dir) = keep {
        let theme = if theme == egui::Theme::Dark {
            "dark"
        } else {
            "light"
        };
        harness
            .render()
            .unwrap()
            .save(dir.join(format!("{name}_{theme}.png")))
            .unwrap();
    }
}

/// Returns the real shelf with its ground-truth masks, or the made-up project without data.
fn shelf() -> Desk {
    let mut desk = Desk::sample();
    let Ok(dir) = find_data().map(|dir| dir.join("apc_shelf_rgbd_labels")) else {
        return desk;
    };
    let (progress, depth) = (Progress::default(), Some(dir.join("depth")));
    let sources = vec![FrameFolder {
        frames: dir.join("color"),
        depth,
    }];
    let request = OpenRequest {
        sources,
        ..OpenRequest::default()
    };
    let mut frames = ostra_frames::open(&request, &progress).unwrap().frames;
    GivenCameras::read(&dir.join("sparse"))
        .unwrap()
        .match_to(&mut frames)
        .unwrap();
    let cloud = read_ply(&dir.join("reference_labelled_cloud.ply"), &progress)
        .unwrap()
        .cloud;
    desk.project = Project {
        frames: Arc::new(frames),
        labels: shelf_labels(),
        ..Project::default()
    };
    for number in 0..desk.project.frames.len() {
        let truth = image::open(dir.join(format!("labels/{number:06}.png")))
            .unwrap()
            .to_luma8();
        let ids = truth.iter().map(|&id| LabelId(u16::from(id))).collect();
        let mask = LabelMask {
            width: truth.width(),
            height: truth.height(),
            ids,
        };
        let origin = if number % 7 == 0 {
            MaskOrigin::Keyframe
        } else {
            MaskOrigin::Tracked
        };
        let runs = Arc::new(RunMask::encode(&mask));
        let mask = FrameMask {
            runs,
            origin,
            stale: number == 9,
            confidence: BTreeMap::new(),
        };
        desk.project.masks.insert(number, mask);
    }
    desk.cloud = Some(Arc::new(LabelledCloud {
        tree: shelf_labels(),
        ..cloud
    }));
    let store = Arc::new(FrameStore::new(100 << 20));
    desk.images = Images::of(Arc::clone(&desk.project.frames), store, || {});
    desk
}

fn shelf_labels() -> LabelTree {
    let mut tree = LabelTree::default();
    for (id, name) in [
        (1, "chenille stems"),
        (2, "bunny book"),
        (3, "tissue box"),
        (4, "joke book"),
    ] {
        let id = LabelId(id);
        tree.set(Label {
            id,
            name: name.into(),
            color: LabelTree::color_for(id),
            parent: None,
        })
        .unwrap();
    }
    tree
}
