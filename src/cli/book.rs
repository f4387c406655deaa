//! The book's pages about the command line agree with the program.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{Command, CommandFactory as _, Parser as _};

use super::args::Cli;

/// Lines around the generated part of a page.
const MARK: &str = "<!-- generated: command line -->\n";

pub(super) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

/// Appends a section for `command` and one for each of its subcommands.
fn section(page: &mut String, command: &mut Command, path: &str, level: usize) {
    let about = command.get_about().map(ToString::to_string);
    let heading = "#".repeat(level);
    let _ = writeln!(page, "\n{heading} {path}\n");
    let _ = writeln!(page, "{}.\n", about.unwrap_or_default());
    // The short form describes everything but possible values.
    let help = match command.render_long_help().to_string() {
        long if long.contains("Possible values:") => long,
        _ => command.render_help().to_string(),
    };
    let usage = help.find("Usage:").map_or("", |start| &help[start..]);
    let lines = usage.lines().map(str::trim_end);
    let text = lines.collect::<Vec<_>>().join("\n");
    let _ = writeln!(page, "```text\n{}\n```", text.trim_end());
    for inner in command.get_subcommands_mut() {
        if inner.get_name() != "help" {
            let path = format!("{path} {}", inner.get_name());
            section(page, inner, &path, level + 1);
        }
    }
}

fn reference() -> String {
    let mut cli = Cli::command();
    cli.build();
    let mut page = String::from("\n| command | does |\n|---|---|\n");
    for command in cli.get_subcommands() {
        let name = command.get_name();
        if name != "help" {
            let about = command.get_about().map(ToString::to_string);
            let about = about.unwrap_or_default();
            let _ = writeln!(page, "| [`{name}`](#{name}) | {about} |");
        }
    }
    for command in cli.get_subcommands_mut() {
        if command.get_name() != "help" {
            let name = command.get_name().to_owned();
            section(&mut page, command, &name, 2);
        }
    }
    page.push('\n');
    page
}

/// All Markdown files of the book, and the README.
pub(super) fn pages() -> Vec<PathBuf> {
    let mut pages = vec![root().join("README.md")];
    let mut folders = vec![root().join("docs/book/src")];
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

/// Returns the `ostra` commands in the `sh` blocks of a page.
fn commands(page: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut lines = page.lines();
    while lines.by_ref().any(|line| line.trim_start() == "```sh") {
        let block = lines
            .by_ref()
            .take_while(|line| line.trim_start() != "```")
            .collect::<Vec<_>>()
            .join("\n")
            .replace("\\\n", " ");
        let is_ours = |line: &&str| line.starts_with("ostra ");
        found.extend(
            block
                .lines()
                .map(str::trim)
                .filter(is_ours)
                .map(String::from),
        );
    }
    found
}

/// Splits a command line at spaces outside of single quotes.
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
    words.retain(|word| !word.is_empty());
    words
}

#[test]
fn command_reference_is_up_to_date() {
    let path = root().join("docs/book/src/reference/command-line.md");
    let page = fs::read_to_string(&path).unwrap();
    let mut parts = page.split(MARK);
    let (before, now) = (parts.next().unwrap(), parts.next().unwrap());
    let after = parts.next().expect("the page has a mark at both ends");
    let generated = reference();
    if std::env::var_os("OSTRA_UPDATE_BOOK").is_some() {
        fs::write(&path, [before, &generated, after].join(MARK)).unwrap();
    } else {
        assert!(
            now == generated,
            "run `OSTRA_UPDATE_BOOK=1 cargo test book` to write the page again"
        );
    }
}

#[test]
fn every_command_of_the_book_is_accepted() {
    let mut checked = 0;
    let mut refused = Vec::new();
    for path in pages() {
        for line in commands(&fs::read_to_string(&path).unwrap()) {
            checked += 1;
            if let Err(error) = Cli::try_parse_from(words(&line)) {
                let name = path.file_name().unwrap_or_default().display();
                refused.push(format!("{name}: {line}\n{error}"));
            }
        }
    }
    assert!(refused.is_empty(), "{}", refused.join("\n"));
    assert!(checked > 80, "only {checked} commands were found");
}

#[test]
fn every_command_and_argument_has_a_help_text() {
    fn check(command: &Command, missing: &mut Vec<String>) {
        let name = command.get_name();
        if command
            .get_about()
            .is_none_or(|about| about.to_string().is_empty())
        {
            missing.push(name.to_owned());
        }
        for argument in command.get_arguments() {
            if argument
                .get_help()
                .is_none_or(|help| help.to_string().is_empty())
            {
                missing.push(format!("{name} {}", argument.get_id()));
            }
            for value in argument.get_possible_values() {
                assert!(!value.get_name().is_empty(), "{name} {}", argument.get_id());
            }
        }
        for inner in command.get_subcommands() {
            check(inner, missing);
        }
    }
    let mut cli = Cli::command();
    cli.build();
    let mut missing = Vec::new();
    check(&cli, &mut missing);
    assert!(missing.is_empty(), "without help: {missing:?}");
}
