//! Checks the rules for `src/` that Cargo and clippy cannot check.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Identifiers, and the folders or files that may contain them.
const WORDS: &[(&str, &[&str])] = &[
    ("println!", &["cli/"]),
    ("eprintln!", &["cli/"]),
    ("print!", &["cli/"]),
    ("process::exit", &["cli/"]),
    ("ExitCode", &["cli/", "main.rs"]),
    // CPU stereo must not depend on the modules of its GPU twin.
    (
        "ostra_compute::gpu",
        &[
            "compute/",
            "reconstruct/stereo/gpu/",
            "reconstruct/stereo/error.rs",
            "session/",
        ],
    ),
];

/// Identifiers that geometry must not contain, because it has no side effects.
const IMPURE: &[&str] = &[
    "std::fs",
    "std::thread",
    "rayon",
    "std::time",
    "Instant",
    "image::",
    "ostra_core::disk",
    "ostra_core::job",
    "ostra_core::programs",
];

/// The part of geometry that uses rayon's pool; its result is the same for any number of threads.
const POOLED: &str = "geometry/bundle/";

struct Source {
    /// Path below `src/`, separated by `/`.
    path: String,
    /// Code without comments and test modules.
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
                let below = path
                    .strip_prefix(src())
                    .unwrap()
                    .to_string_lossy()
                    .replace('\\', "/");
                let is_test = is_test_module(&path);
                let product = if is_test {
                    ""
                } else {
                    text.split("#[cfg(test)]").next().unwrap_or_default()
                };
                found.push(Source {
                    path: below,
                    code: without_comments(product),
                    lines: text.lines().count(),
                });
            }
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    assert!(found.len() > 30, "the sources are found: {}", found.len());
    found
}

/// Returns whether the module, or a folder that contains it, is declared under `#[cfg(test)]`.
pub(super) fn is_test_module(path: &Path) -> bool {
    let named = |path: &Path| {
        path.file_stem()
            .map(|stem| stem.to_string_lossy().into_owned())
            .unwrap_or_default()
    };
    path.ancestors()
        .take_while(|above| *above != src())
        .any(|above| {
            let folder = above.parent().unwrap_or(above);
            let owners = [
                folder.join("mod.rs"),
                folder.join("lib.rs"),
                folder.with_extension("rs"),
            ];
            let owners = owners.into_iter().filter(|file| file != above);
            let declared = format!("#[cfg(test)]\nmod {};", named(above));
            owners
                .filter_map(|file| std::fs::read_to_string(file).ok())
                .any(|text| text.contains(&declared))
        })
}

/// Returns the code without comment lines.
fn without_comments(text: &str) -> String {
    text.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .collect::<Vec<_>>()
        .join("\n")
}

#[test]
fn identifiers_stay_in_their_modules() {
    let mut wrong = Vec::new();
    for source in sources() {
        for (word, homes) in WORDS {
            let message = source.code.match_indices(word).any(|(at, _)| {
                !source.code[..at].ends_with(|c: char| {
                    c.is_alphanumeric() || c == '_' || (c == 'e' && *word == "print!")
                })
            });
            let home = homes.iter().any(|home| source.path.starts_with(home));
            if message && !home {
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
fn files_are_short() {
    let long: Vec<String> = sources()
        .iter()
        .filter(|source| source.lines > 500)
        .map(|source| format!("{}: {}", source.path, source.lines))
        .collect();
    assert!(long.is_empty(), "above 500 lines: {long:#?}");
}

#[test]
fn module_roots_hold_only_documentation_and_declarations() {
    let is_root = |source: &&Source| {
        ["mod.rs", "lib.rs"]
            .iter()
            .any(|name| source.path.ends_with(name))
    };
    for source in sources().iter().filter(is_root) {
        let text = std::fs::read_to_string(src().join(&source.path)).unwrap();
        assert!(
            text.starts_with("//!"),
            "src/{} says nothing of what it holds",
            source.path
        );
        let defines = ["fn ", "struct ", "enum ", "impl "].iter().any(|word| {
            source
                .code
                .lines()
                .any(|line| line.trim_start_matches("pub ").starts_with(word))
        });
        assert!(!defines, "src/{}: code lives in named files", source.path);
    }
}

/// Returns the path and text of every shader module.
///
/// A file in a folder `shaders` is a module; a subfolder holds the parts of one module.
fn shaders() -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut folders = vec![src()];
    while let Some(folder) = folders.pop() {
        let mut paths: Vec<PathBuf> = std::fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        paths.sort();
        let texts = paths
            .iter()
            .filter(|path| path.extension().is_some_and(|ending| ending == "wgsl"));
        let texts = texts.map(|path| {
            (
                path.display().to_string(),
                std::fs::read_to_string(path).unwrap(),
            )
        });
        if folder
            .parent()
            .is_some_and(|above| above.ends_with("shaders"))
        {
            found.push((
                folder.display().to_string(),
                texts.map(|(_, text)| text).collect(),
            ));
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
    assert!(
        shaders.len() >= 4,
        "the shaders are found: {}",
        shaders.len()
    );
    for (path, text) in shaders {
        let module =
            naga::front::wgsl::parse_str(&text).unwrap_or_else(|error| panic!("{path}: {error}"));
        let mut validator =
            naga::valid::Validator::new(naga::valid::ValidationFlags::all(), Default::default());
        validator
            .validate(&module)
            .unwrap_or_else(|error| panic!("{path}: {error:?}"));
    }
}

/// Returns whether a licence expression of Cargo is met by allowed licences.
///
/// An expression is an `OR` (also written `/`) of `AND`s, with parentheses.
fn is_allowed(expression: &str, allowed: &BTreeSet<&str>) -> bool {
    let text = expression
        .replace('/', " OR ")
        .replace('(', " ( ")
        .replace(')', " ) ")
        .replace(" WITH ", "+WITH+");
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
        [name, rest @ ..] => (
            allowed.contains(name.replace("+WITH+", " WITH ").as_str()),
            rest,
        ),
        [] => (false, words),
    };
    let (mut met, mut rest) = one(words);
    while let ["AND", more @ ..] = rest {
        let (other, after) = one(more);
        (met, rest) = (met & other, after);
    }
    (met, rest)
}

/// Checks licences and sources without `cargo deny`, which also checks advisories over the network.
#[test]
fn dependencies_have_allowed_licences_and_come_from_the_registry() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let rules: toml::Table = std::fs::read_to_string(root.join(".deny.toml"))
        .unwrap()
        .parse()
        .unwrap();
    let allowed: BTreeSet<&str> = rules["licenses"]["allow"]
        .as_array()
        .unwrap()
        .iter()
        .map(|name| name.as_str().unwrap())
        .collect();
    assert!(
        is_allowed("(MIT OR GPL-2.0-only) AND Unicode-3.0", &allowed)
            && is_allowed("GPL-2.0-only/MIT", &allowed)
    );
    assert!(
        !is_allowed("MIT AND GPL-2.0-only", &allowed) && !is_allowed("(GPL-2.0-only)", &allowed)
    );
    let target = if cfg!(windows) {
        "x86_64-pc-windows-msvc"
    } else {
        "x86_64-unknown-linux-gnu"
    };
    let output = std::process::Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--locked",
            "--offline",
            "--filter-platform",
            target,
        ])
        .current_dir(root)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    assert!(packages.len() > 100);
    for package in packages
        .iter()
        .filter(|package| !package["name"].as_str().unwrap().starts_with("ostra"))
    {
        let (name, license) = (
            &package["name"],
            package["license"].as_str().unwrap_or("none"),
        );
        assert!(
            is_allowed(license, &allowed),
            "{name}: its licence {license} is not in .deny.toml"
        );
        let source = package["source"].as_str().unwrap_or("a path");
        assert!(
            source.starts_with("registry+https://github.com/rust-lang/crates.io-index"),
            "{name} is from {source}"
        );
    }
}
