//! The tutorials of the book, followed to the letter by the program as a process.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;

use crate::book_pages::{blocks, words};
use crate::program::contents;

/// The step that all tutorials begin with. It is run once.
pub const SHARED: &str = "ostra demo example --headless --frames 16";

/// Starts a command line of the book in a folder, as a user who has no settings.
pub fn output(line: &str, folder: &Path) -> Output {
    let words = words(line);
    assert_eq!(words[0], "ostra", "{line}");
    let home = folder.join("home");
    fs::create_dir_all(&home).unwrap();
    Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(&words[1..])
        .current_dir(folder)
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("ORT_DYLIB_PATH")
        .env("HOME", &home)
        .env("XDG_CONFIG_HOME", home.join("config"))
        .env("XDG_DATA_HOME", home.join("data"))
        .env("XDG_CACHE_HOME", home.join("cache"))
        .output()
        .unwrap()
}

/// Returns all that a command printed.
pub fn printed(output: &Output) -> String {
    [&output.stdout[..], &output.stderr[..]]
        .map(String::from_utf8_lossy)
        .join("\n")
}

/// Runs a command line of the book, which must succeed, and returns what it prints.
pub fn run(line: &str, folder: &Path) -> String {
    let output = output(line, folder);
    let text = printed(&output);
    assert!(output.status.success(), "{line}\n{text}");
    text
}

/// Copies a folder with all that is in it.
pub fn copy(from: &Path, to: &Path) {
    for (path, bytes) in contents(from) {
        let path = to.join(path.strip_prefix(from).unwrap());
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
}

/// Returns the folder in which [`SHARED`] was run.
pub fn example() -> &'static Path {
    static EXAMPLE: OnceLock<tempfile::TempDir> = OnceLock::new();
    let made = EXAMPLE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        run(SHARED, folder.path());
        folder
    });
    made.path()
}

/// Returns whether `text` holds a line that begins with `line`, up to the ellipsis in it.
fn shows(text: &str, line: &str) -> bool {
    let beginning = line.split('…').next().unwrap_or_default().trim_end();
    text.lines()
        .any(|other| other.trim_end().starts_with(beginning))
}

/// Follows a tutorial and returns the folder in which its projects are.
fn follow(page: &str) -> tempfile::TempDir {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book/src/tutorials");
    let page = fs::read_to_string(path.join(page)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    copy(&example().join("example"), &folder.path().join("example"));
    let mut printed = String::new();
    let mut ran = 0;
    for block in blocks(&page) {
        match block.kind.as_str() {
            "sh" => {
                for line in block.lines.iter().filter(|line| *line != SHARED) {
                    printed += &run(line, folder.path());
                    ran += 1;
                }
            }
            "text" => {
                let mut seen = printed.clone();
                for entry in fs::read_dir(folder.path()).unwrap() {
                    let path = entry.unwrap().path();
                    let files = match path.is_dir() && !path.join("project.toml").exists() {
                        true => contents(&path),
                        false if path.is_file() => vec![(path.clone(), fs::read(&path).unwrap())],
                        false => Vec::new(),
                    };
                    for (path, bytes) in files {
                        if path
                            .extension()
                            .is_some_and(|end| end == "csv" || end == "json")
                        {
                            seen += &String::from_utf8_lossy(&bytes);
                            seen.push('\n');
                        }
                    }
                }
                for line in block.lines {
                    assert!(
                        shows(&seen, &line),
                        "the page promises {line:?}:\n{printed}"
                    );
                }
            }
            kind => panic!("a block of kind {kind:?}"),
        }
    }
    assert!(ran >= 8, "{ran} commands");
    folder
}

/// Returns the folder in which the tutorial on RGB-D recordings was followed.
pub fn rgbd() -> &'static Path {
    static FOLLOWED: OnceLock<tempfile::TempDir> = OnceLock::new();
    FOLLOWED.get_or_init(|| follow("rgbd-to-mesh.md")).path()
}

/// Returns the folder in which the tutorial on videos was followed.
pub fn video() -> &'static Path {
    static FOLLOWED: OnceLock<tempfile::TempDir> = OnceLock::new();
    FOLLOWED.get_or_init(|| follow("video-to-coco.md")).path()
}

fn photos_become_a_table_of_traits() {
    drop(follow("photos-of-a-plant.md"));
}

fn an_rgbd_recording_becomes_a_labelled_mesh() {
    rgbd();
}

fn a_video_becomes_masks_in_coco_format() {
    video();
}

crate::registry::tests! {
    Nothing => photos_become_a_table_of_traits;
    Nothing => an_rgbd_recording_becomes_a_labelled_mesh;
    Ffmpeg => a_video_becomes_masks_in_coco_format;
}
