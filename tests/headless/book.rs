//! The book: its links lead somewhere, its pages are short, and it holds every page that it lists.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Lines that a page has at most, but for tables in the reference that are made from the program.
const MAX_LINES: usize = 120;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

fn markdown_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            markdown_below(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "md") {
            found.push(path);
        }
    }
}

fn pages() -> Vec<PathBuf> {
    let mut found = Vec::new();
    markdown_below(&root().join("docs"), &mut found);
    for name in [
        "README.md",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "CHANGELOG.md",
    ] {
        found.push(root().join(name));
    }
    found.sort();
    found
}

/// Returns the lines of a page outside of code blocks.
fn prose(page: &str) -> Vec<&str> {
    let mut is_code = false;
    page.lines()
        .filter(|line| {
            let is_fence = line.trim_start().starts_with("```");
            is_code ^= is_fence;
            !is_code && !is_fence
        })
        .collect()
}

/// Returns the anchors of a page's headings, as GitHub and mdBook make them.
fn anchors(page: &str) -> BTreeSet<String> {
    prose(page)
        .into_iter()
        .filter(|line| line.starts_with('#'))
        .map(|line| {
            let text = line.trim_start_matches('#').trim().to_lowercase();
            let kept = text
                .chars()
                .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
            kept.map(|c| if c == ' ' { '-' } else { c }).collect()
        })
        .collect()
}

/// Returns the targets of the links and images of a page.
fn links(page: &str) -> Vec<String> {
    let text = prose(page).join("\n");
    let mut found = Vec::new();
    let mut rest = text.as_str();
    while let Some(start) = rest.find("](") {
        rest = &rest[start + 2..];
        if let Some(end) = rest.find(')') {
            found.push(rest[..end].to_owned());
        }
    }
    found
}

#[test]
fn every_link_of_the_documentation_resolves() {
    let mut broken = Vec::new();
    let mut checked = 0;
    for path in pages() {
        let page = fs::read_to_string(&path).unwrap();
        for link in links(&page) {
            if link.starts_with("https://") || link.starts_with("mailto:") {
                continue;
            }
            checked += 1;
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = match file {
                "" => path.clone(),
                _ => path.parent().unwrap().join(file),
            };
            let is_there = match fs::read_to_string(&target) {
                _ if anchor.is_empty() => target.exists(),
                Ok(other) => anchors(&other).contains(anchor),
                Err(_) => false,
            };
            if !is_there {
                let name = path.strip_prefix(root()).unwrap().display().to_string();
                broken.push(format!("{name}: {link}"));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    assert!(checked > 100, "only {checked} links were found");
}

#[test]
fn the_summary_lists_every_page_of_the_book_once() {
    let book = root().join("docs/book/src");
    let summary = fs::read_to_string(book.join("SUMMARY.md")).unwrap();
    let mut listed = links(&summary);
    listed.sort();
    let mut there = Vec::new();
    markdown_below(&book, &mut there);
    let mut there: Vec<String> = there
        .iter()
        .map(|path| path.strip_prefix(&book).unwrap().display().to_string())
        .filter(|name| name != "SUMMARY.md")
        .collect();
    there.sort();
    assert_eq!(listed, there);
}

#[test]
fn pages_of_the_book_are_short() {
    let mut found = Vec::new();
    markdown_below(&root().join("docs/book/src"), &mut found);
    let mut long = Vec::new();
    for path in found {
        let page = fs::read_to_string(&path).unwrap();
        let is_generated = page.contains("<!-- generated:");
        let lines = page.lines().count();
        if lines > MAX_LINES && !is_generated {
            long.push(format!("{}: {lines} lines", path.display()));
        }
    }
    assert!(long.is_empty(), "{}", long.join("\n"));
}

/// Returns all files of the repository below a folder, with `/` between folders.
fn files_below(folder: &Path, found: &mut Vec<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files_below(&path, found);
        } else {
            let name = path.strip_prefix(root()).unwrap();
            let parts = name.components().map(std::path::Component::as_os_str);
            let parts: Vec<_> = parts.map(|part| part.to_string_lossy()).collect();
            found.push(parts.join("/"));
        }
    }
}

#[test]
fn files_named_in_the_documentation_exist() {
    let mut files = Vec::new();
    for folder in ["src", "tests", "docs", "assets"] {
        files_below(&root().join(folder), &mut files);
    }
    let is_path = |text: &str| {
        let has_plain_letters = text
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || matches!(c, '/' | '_' | '-' | '.'));
        let is_below = ["src/", "tests/", "docs/", "assets/"];
        let is_below = is_below.iter().any(|folder| text.starts_with(folder));
        has_plain_letters && (is_below || text.ends_with(".rs"))
    };
    let mut missing = Vec::new();
    let mut checked = 0;
    for path in pages() {
        if path.ends_with("CHANGELOG.md") {
            continue;
        }
        let page = fs::read_to_string(&path).unwrap();
        let text = prose(&page).join("\n");
        for name in text
            .split('`')
            .skip(1)
            .step_by(2)
            .filter(|text| is_path(text))
        {
            checked += 1;
            let name = name.trim_end_matches('/');
            let is_there = files.iter().any(|file| {
                file == name
                    || file.ends_with(&format!("/{name}"))
                    || file.starts_with(&format!("{name}/"))
            });
            if !is_there {
                missing.push(format!("{}: {name}", path.display()));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    assert!(checked > 40, "only {checked} names were found");
}
