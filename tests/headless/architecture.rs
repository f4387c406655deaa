//! Holds the room table of `docs/ARCHITECTURE.md` against `src/`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Room → rooms it may name. Sub-rooms with rules of their own stand before the room they lie in.
const ROOMS: &[(&str, &[&str])] = &[
    ("engine/disk", &[]),
    ("engine/job", &[]),
    ("engine/programs", &[]),
    ("engine/nn", &["engine::disk", "engine::programs"]),
    ("engine/gpu", &[]),
    ("geometry", &[]),
    ("frames", &["geometry", "engine::disk", "engine::job", "engine::programs"]),
    ("masks/onnx", &["masks", "frames", "engine::disk", "engine::job", "engine::nn"]),
    ("masks", &["frames", "engine::disk", "engine::job"]),
    ("scene/sfm/onnx", &["scene", "engine::nn"]),
    ("scene/stereo/gpu", &["scene", "engine::job", "engine::gpu"]),
    ("scene", &["masks", "frames", "geometry", "engine::disk", "engine::job"]),
    ("session", &["scene", "masks", "frames", "geometry", "engine::disk", "engine::job", "engine::nn", "engine::gpu"]),
    ("view", &["scene", "masks", "frames", "geometry", "engine::disk", "engine::gpu"]),
    ("app", &["engine::disk", "session", "view", "scene", "masks", "frames", "geometry"]),
    (
        "cli",
        &[
            "engine::disk",
            "engine::job",
            "engine::programs",
            "app",
            "session",
            "view",
            "scene",
            "masks",
            "frames",
            "geometry",
        ],
    ),
];

/// Word → rooms that may say it.
const WORDS: &[(&str, &[&str])] = &[
    ("ort::", &["engine/nn"]),
    ("egui::", &["app"]),
    ("eframe::", &["app"]),
    ("egui_wgpu::", &["app"]),
    ("wgpu::", &["engine/gpu", "view"]),
    ("println!", &["cli"]),
    ("eprintln!", &["cli"]),
    ("print!", &["cli"]),
    ("process::exit", &["cli"]),
    ("ExitCode", &["cli"]),
    ("rfd::", &["app", "session"]),
];

/// Words that geometry, being pure, must not say.
const IMPURE: &[&str] = &["std::fs", "std::thread", "rayon", "std::time", "Instant", "image::"];

/// The part of geometry that shares rayon's pool; its result is the same for any number of threads.
const POOLED: &str = "geometry/bundle/";

struct Source {
    /// Path below `src/`, with `/`.
    path: String,
    /// Without comments and test modules.
    code: String,
    lines: usize,
}

fn src() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn sources() -> Vec<Source> {
    let mut found = Vec::new();
    let mut folders = vec![src()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                let below = path.strip_prefix(src()).unwrap().to_string_lossy().replace('\\', "/");
                let is_test = is_test_module(&path);
                let code = if is_test { String::new() } else { product_code(&text) };
                found.push(Source { path: below, code, lines: text.lines().count() });
            }
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    assert!(found.len() > 30, "the sources are found: {}", found.len());
    found
}

/// Whether the module, or a folder it lies in, is declared under `#[cfg(test)]`.
fn is_test_module(path: &Path) -> bool {
    let named = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    path.ancestors().take_while(|above| *above != src()).any(|above| {
        let declared_in = above.parent().map(|folder| folder.join("mod.rs"));
        let owner = declared_in.filter(|file| file != above).and_then(|file| std::fs::read_to_string(file).ok());
        owner.is_some_and(|text| text.contains(&format!("#[cfg(test)]\nmod {};", named(above))))
    })
}

/// The code without comment lines and without what follows `#[cfg(test)]`.
fn product_code(text: &str) -> String {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

fn room_of(path: &str) -> Option<&'static (&'static str, &'static [&'static str])> {
    ROOMS.iter().find(|(room, _)| path.starts_with(&format!("{room}/")))
}

/// Rooms named as `crate::room…` in the code; `engine::job` and its like with both parts.
fn rooms_named(code: &str) -> BTreeSet<String> {
    let mut named = BTreeSet::new();
    for rest in code.split("crate::").skip(1) {
        assert!(
            !rest.starts_with('{') && !rest.starts_with('*'),
            "name one room per `use crate::`: {}",
            &rest[..40.min(rest.len())]
        );
        let words: Vec<&str> =
            rest.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|w| !w.is_empty()).collect();
        let Some(&first) = words.first() else { continue };
        named.insert(if first == "engine" {
            format!("engine::{}", words.get(1).unwrap_or(&""))
        } else {
            first.to_owned()
        });
    }
    named
}

#[test]
fn every_import_points_down() {
    let mut wrong = Vec::new();
    for source in sources() {
        let Some((room, allowed)) = room_of(&source.path) else { continue };
        let own = room.replace('/', "::");
        let own_top = room.split('/').next().unwrap_or(room);
        for named in rooms_named(&source.code) {
            let within = named == own || (named == own_top && !own.starts_with("engine"));
            if !within && !allowed.contains(&named.as_str()) {
                wrong.push(format!("src/{} names {named}", source.path));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn words_stay_in_their_rooms() {
    let mut wrong = Vec::new();
    for source in sources() {
        for (word, rooms) in WORDS {
            let said = source.code.match_indices(word).any(|(at, _)| {
                !source.code[..at]
                    .ends_with(|c: char| c.is_alphanumeric() || c == '_' || (c == 'e' && *word == "print!"))
            });
            let home =
                rooms.iter().any(|room| source.path.starts_with(&format!("{room}/"))) || source.path == "main.rs";
            if said && !home {
                wrong.push(format!("src/{} says {word}", source.path));
            }
        }
        if source.path.starts_with("geometry/") {
            wrong.extend(
                IMPURE
                    .iter()
                    .filter(|word| source.code.contains(**word))
                    .filter(|word| **word != "rayon" || !source.path.starts_with(POOLED))
                    .map(|word| format!("src/{} says {word}", source.path)),
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn only_scene_gpu_twins_name_the_gpu() {
    let twins: Vec<String> = sources()
        .into_iter()
        .filter(|source| source.path.starts_with("scene/") && source.code.contains("engine::gpu"))
        .map(|source| source.path)
        .collect();
    assert!(twins.iter().all(|path| path.contains("/gpu/")), "{twins:?}");
}

#[test]
fn files_are_short() {
    let long: Vec<String> = sources()
        .iter()
        .filter(|source| source.lines > 500)
        .map(|source| format!("{}: {}", source.path, source.lines))
        .collect();
    assert!(long.is_empty(), "above 500 lines: {long:#?}");
}

#[test]
fn every_room_has_its_sign_and_nothing_but_it() {
    for source in sources().iter().filter(|source| source.path.ends_with("mod.rs")) {
        let text = std::fs::read_to_string(src().join(&source.path)).unwrap();
        assert!(text.starts_with("//!"), "src/{} has no sign", source.path);
        let defines = ["fn ", "struct ", "enum ", "impl "]
            .iter()
            .any(|word| source.code.lines().any(|line| line.trim_start_matches("pub ").starts_with(word)));
        assert!(!defines, "src/{}: code lives in named files", source.path);
        if source.path.matches('/').count() == 1 && source.path != "engine/mod.rs" {
            assert!(
                text.contains("May use") && text.contains("Must not touch"),
                "src/{}: the sign says what the room may use",
                source.path
            );
        }
    }
}

/// A file in a folder `shaders` is a module; a folder below one holds the parts of a module.
fn shaders() -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut folders = vec![src()];
    while let Some(folder) = folders.pop() {
        let mut paths: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        let texts = paths.iter().filter(|path| path.extension().is_some_and(|ending| ending == "wgsl"));
        let texts = texts.map(|path| (path.display().to_string(), std::fs::read_to_string(path).unwrap()));
        if folder.parent().is_some_and(|above| above.ends_with("shaders")) {
            found.push((folder.display().to_string(), texts.map(|(_, text)| text).collect()));
        } else {
            found.extend(texts);
        }
        folders.extend(paths.into_iter().filter(|path| path.is_dir()));
    }
    found
}

#[test]
fn every_shader_is_valid() {
    let shaders = shaders();
    assert!(shaders.len() >= 4, "the shaders are found: {}", shaders.len());
    for (path, text) in shaders {
        let module = naga::front::wgsl::parse_str(&text).unwrap_or_else(|error| panic!("{path}: {error}"));
        let mut validator = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), Default::default());
        validator.validate(&module).unwrap_or_else(|error| panic!("{path}: {error:?}"));
    }
}

/// Whether a licence expression of Cargo is met by allowed licences: `OR` (also written `/`) of `AND`s, with parentheses.
fn is_allowed(expression: &str, allowed: &BTreeSet<&str>) -> bool {
    let text = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ").replace(" WITH ", "+WITH+");
    let words: Vec<&str> = text.split_whitespace().collect();
    let (met, rest) = any_of(&words, allowed);
    assert!(rest.is_empty(), "{expression} is not understood");
    met
}

fn any_of<'w, 'a>(words: &'a [&'w str], allowed: &BTreeSet<&str>) -> (bool, &'a [&'w str]) {
    let (mut met, mut rest) = all_of(words, allowed);
    while let ["OR", more @ ..] = rest {
        let (other, after) = all_of(more, allowed);
        (met, rest) = (met | other, after);
    }
    (met, rest)
}

fn all_of<'w, 'a>(words: &'a [&'w str], allowed: &BTreeSet<&str>) -> (bool, &'a [&'w str]) {
    let one = |words: &'a [&'w str]| match words {
        ["(", inner @ ..] => {
            let (met, rest) = any_of(inner, allowed);
            (met, &rest[1..])
        }
        [name, rest @ ..] => (allowed.contains(name.replace("+WITH+", " WITH ").as_str()), rest),
        [] => (false, words),
    };
    let (mut met, mut rest) = one(words);
    while let ["AND", more @ ..] = rest {
        let (other, after) = one(more);
        (met, rest) = (met & other, after);
    }
    (met, rest)
}

/// `cargo deny` also looks for advisories, for which it needs the network; licences and sources are known here.
#[test]
fn dependencies_have_allowed_licences_and_come_from_the_registry() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let rules: toml::Table = std::fs::read_to_string(root.join(".deny.toml")).unwrap().parse().unwrap();
    let allowed: BTreeSet<&str> =
        rules["licenses"]["allow"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    assert!(is_allowed("(MIT OR GPL-2.0-only) AND Unicode-3.0", &allowed) && is_allowed("GPL-2.0-only/MIT", &allowed));
    assert!(!is_allowed("MIT AND GPL-2.0-only", &allowed) && !is_allowed("(GPL-2.0-only)", &allowed));
    let target = if cfg!(windows) { "x86_64-pc-windows-msvc" } else { "x86_64-unknown-linux-gnu" };
    let output = std::process::Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline", "--filter-platform", target])
        .current_dir(root)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    assert!(packages.len() > 100);
    for package in packages.iter().filter(|package| package["name"] != "ostra") {
        let (name, license) = (&package["name"], package["license"].as_str().unwrap_or("none"));
        assert!(is_allowed(license, &allowed), "{name}: its licence {license} is not in .deny.toml");
        let source = package["source"].as_str().unwrap_or("a path");
        assert!(source.starts_with("registry+https://github.com/rust-lang/crates.io-index"), "{name} is from {source}");
    }
}
