//! Tests of the first page and the form of a new project with a real session behind them.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use egui::Key;
use egui_kittest::kittest::Queryable;
use ostra_core::job::Progress;
use ostra_eval::demo::make_example;
use ostra_eval::synthetic::SceneOptions;

use crate::story::{Shown, images, inner, until, window};

/// A file dropped on the window.
#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        fs::read(&self.0).map_err(|error| error.to_string())
    }
}

fn drop_files(harness: &mut Shown, paths: &[PathBuf]) {
    for path in paths {
        let file = Arc::new(Dropped(path.clone()));
        harness.input_mut().dropped_files.push(file);
    }
    harness.run_steps(3);
}

fn has(harness: &Shown, text: &str) -> bool {
    harness.query_all_by_label_contains(text).next().is_some()
}

#[test]
fn typed_folder_is_previewed_and_enter_creates_the_project() {
    let dir = tempfile::tempdir().unwrap();
    let photos = dir.path().join("plant/images");
    fs::create_dir_all(&photos).unwrap();
    images(&photos);
    let mut harness = window();
    harness.get_by_label("Photos of an object").click();
    harness.run_steps(3);
    harness.event(egui::Event::Text(photos.display().to_string()));
    until(&mut harness, "the images are counted", |harness| {
        has(harness, "3 images · 96 × 72 pixels")
    });
    harness.key_press(Key::Enter);
    until(&mut harness, "the project is open", |harness| {
        harness.query_by_label("Frame 2, no mask").is_some()
    });
    let root = inner(&mut harness).session().root().unwrap().to_owned();
    assert_eq!(root, dir.path().join("plant-ostra"));
    assert_eq!(inner(&mut harness).shell().view.dialog, None);
}

#[test]
fn form_stays_where_it_is_while_the_preview_fills_and_a_folder_is_typed() {
    let dir = tempfile::tempdir().unwrap();
    images(dir.path());
    let mut harness = window();
    harness.get_by_label("Photos of an object").click();
    harness.run_steps(4);
    let places = |harness: &Shown| {
        [
            "Create",
            "Cancel",
            "Choose folder…",
            "Browse Project folder",
        ]
        .map(|name| harness.get_by_label(name).rect())
    };
    let before = places(&harness);
    harness.event(egui::Event::Text(dir.path().display().to_string()));
    until(&mut harness, "the images are counted", |harness| {
        has(harness, "3 images")
    });
    harness.run_steps(4);
    let has_moved = |harness: &Shown| {
        let far = |(now, before): (egui::Rect, egui::Rect)| now.min.distance(before.min) > 0.5;
        places(harness).into_iter().zip(before).any(far)
    };
    assert!(!has_moved(&harness), "{:?}", places(&harness));
    harness
        .get_all_by_label("Project folder")
        .last()
        .unwrap()
        .focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text("plant".into()));
    harness.run_steps(4);
    assert!(!has_moved(&harness), "{:?}", places(&harness));
}

#[test]
fn error_keeps_the_form_filled() {
    let dir = tempfile::tempdir().unwrap();
    images(dir.path());
    let occupied = dir.path().join("occupied");
    fs::create_dir(&occupied).unwrap();
    fs::write(occupied.join("thesis.tex"), "").unwrap();
    let mut harness = window();
    drop_files(&mut harness, &[dir.path().to_owned()]);
    until(&mut harness, "the images are counted", |harness| {
        has(harness, "3 images")
    });
    harness
        .get_all_by_label("Project folder")
        .last()
        .unwrap()
        .focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text(occupied.display().to_string()));
    harness.run_steps(2);
    harness.get_by_label("Create").click();
    until(&mut harness, "the error is shown", |harness| {
        has(harness, "is not empty")
    });
    let frames = harness.get_by_label("Frames").value();
    assert_eq!(frames, Some(dir.path().display().to_string()));
    assert!(
        inner(&mut harness).shell().view.notices.shown().is_empty(),
        "it is shown in the form"
    );
    drop_files(&mut harness, &[dir.path().join("nothing")]);
    until(&mut harness, "the missing file is named", |harness| {
        has(harness, "no such file or folder")
    });
}

#[test]
fn all_dropped_files_are_taken_and_more_can_be_dropped() {
    let dir = tempfile::tempdir().unwrap();
    images(dir.path());
    let file = |number: usize| dir.path().join(format!("{number}.png"));
    let mut harness = window();
    drop_files(&mut harness, &[file(0), file(2)]);
    until(&mut harness, "both are counted", |harness| {
        has(harness, "2 images")
    });
    drop_files(&mut harness, &[file(1)]);
    until(&mut harness, "all are counted", |harness| {
        has(harness, "3 images") && has(harness, "3 items in")
    });
}

/// Makes a small example.
fn small_example(folder: &Path, progress: &Progress) -> Result<PathBuf> {
    let scene = SceneOptions {
        views: 3,
        width: 60,
        height: 80,
        ..SceneOptions::default()
    };
    make_example(folder, &scene, progress)
}

#[test]
fn example_is_made_once_and_opened() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("example");
    let mut harness = window();
    inner(&mut harness).offer_example(folder.clone(), small_example);
    for _ in 0..2 {
        harness.run_steps(2);
        harness.get_by_label("Try the example plant").click();
        until(&mut harness, "the example is open", |harness| {
            harness.query_by_label("Frame 2, no mask").is_some()
        });
        let root = inner(&mut harness).session().root().unwrap().to_owned();
        assert!(root.starts_with(&folder));
        let project = inner(&mut harness).session().project().unwrap().clone();
        let is_ready =
            |frame: &ostra_frames::Frame| frame.posed_camera().is_some() && frame.depth.is_some();
        assert!(project.frames.iter().all(is_ready));
        inner(&mut harness).act(ostra_session::Command::Close);
        until(&mut harness, "the first page is shown", |harness| {
            harness.query_by_label("Try the example plant").is_some()
        });
    }
    let notices = inner(&mut harness).shell().view.notices.shown().to_vec();
    assert!(
        notices.iter().any(|notice| notice.text.contains("example")),
        "{notices:?}"
    );
}

/// Waits until it is stopped.
fn endless_example(_: &Path, progress: &Progress) -> Result<PathBuf> {
    progress.stage("render")?;
    loop {
        progress.check()?;
        std::thread::park_timeout(std::time::Duration::from_millis(1));
    }
}

#[test]
fn example_can_be_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = window();
    inner(&mut harness).offer_example(dir.path().to_owned(), endless_example);
    harness.run_steps(2);
    harness.get_by_label("Try the example plant").click();
    until(&mut harness, "it can be stopped", |harness| {
        harness.query_by_label("Stop making the example").is_some()
    });
    harness.get_by_label("Stop making the example").click();
    until(&mut harness, "it is offered again", |harness| {
        harness.query_by_label("Try the example plant").is_some()
    });
    assert!(inner(&mut harness).session().root().is_none());
}
