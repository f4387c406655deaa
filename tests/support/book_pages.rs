//! The commands in the pages of the book.

use std::fs;
use std::path::{Path, PathBuf};

/// A code block of a page.
pub struct Block {
    /// What stands after the opening fence, such as `sh`.
    pub kind: String,
    /// Lines without indentation; a line that ends with a backslash is joined with the next one.
    pub lines: Vec<String>,
}

/// Returns the code blocks of a page.
pub fn blocks(page: &str) -> Vec<Block> {
    let mut found = Vec::new();
    let mut lines = page.lines().map(str::trim);
    while let Some(line) = lines.next() {
        if let Some(kind) = line.strip_prefix("```") {
            let inside = lines.by_ref().take_while(|line| *line != "```");
            let inside = inside.collect::<Vec<_>>().join("\n").replace("\\\n", " ");
            found.push(Block {
                kind: kind.to_owned(),
                lines: inside.lines().map(|line| line.trim().to_owned()).collect(),
            });
        }
    }
    found
}

/// Returns the `ostra` commands in the `sh` blocks of a page, each pass of a loop by itself.
pub fn commands(page: &str) -> Vec<String> {
    let blocks = blocks(page).into_iter().filter(|block| block.kind == "sh");
    blocks
        .flat_map(|block| without_loops(&block.lines))
        .filter(|line| line.starts_with("ostra "))
        .collect()
}

/// Writes out loops of the form `for s in one two; do` … `done`.
fn without_loops(lines: &[String]) -> Vec<String> {
    let mut written = Vec::new();
    let mut lines = lines.iter();
    while let Some(line) = lines.next() {
        let head = line.strip_prefix("for ").and_then(|head| {
            let (variable, values) = head.strip_suffix("; do")?.split_once(" in ")?;
            Some((format!("${variable}"), values))
        });
        let Some((variable, values)) = head else {
            written.push(line.clone());
            continue;
        };
        let body: Vec<&String> = lines.by_ref().take_while(|line| *line != "done").collect();
        for value in values.split_whitespace() {
            written.extend(body.iter().map(|line| line.replace(&variable, value)));
        }
    }
    written
}

/// Splits a command line at spaces outside of quotes.
pub fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut quote = None;
    for c in line.chars() {
        match (c, quote) {
            ('\'' | '"', None) => quote = Some(c),
            (_, Some(open)) if c == open => quote = None,
            (' ', None) => words.push(String::new()),
            _ => words.last_mut().unwrap().push(c),
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

/// Returns all Markdown files of the book in a fixed order.
pub fn pages() -> Vec<PathBuf> {
    let mut pages = Vec::new();
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book/src")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.extension() {
                None if path.is_dir() => folders.push(path),
                Some(ending) if ending == "md" => pages.push(path),
                _ => {}
            }
        }
    }
    pages.sort();
    pages
}
