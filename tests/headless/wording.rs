//! Words that the project does not use, in documentation, comments and messages (CONTRIBUTING.md, "Style").

use std::fs;
use std::path::{Path, PathBuf};

/// Words, each with what is written instead.
pub(crate) const WORDS: [(&str, &str); 14] = [
    ("anew", "again"),
    ("amiss", "wrong"),
    ("beside", "next to, or besides"),
    ("film", "video"),
    ("films", "videos"),
    ("heed", "respect"),
    ("nobody", "no one, or name the subject"),
    ("nobody's", "not assigned"),
    ("picture", "image"),
    ("pictures", "images"),
    ("tells", "reports, shows or distinguishes"),
    ("told", "reported, given or known"),
    ("whoever", "name the subject"),
    ("wish", "request"),
];

fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, found);
        } else if path
            .extension()
            .is_some_and(|end| end == "md" || end == "rs" || end == "wgsl")
        {
            found.push(path);
        }
    }
}

/// Returns what is meant for people in a line: all of Markdown, comments and messages of code, without code in backticks.
fn prose(line: &str, is_code: bool) -> String {
    let text = if is_code {
        let comment = line.find("//").map(|at| line[at..].to_owned());
        let messages = line.split('"').skip(1).step_by(2);
        let messages = messages.filter(|message| message.contains(' '));
        let messages = messages.collect::<Vec<_>>().join(" \n ");
        format!("{} {messages}", comment.unwrap_or_default())
    } else {
        line.to_owned()
    };
    text.split('`').step_by(2).collect::<Vec<_>>().join(" ")
}

pub(crate) fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | '\'' | '-' | '/' | '.')))
        .map(|word| word.trim_matches(|c| matches!(c, '\'' | '-' | '.' | '/')))
}

#[test]
fn words_that_the_project_does_not_use_do_not_come_back() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files: Vec<PathBuf> = vec![root.join("README.md"), root.join("CONTRIBUTING.md")];
    for folder in ["src", "tests", "docs"] {
        collect(&root.join(folder), &mut files);
    }
    let mut found = Vec::new();
    for path in files {
        let name = path.strip_prefix(root).unwrap().display().to_string();
        if name.ends_with("wording.rs") || name == "CONTRIBUTING.md" {
            continue;
        }
        let is_code = !name.ends_with(".md");
        let text = fs::read_to_string(&path).unwrap();
        let mut is_block = false;
        for (number, line) in text.lines().enumerate() {
            is_block ^= line.trim_start().starts_with("```");
            if is_block && !is_code {
                continue;
            }
            let prose = prose(line, is_code).to_lowercase();
            for (word, instead) in WORDS {
                if words(&prose).any(|other| other == word) {
                    let number = number + 1;
                    found.push(format!(
                        "{name}:{number}: '{word}' ({instead}): {}",
                        line.trim()
                    ));
                }
            }
        }
    }
    assert!(
        found.is_empty(),
        "{} places\n{}",
        found.len(),
        found.join("\n")
    );
}
