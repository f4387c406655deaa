//! Checks that no two types of a crate share a name.

use std::collections::BTreeMap;
use std::path::Path;

use super::architecture::is_test_module;
use super::import_circles::{product_code, rust_files};

/// Returns the names of the types that a file declares, without associated types.
///
/// The code is expected as rustfmt writes it: a block ends with a brace at its own indentation.
fn types(code: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut block_indent = None;
    for line in code.lines().map(str::trim_end) {
        let text = line.trim_start();
        let indent = line.len() - text.len();
        if block_indent == Some(indent) && text.starts_with('}') {
            block_indent = None;
        }
        let mut words = text
            .split_whitespace()
            .skip_while(|word| word.starts_with("pub") || *word == "unsafe");
        let keyword = words.next().unwrap_or_default();
        let declares = match keyword {
            "struct" | "enum" | "union" | "trait" => true,
            "type" => block_indent.is_none(),
            _ => false,
        };
        if declares && let Some(rest) = words.next() {
            let is_part = |letter: char| letter.is_alphanumeric() || letter == '_';
            found.extend(rest.split(|letter| !is_part(letter)).next());
        }
        let opens = keyword == "trait" || keyword == "impl" || keyword.starts_with("impl<");
        if opens && block_indent.is_none() && !text.ends_with('}') {
            block_indent = Some(indent);
        }
    }
    found
}

/// Returns the names that several types below `folder` have, each with the files.
fn shared_names(folder: &Path) -> Vec<String> {
    let mut files: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for path in rust_files(folder) {
        if is_test_module(&path) {
            continue;
        }
        let code = product_code(&std::fs::read_to_string(&path).unwrap());
        let below = path.strip_prefix(folder).unwrap().display().to_string();
        for name in types(&code) {
            files
                .entry(name.to_owned())
                .or_default()
                .push(below.clone());
        }
    }
    files
        .into_iter()
        .filter(|(_, files)| files.len() > 1)
        .map(|(name, files)| format!("{name}: {}", files.join(", ")))
        .collect()
}

#[test]
fn types_of_a_crate_have_different_names() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut wrong = Vec::new();
    for entry in std::fs::read_dir(&src).unwrap() {
        let folder = entry.unwrap().path();
        if folder.is_dir() {
            let crate_name = folder.file_name().unwrap().to_string_lossy().into_owned();
            let names = shared_names(&folder).into_iter();
            wrong.extend(names.map(|names| format!("{crate_name}: {names}")));
        }
    }
    wrong.sort();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn shared_name_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "lib.rs",
        "mod a;\nmod b;\npub trait Shape {\n    type Side;\n}\npub(crate) struct Side;\n",
    );
    write(
        "a.rs",
        "// struct Side;\nimpl<T> Shape for Vec<T> {\n    type Side = T;\n}\n",
    );
    write(
        "b.rs",
        "impl Shape for u8 {\n    type Side = u8;\n}\n\n#[cfg(test)]\nmod tests {\n    struct Side;\n}\n",
    );
    assert!(shared_names(folder.path()).is_empty());
    write("a.rs", "impl Shape for u8 {}\npub type Side<T> = Vec<T>;\n");
    assert_eq!(shared_names(folder.path()), ["Side: a.rs, lib.rs"]);
    write(
        "a.rs",
        "fn area() {\n    enum Side {\n        Left,\n    }\n}\n",
    );
    assert_eq!(shared_names(folder.path()), ["Side: a.rs, lib.rs"]);
    write("a.rs", "");
    write("b.rs", "#[cfg(test)]\nmod tests {}\n");
    write("lib.rs", "mod a;\n#[cfg(test)]\nmod b;\nstruct Side;\n");
    write("b.rs", "pub struct Side;\n");
    assert!(shared_names(folder.path()).is_empty(), "tests are left out");
}
