//! Every variant of every error type has a text in the style of the others.
//!
//! An `every_variant!` list without a line for a variant does not compile. A type without a list
//! fails `every_error_type_is_listed`.

use std::collections::BTreeSet;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use crate::wording::{WORDS, words};
use ostra_cloud::SceneError;
use ostra_compute::gpu::GpuError;
use ostra_compute::nn::NnError;
use ostra_core::job::{Full, JobError, Stopped};
use ostra_frames::FrameError;
use ostra_geometry::GeometryError;
use ostra_masks::MaskError;
use ostra_project::TrackerId;
use ostra_project::store::LockError;
use ostra_reconstruct::rgbd::RgbdError;
use ostra_reconstruct::sfm::{FeatureError, SfmError};
use ostra_reconstruct::stereo::StereoError;
use ostra_view::ViewError;

/// One value of a variant, and what its text must name.
struct Sample {
    /// Type and variant.
    name: String,
    error: anyhow::Error,
    parts: &'static [&'static str],
}

impl Sample {
    fn new<E: Error + Send + Sync + 'static>(
        name: String,
        error: E,
        parts: &'static [&'static str],
    ) -> Self {
        Self {
            name,
            error: error.into(),
            parts,
        }
    }
}

/// Lists one value of each variant of an error type, with what its text must name.
macro_rules! every_variant {
    ($type:ident { $($pattern:pat => $value:expr, $parts:expr;)+ }) => {{
        // Does not compile while a variant has no line in the list.
        fn line_of(error: &$type) -> &'static str {
            match error {
                $($pattern => stringify!($pattern),)+
            }
        }
        vec![$({
            let (value, line): ($type, _) = ($value, stringify!($pattern));
            assert_eq!(line_of(&value), line, "the value is of another variant");
            Sample::new(format!("{} {line}", stringify!($type)), value, &$parts)
        }),+]
    }};
}

/// Types whose values are private, each with the file that checks the text.
const PRIVATE: [(&str, &str); 1] = [("Interrupted", "src/cli/stop.rs")];

/// Texts without a remedy: the user asked for what they report.
const WITHOUT_REMEDY: [&str; 1] = ["stopped"];

/// Names with which a text may begin in upper case.
const NAMES: [&str; 2] = ["EXIF", "ONNX"];

fn denied() -> std::io::Error {
    std::io::ErrorKind::PermissionDenied.into()
}

fn lost_path() -> FrameError {
    FrameError::Missing {
        path: "photos/07.jpg".into(),
    }
}

fn of_foundations() -> Vec<Sample> {
    let mut all = vec![
        Sample::new("Stopped".into(), Stopped, &["stopped"]),
        Sample::new("Full".into(), Full, &["queue is full"]),
        Sample::new(
            "UnknownEngine".into(),
            "xmen".parse::<TrackerId>().unwrap_err(),
            &["tracker 'xmen'", "auto, xmem, deaot, geometry, flow"],
        ),
    ];
    all.extend(every_variant!(JobError {
        JobError::Panicked { .. } => JobError::Panicked { what: "index 7".into() }, ["bug", "index 7", "report it"];
        JobError::Discarded => JobError::Discarded, ["queue", "start it again"];
        JobError::NoThread { .. } => JobError::NoThread { what: "limit of 4".into() }, ["limit of 4", "close other"];
    }));
    all.extend(every_variant!(GeometryError {
        GeometryError::NotFinite { .. } => GeometryError::NotFinite { what: "pose".into() }, ["the pose"];
        GeometryError::NotARotation { .. } => GeometryError::NotARotation { error: 0.25 }, ["0.250", "convention"];
        GeometryError::TooFewPoints { .. } => GeometryError::TooFewPoints { count: 2, kind: "sim3" },
            ["2 points", "sim3", "at least 3"];
        GeometryError::Mirrored { .. } => GeometryError::Mirrored { orientation: 5 }, ["orientation 5", "upright"];
        GeometryError::Unpaired { .. } => GeometryError::Unpaired { what: "cameras", left: 3, right: 4 },
            ["3 cameras", "4 on the other"];
    }));
    all.extend(every_variant!(LockError {
        LockError::NotWritable { .. } => LockError::NotWritable { root: "plant".into(), why: denied() },
            ["plant: ", "permission denied", "write access"];
        LockError::Held(_) => LockError::Held("plant".into()), ["plant: ", "close it there"];
        LockError::NotLockable { .. } => LockError::NotLockable { root: "plant".into(), why: denied() },
            ["plant: ", "permission denied", "local disk"];
    }));
    all.extend(every_variant!(ViewError {
        ViewError::Write { .. } => ViewError::Write { path: "shot.png".into(), what: "disk is full".into() },
            ["shot.png: ", "disk is full", "check the folder"];
        ViewError::Empty => ViewError::Empty, ["no points", "'fuse'"];
    }));
    all
}

fn of_devices() -> Vec<Sample> {
    let mut all = every_variant!(GpuError {
        GpuError::NoAdapter => GpuError::NoAdapter, ["no graphics card", "driver", "'cpu'"];
        GpuError::SoftwareOnly { .. } => GpuError::SoftwareOnly { name: "llvmpipe".into() }, ["'llvmpipe'", "'cpu'"];
        GpuError::Refused { .. } => GpuError::Refused { name: "Card 5".into(), what: "limits".into() },
            ["'Card 5'", "limits", "'cpu'"];
        GpuError::TooLarge { .. } => GpuError::TooLarge { what: "the depths", bytes: 5 << 30, limit: 2 << 30 },
            ["the depths", "5120 MiB", "2048 MiB", "'cpu'"];
        GpuError::Failed { .. } => GpuError::Failed { what: "out of memory".into() }, ["out of memory", "'cpu'"];
        GpuError::Lost { .. } => GpuError::Lost { what: "reset".into() }, ["reset", "'cpu'"];
        GpuError::NoAnswer { .. } => GpuError::NoAnswer { seconds: 60 }, ["60 s", "'cpu'"];
    });
    let path = || PathBuf::from("xmem.onnx");
    let url = || "https://example.org/xmem.onnx".to_owned();
    let (expected, found) = (|| "0a0b".to_owned(), || "0c0d".to_owned());
    all.extend(every_variant!(NnError {
        NnError::RuntimeMissing { .. } => NnError::RuntimeMissing { looked: vec!["/lib/a.so".into(), "/lib/b.so".into()] },
            ["/lib/a.so, /lib/b.so", "ostra models add onnxruntime"];
        NnError::RuntimeUnusable { .. } => NnError::RuntimeUnusable { path: "/lib/a.so".into(), what: "version 1.2".into() },
            ["/lib/a.so: ", "version 1.2", "1.24"];
        NnError::Io { .. } => NnError::Io { path: path(), reason: denied() },
            ["xmem.onnx: ", "permission denied", "check that"];
        NnError::NotANetwork { .. } => NnError::NotANetwork { path: path(), what: "bad header".into() },
            ["xmem.onnx: ", "bad header", "check that"];
        NnError::Mismatch { .. } => NnError::Mismatch { path: path(), what: "has no input 'image'".into() },
            ["xmem.onnx: ", "no input 'image'", "another network"];
        NnError::Fetch { .. } => NnError::Fetch { url: url(), what: "no route".into(), is_stopped: false },
            ["https://example.org/xmem.onnx: ", "no route", "ostra models add"];
        NnError::WrongDownload { .. } => NnError::WrongDownload { url: url(), expected: expected(), found: found() },
            ["https://example.org/xmem.onnx: ", "0a0b", "0c0d", "try again"];
        NnError::Changed { .. } => NnError::Changed { path: path(), expected: expected(), found: found() },
            ["xmem.onnx: ", "0a0b", "0c0d", "ostra models add"];
        NnError::Digest { .. } => NnError::Digest { path: path(), expected: expected(), found: found() },
            ["xmem.onnx: ", "0a0b", "0c0d", "download it again"];
        NnError::Run { .. } => NnError::Run { path: path(), what: "out of memory".into() },
            ["xmem.onnx: ", "out of memory", "ostra models check"];
        NnError::Request(_) => NnError::Request("there is no network `xmen`; known are xmem, deaot".into()), ["`xmen`"];
    }));
    all
}

fn of_stages() -> Vec<Sample> {
    let path = || PathBuf::from("plant/masks/3.png");
    let what = || "has 3 channels; save it as a palette PNG".to_owned();
    let of_feature = || FeatureError::Network("xfeat.onnx: failed; check it".into());
    let mut all = every_variant!(FrameError {
        FrameError::Io { .. } => FrameError::Io { path: path(), reason: denied() },
            ["plant/masks/3.png: ", "permission denied", "check that"];
        FrameError::Missing { .. } => lost_path(), ["photos/07.jpg: ", "ostra relocate"];
        FrameError::Invalid { .. } => FrameError::Invalid { path: path(), what: what() }, ["plant/masks/3.png: ", "3 channels"];
        FrameError::NotFound(_) => FrameError::NotFound("no frame is in 4 to 2; choose another range".into()), ["4 to 2"];
        FrameError::Geometry { .. } => FrameError::Geometry { path: path(), reason: GeometryError::Mirrored { orientation: 5 } },
            ["plant/masks/3.png: ", "orientation 5", "upright"];
        FrameError::Stopped(_) => FrameError::Stopped(Stopped), ["stopped"];
    });
    all.extend(every_variant!(MaskError {
        MaskError::Io { .. } => MaskError::Io { path: path(), reason: denied() },
            ["plant/masks/3.png: ", "permission denied", "check that"];
        MaskError::Invalid { .. } => MaskError::Invalid { path: path(), what: what() }, ["plant/masks/3.png: ", "3 channels"];
        MaskError::Label(_) => MaskError::Label("label 2 still has the child 'leaf'; remove that first".into()), ["'leaf'"];
        MaskError::Request(_) => MaskError::Request("the box is empty; draw a larger one".into()), ["the box"];
        MaskError::Network(_) => MaskError::Network("'sam' is not installed; install it".into()), ["'sam'"];
        MaskError::Frame(_) => MaskError::Frame(lost_path()), ["photos/07.jpg: ", "ostra relocate"];
        MaskError::Stopped(_) => MaskError::Stopped(Stopped), ["stopped"];
    }));
    all.extend(every_variant!(SceneError {
        SceneError::Io { .. } => SceneError::Io { path: "cloud.ply".into(), reason: denied() },
            ["cloud.ply: ", "permission denied", "check that"];
        SceneError::Invalid { .. } => SceneError::Invalid { path: "cloud.ply".into(), what: "has no points; fuse again".into() },
            ["cloud.ply: ", "fuse again"];
        SceneError::Request(_) => SceneError::Request("frame 9 has no camera; choose another one".into()), ["frame 9"];
        SceneError::TooLarge { .. } => SceneError::TooLarge { voxel: 0.002, mebibytes: 4096 }, ["0.002", "4096 MiB", "larger voxel"];
        SceneError::Frame(_) => SceneError::Frame(lost_path()), ["photos/07.jpg: "];
        SceneError::Mask(_) => SceneError::Mask(MaskError::Invalid { path: path(), what: what() }), ["plant/masks/3.png: "];
        SceneError::Geometry(_) => SceneError::Geometry(GeometryError::NotFinite { what: "pose".into() }), ["the pose"];
        SceneError::Stopped(_) => SceneError::Stopped(Stopped), ["stopped"];
    }));
    all.extend(every_variant!(FeatureError {
        FeatureError::Network(_) => of_feature(), ["feature network failed", "xfeat.onnx: "];
        FeatureError::Kinds(_) => FeatureError::Kinds("descriptors of 64 floats and 128 bytes cannot be compared".into()),
            ["64 floats", "same extractor"];
    }));
    all.extend(every_variant!(SfmError {
        SfmError::Feature(_) => SfmError::Feature(of_feature()), ["feature network failed"];
        SfmError::Frame(_) => SfmError::Frame(lost_path()), ["photos/07.jpg: "];
        SfmError::NoStart(_) => SfmError::NoStart("no two of 12 images match; take photos in between".into()), ["12 images"];
        SfmError::Stopped(_) => SfmError::Stopped(Stopped), ["stopped"];
    }));
    all.extend(every_variant!(RgbdError {
        RgbdError::Feature(_) => RgbdError::Feature(of_feature()), ["feature network failed"];
        RgbdError::Scene(_) => RgbdError::Scene(SceneError::Frame(lost_path())), ["photos/07.jpg: "];
        RgbdError::NoStart(_) => RgbdError::NoStart("no two of 12 frames agree; check their depth".into()), ["12 frames"];
        RgbdError::Stopped(_) => RgbdError::Stopped(Stopped), ["stopped"];
    }));
    all.extend(every_variant!(StereoError {
        StereoError::Sfm(_) => StereoError::Sfm(SfmError::Feature(of_feature())), ["feature network failed"];
        StereoError::Scene(_) => StereoError::Scene(SceneError::Frame(lost_path())), ["photos/07.jpg: "];
        StereoError::Gpu(_) => StereoError::Gpu(GpuError::NoAdapter), ["no graphics card"];
        StereoError::Stopped(_) => StereoError::Stopped(Stopped), ["stopped"];
    }));
    all
}

fn samples() -> Vec<Sample> {
    [of_foundations(), of_devices(), of_stages()]
        .into_iter()
        .flatten()
        .collect()
}

/// Returns what is wrong with a text, or `None`.
fn fault(text: &str, parts: &[&str]) -> Option<String> {
    if text.trim().is_empty() {
        return Some("is empty".into());
    }
    if text.trim() != text || text.contains(['\n', '\r', '\t']) || text.contains("  ") {
        return Some("is not one line with single spaces".into());
    }
    if text.ends_with(['.', '!', ':', ';', ',']) {
        return Some("ends with a punctuation mark".into());
    }
    let is_named = NAMES.iter().any(|name| text.starts_with(name));
    if text.starts_with(char::is_uppercase) && !is_named {
        return Some("begins in upper case".into());
    }
    for debug in ["Some(", "None", "Ok(", "Err(", "\"", "\\", " { ", "[]"] {
        if text.contains(debug) {
            return Some(format!("shows the code {debug}"));
        }
    }
    if !text.contains("; ") && !WITHOUT_REMEDY.contains(&text) {
        return Some("does not say what to do".into());
    }
    let lower = text.to_lowercase();
    let (word, instead) = WORDS
        .iter()
        .find(|(word, _)| words(&lower).any(|other| other == *word))
        .copied()
        .unzip();
    if let (Some(word), Some(instead)) = (word, instead) {
        return Some(format!("says '{word}' ({instead})"));
    }
    let lacking = parts.iter().find(|part| !text.contains(**part))?;
    Some(format!("does not name '{lacking}'"))
}

#[test]
fn every_error_text_says_what_where_and_what_to_do() {
    let mut faults = Vec::new();
    for Sample { name, error, parts } in samples() {
        assert!(!parts.is_empty(), "{name}");
        let text = error.to_string();
        if let Some(fault) = fault(&text, parts) {
            faults.push(format!("{name} {fault}: {text}"));
        }
        // A command prints the error with its sources.
        let printed = format!("{error:#}");
        if printed != text {
            faults.push(format!("{name} is printed twice: {printed}"));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn faults_of_texts_are_found() {
    let good = "plant.png: has 3 channels; save it again";
    assert_eq!(fault(good, &["plant.png: "]), None);
    assert_eq!(fault("stopped", &["stopped"]), None);
    for (text, expected) in [
        ("", "empty"),
        ("  ", "empty"),
        ("a file is missing;\nfind it", "one line"),
        ("a file is missing; find it.", "punctuation"),
        ("A file is missing; find it", "upper case"),
        ("Some(7) is missing; find it", "upper case"),
        ("frame Some(7) is missing; find it", "Some("),
        ("\"a\\n\" is missing; find it", "code"),
        ("a file is missing", "what to do"),
        ("a file is missing; find it", "does not name 'plant.png: '"),
    ] {
        let found = fault(text, &["plant.png: "]).unwrap_or_default();
        assert!(found.contains(expected), "{text}: {found}");
    }
    let [(word, _), ..] = WORDS;
    let found = fault(&format!("a file is {word} missing; find it"), &["file"]);
    assert!(found.is_some_and(|found| found.contains(word)));
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|end| end == "rs") {
            found.push(path);
        }
    }
}

/// Returns the names of the types in a source file that are errors.
fn error_types(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut is_derived = false;
    for line in text.lines().map(str::trim) {
        if line.starts_with("//") {
            continue;
        }
        is_derived |= line.contains("thiserror::Error") && !line.starts_with("use ");
        let definition = line
            .split_once("enum ")
            .or_else(|| line.split_once("struct "))
            .filter(|_| is_derived);
        let by_hand = line
            .split_once("Error for ")
            .filter(|_| line.starts_with("impl"));
        if let Some((_, rest)) = definition.or(by_hand) {
            let name = rest.split(|c: char| !c.is_alphanumeric()).next();
            found.extend(name.map(String::from));
            is_derived = false;
        }
    }
    found
}

#[test]
fn every_error_type_is_listed() {
    let by_hand = "impl std::error::Error for ByHand {}";
    let derived =
        "#[derive(Debug, thiserror::Error)]\n#[error(\"no\")]\npub(super) struct Derived;";
    assert_eq!(error_types(by_hand), ["ByHand"]);
    assert_eq!(error_types(derived), ["Derived"]);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    sources(&root.join("src"), &mut files);
    let found: BTreeSet<String> = files
        .iter()
        .flat_map(|path| {
            let text = fs::read_to_string(path).unwrap();
            assert!(
                !text.contains("use thiserror"),
                "{}: write thiserror::Error in full, so that this test finds the type",
                path.display()
            );
            error_types(&text)
        })
        .collect();
    let first_word = |sample: Sample| sample.name.split(' ').next().unwrap().to_owned();
    let mut listed: BTreeSet<String> = samples().into_iter().map(first_word).collect();
    for (name, file) in PRIVATE {
        let text = fs::read_to_string(root.join(file)).unwrap();
        assert!(text.contains(&format!("{name}.to_string()")), "{file}");
        listed.insert(name.to_owned());
    }
    assert_eq!(found, listed);
}

/// Returns the source text, with each message on the line where it begins.
fn source_lines() -> Vec<String> {
    let mut files = Vec::new();
    sources(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("src"),
        &mut files,
    );
    let mut lines = Vec::new();
    for path in files {
        let mut begun = String::new();
        for line in fs::read_to_string(path).unwrap().lines() {
            match line.strip_suffix('\\') {
                Some(start) => begun += start.trim_start(),
                None => lines.push(std::mem::take(&mut begun) + line.trim_start()),
            }
        }
    }
    lines
}

/// The page shortens messages, with an ellipsis for what varies.
#[test]
fn messages_of_the_book_are_those_of_the_program() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book/src/reference/errors.md");
    let page = fs::read_to_string(page).unwrap();
    let (_, table) = page.split_once("|---|---|---|\n").unwrap();
    let lines = source_lines();
    let mut missing = Vec::new();
    let mut checked = 0;
    for row in table.lines().take_while(|line| line.starts_with('|')) {
        let message = row.split('|').nth(1).unwrap().trim();
        let parts: Vec<&str> = message
            .split('…')
            .map(|part| part.trim_matches(['\'', ' ']))
            .filter(|part| !part.is_empty())
            .collect();
        let has_all = |line: &&String| {
            parts
                .iter()
                .try_fold(line.as_str(), |rest, part| {
                    rest.split_once(part).map(|(_, rest)| rest)
                })
                .is_some()
        };
        if !lines.iter().any(|line| has_all(&line)) {
            missing.push(message);
        }
        checked += 1;
    }
    assert_eq!(missing, [] as [&str; 0]);
    assert!(checked >= 20, "only {checked} messages were found");
}
