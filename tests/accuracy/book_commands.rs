//! The commands in the pages of the book, run by the program in a folder with the files of which
//! the pages speak.
//!
//! The tutorials have tests of their own, which follow them to the letter.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use image::imageops::{FilterType, resize};
use image::{GrayImage, Luma};
use ostra_eval::synthetic::{Scene, SceneOptions};
use ostra_masks::{LabelMask, read_palette_png};
use tempfile::TempDir;

use crate::book_pages::{blocks, commands, pages, words};
use crate::tutorials::{self, SHARED, copy, example, printed, run};
use crate::video::{Making, make_video};

/// Parts of commands that are not run, with the reason.
const NOT_RUN: [(&str, &str); 11] = [
    (SHARED, "is run by the tests of the tutorials"),
    ("ostra models install ", "loads files from the internet"),
    ("ostra models add ", "needs the files of a network"),
    ("ostra models check ", "needs an installed network"),
    ("ostra models remove ", "needs an installed network"),
    ("ostra ground ", "needs an installed network"),
    ("ostra suggest plant --frame ", "needs an installed network"),
    (
        "ostra select-model ",
        "needs images without a connection; tests/headless/several_models.rs runs it",
    ),
    ("ostra bench --data ", "needs public data sets"),
    ("ostra bench --synthetic 100,", "takes a long time"),
    ("ostra bench --two-cameras ", "takes a long time"),
];

/// Labels of the masks, with their parents.
const LABELS: &str = r#"[{"id": 1, "name": "leaf"}, {"id": 2, "name": "stem"},
    {"id": 3, "name": "leaf 3", "parent": 1}, {"id": 4, "name": "leaf 3 blade", "parent": 3},
    {"id": 5, "name": "panicle"}, {"id": 6, "name": "tiller"}]"#;

/// Frames of the project `plant` whose masks are given.
const KEYFRAMES: [usize; 4] = [0, 6, 12, 15];

/// Photos of each specimen, half as wide and high as those of `plant`.
const SPECIMEN_PHOTOS: usize = 8;

/// Returns the label in [`LABELS`] of a label of the synthetic plant.
fn label_of(name: &str) -> u8 {
    match name {
        "leaf 3 blade" => 4,
        "stem 2" => 6,
        _ if name.starts_with("leaf 3") => 3,
        _ if name.starts_with("leaf") => 1,
        _ if name.starts_with("stem") => 2,
        _ => 5,
    }
}

/// Returns the ids of the synthetic plant's labels in [`LABELS`], by their own ids.
fn ids(truth: &Path) -> Vec<u8> {
    let text = fs::read_to_string(truth.join("labels.json")).unwrap();
    let labels: Vec<serde_json::Value> = serde_json::from_str(&text).unwrap();
    let mut ids = vec![0];
    ids.extend(
        labels
            .iter()
            .map(|label| label_of(label["name"].as_str().unwrap())),
    );
    ids
}

fn grey(mask: &LabelMask, ids: &[u8]) -> GrayImage {
    GrayImage::from_fn(mask.width, mask.height, |x, y| {
        Luma([ids[usize::from(mask.at(x, y).0)]])
    })
}

fn name(frame: usize) -> String {
    format!("{frame:03}.png")
}

/// Writes images, depth in millimetres, cameras, and masks of all frames and of keyframes.
fn write_recording(world: &Path) {
    let example = example().join("example");
    let (recording, truth) = (example.join("recording"), example.join("truth"));
    for folder in ["photos", "color", "archive/photos"] {
        copy(&recording.join("color"), &world.join(folder));
    }
    copy(&recording.join("sparse"), &world.join("sparse"));
    copy(&recording.join("sparse"), &world.join("sparse/1"));
    for folder in ["depth", "masks", "keyframes", "closeups", "clip", "truth"] {
        fs::create_dir_all(world.join(folder)).unwrap();
    }
    let ids = ids(&truth);
    for (frame, entry) in (0..).zip(sorted(&recording.join("color"))) {
        let file = entry.file_name().unwrap();
        assert_eq!(file.to_str().unwrap(), name(frame));
        let depth = image::open(recording.join("depth").join(file)).unwrap();
        let mut depth = depth.into_luma16();
        depth.pixels_mut().for_each(|pixel| pixel.0[0] /= 10);
        depth.save(world.join("depth").join(file)).unwrap();
        let mask = read_palette_png(&truth.join("masks").join(file)).unwrap();
        let mask = grey(&mask, &ids);
        mask.save(world.join("masks").join(file)).unwrap();
        if KEYFRAMES.contains(&frame) {
            mask.save(world.join("keyframes").join(file)).unwrap();
        }
        if frame < 3 {
            fs::copy(
                &entry,
                world.join("closeups").join(format!("close{frame}.png")),
            )
            .unwrap();
            fs::copy(&entry, world.join("clip").join(file)).unwrap();
        }
    }
    for folder in ["masks", "keyframes"] {
        fs::write(world.join(folder).join("labels.json"), LABELS).unwrap();
    }
    copy(&world.join("masks"), &world.join("truth/masks"));
    copy(&world.join("sparse"), &world.join("truth/sparse"));
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Writes small photos of a specimen and their masks.
fn write_specimen(world: &Path, photos: &Path, masks: &Path) {
    fs::create_dir_all(photos).unwrap();
    fs::create_dir_all(masks).unwrap();
    for frame in 0..SPECIMEN_PHOTOS {
        let photo = image::open(world.join("color").join(name(frame)))
            .unwrap()
            .to_rgb8();
        let (width, height) = (photo.width() / 2, photo.height() / 2);
        let photo = resize(&photo, width, height, FilterType::Triangle);
        photo.save(photos.join(name(frame))).unwrap();
        let mask = image::open(world.join("truth/masks").join(name(frame))).unwrap();
        let mask = resize(&mask.to_luma8(), width, height, FilterType::Nearest);
        mask.save(masks.join(name(frame))).unwrap();
    }
    fs::write(masks.join("labels.json"), LABELS).unwrap();
}

/// Writes a video in which the camera moves by 0.4 degrees from image to image.
fn write_video(path: &Path) {
    let options = SceneOptions {
        views: 32,
        width: 240,
        height: 320,
        arc_deg: 62.0,
        ..SceneOptions::default()
    };
    let scene = Scene::build(&options).unwrap();
    let views: Vec<Vec<u8>> = scene
        .views()
        .iter()
        .map(|view| scene.render(view).image.pixels.as_flattened().to_vec())
        .collect();
    let making = Making {
        size: (options.width, options.height),
        pixels: "rgb24",
        count: 5 * views.len() as u64,
        options: "-c:v libx264 -crf 12 -pix_fmt yuv420p",
    };
    make_video(path, &making, |image| views[image as usize / 5].clone());
}

/// Returns a folder with all files and projects that pages use.
fn world() -> &'static Path {
    static WORLD: OnceLock<TempDir> = OnceLock::new();
    let made = WORLD.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let world = folder.path();
        write_recording(world);
        write_video(&world.join("walk.mp4"));
        for line in [
            "ostra new plant --frames photos --depth depth --cameras sparse",
            "ostra masks plant import keyframes --format davis",
            "ostra label plant pot",
            "ostra prompt plant --frame 0 --label pot --click 240,620",
            "ostra prompt plant --frame 6 --label pot --click 240,620",
            "ostra track plant",
            "ostra fuse plant --voxel 0.004",
            "ostra export plant --cloud cloud.ply --masks result/masks",
            "ostra export plant --cloud scan.ply",
            "ostra export plant --cloud truth/cloud.ply --cameras result/sparse",
            "ostra export plant --cloud result/cloud.ply",
            "ostra new walk --frames walk.mp4 --every 5",
            "ostra label walk leaf",
            "ostra prompt walk --frame 0 --label leaf --box 100,100,140,300",
        ] {
            run(line, world);
        }
        folder
    });
    made.path()
}

/// Removes the cloud that the project exported in another folder, which is not replaced here.
fn remove_exports(folder: &Path) {
    for file in ["cloud.ply", "cloud.classes.json"] {
        fs::remove_file(folder.join(file)).unwrap();
    }
}

/// Puts the files of one page into its copy of the [`world`].
fn prepare(page: &str, text: &str, folder: &Path) {
    for line in commands(text) {
        if let [_, command, project, ..] = &words(&line)[..]
            && command == "new"
            && folder.join(project).exists()
        {
            fs::remove_dir_all(folder.join(project)).unwrap();
        }
    }
    let start_again = |lines: &[&str]| {
        fs::remove_dir_all(folder.join("plant")).unwrap();
        for line in lines {
            run(line, folder);
        }
    };
    match page {
        "how-to/click.md" => {
            start_again(&["ostra new plant --frames photos --depth depth --cameras sparse"]);
        }
        "how-to/scale.md" => start_again(&["ostra new plant --frames photos --cameras sparse"]),
        "how-to/headless-servers.md" => {
            fs::remove_dir_all(folder.join("photos")).unwrap();
            for specimen in ["plant1", "plant2", "plant3"] {
                let [photos, masks] = ["photos", "masks"].map(|kind| folder.join(kind));
                write_specimen(folder, &photos.join(specimen), &masks.join(specimen));
                for frame in (0..SPECIMEN_PHOTOS).filter(|frame| frame % 4 != 0) {
                    fs::remove_file(masks.join(specimen).join(name(frame))).unwrap();
                }
            }
            remove_exports(folder);
        }
        "how-to/export.md" => {
            remove_exports(folder);
            fs::remove_dir_all(folder.join("masks")).unwrap();
        }
        "how-to/reconstruct-photos.md" => {
            let photos = folder.join("photos");
            fs::remove_dir_all(&photos).unwrap();
            write_specimen(folder, &photos, &folder.join("masks"));
            let everything = folder.join("everything");
            fs::create_dir(&everything).unwrap();
            for frame in 0..SPECIMEN_PHOTOS {
                let mask = GrayImage::from_pixel(240, 320, Luma([1]));
                mask.save(everything.join(name(frame))).unwrap();
            }
            start_again(&[
                "ostra new plant --frames photos",
                "ostra masks plant import everything",
            ]);
        }
        "how-to/recipes.md" => {
            let reference = pages()
                .into_iter()
                .find(|path| path.ends_with("reference/recipes.md"));
            let recipe = json(&fs::read_to_string(reference.unwrap()).unwrap());
            let recipe = recipe.replace(r#""root": "plant""#, r#""root": "another""#);
            fs::write(folder.join("recipe.json"), recipe).unwrap();
            fs::write(folder.join("undo.json"), json(text)).unwrap();
        }
        _ => {}
    }
}

/// Returns the JSON of a page.
fn json(page: &str) -> String {
    let mut blocks = blocks(page).into_iter();
    let block = blocks.find(|block| block.kind == "json").unwrap();
    block.lines.join("\n")
}

/// Runs the commands of some pages and fails with all that did not succeed.
fn run_pages(is_wanted: fn(&str) -> bool) {
    let book = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book/src");
    let mut failed = Vec::new();
    let mut ran = 0;
    for path in pages() {
        let page = path.strip_prefix(&book).unwrap().to_str().unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let lines = commands(&text);
        if page.starts_with("tutorials/") || lines.is_empty() || !is_wanted(page) {
            continue;
        }
        let folder = tempfile::tempdir().unwrap();
        copy(world(), folder.path());
        prepare(page, &text, folder.path());
        for line in lines {
            if NOT_RUN.iter().any(|(part, _)| line.contains(part)) {
                continue;
            }
            ran += 1;
            let output = tutorials::output(&line, folder.path());
            if !output.status.success() {
                failed.push(format!("{page}: {line}\n{}", printed(&output)));
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
    assert!(ran > 10, "only {ran} commands were run");
}

fn is_on_whole_jobs(page: &str) -> bool {
    ["reconstruct", "headless", "install"]
        .iter()
        .any(|part| page.contains(part))
}

fn commands_of_pages_on_whole_jobs_succeed() {
    run_pages(is_on_whole_jobs);
}

fn commands_of_other_pages_succeed() {
    run_pages(|page| !is_on_whole_jobs(page));
}

fn commands_that_are_not_run_are_in_the_book() {
    let text = pages()
        .into_iter()
        .flat_map(|path| commands(&fs::read_to_string(path).unwrap()));
    let lines: Vec<String> = text.collect();
    for (part, reason) in NOT_RUN {
        assert!(
            lines.iter().any(|line| line.contains(part)),
            "no command of the book has {part:?}, which {reason}"
        );
    }
}

crate::registry::tests! {
    Nothing => commands_that_are_not_run_are_in_the_book;
    Ffmpeg => commands_of_pages_on_whole_jobs_succeed, commands_of_other_pages_succeed;
}
