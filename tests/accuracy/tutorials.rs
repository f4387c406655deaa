//! The tutorials of the book, followed to the letter by the program as a process.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use crate::program::contents;

/// The step that all tutorials begin with. It is run once.
const SHARED: &str = "ostra demo example --headless --frames 16";

/// A block of a page: commands to type, or what the page says they print or write.
enum Block {
    Commands(Vec<String>),
    Text(Vec<String>),
}

fn blocks(page: &str) -> Vec<Block> {
    let mut found = Vec::new();
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        let Some(kind) = line.strip_prefix("```") else {
            continue;
        };
        let inside = lines.by_ref().take_while(|line| *line != "```");
        let inside = inside.map(String::from).collect();
        match kind {
            "sh" => found.push(Block::Commands(inside)),
            "text" => found.push(Block::Text(inside)),
            _ => panic!("a block of kind {kind:?}"),
        }
    }
    found
}

fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut is_quoted = false;
    for c in line.chars() {
        match c {
            '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.push(String::new()),
            _ => words.last_mut().unwrap().push(c),
        }
    }
    words
}

/// Runs a command line of the book in a folder, as a user who has no settings.
pub fn run(line: &str, folder: &Path) -> String {
    let words = words(line);
    assert_eq!(words[0], "ostra", "{line}");
    let home = folder.join("home");
    fs::create_dir_all(&home).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_ostra"))
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
        .unwrap();
    let text = [&output.stdout[..], &output.stderr[..]].map(String::from_utf8_lossy);
    let text = text.join("\n");
    assert!(output.status.success(), "{line}\n{text}");
    text
}

fn copy(from: &Path, to: &Path) {
    for (path, bytes) in contents(from) {
        let path = to.join(path.strip_prefix(from).unwrap());
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
}

/// Returns the folder in which [`SHARED`] was run.
fn example() -> &'static Path {
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
        match block {
            Block::Commands(lines) => {
                for line in lines.iter().filter(|line| *line != SHARED) {
                    printed += &run(line, folder.path());
                    ran += 1;
                }
            }
            Block::Text(lines) => {
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
                for line in lines {
                    assert!(
                        shows(&seen, &line),
                        "the page promises {line:?}:\n{printed}"
                    );
                }
            }
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
