//! The book's pages about the command line agree with the program.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use clap::{Command, CommandFactory as _, Parser as _};

use super::args::Cli;
use book_pages::{commands, pages, words};

#[path = "../../tests/support/book_pages.rs"]
pub(super) mod book_pages;
#[path = "../../tests/support/generated_page.rs"]
mod generated_page;

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

#[test]
fn command_reference_is_up_to_date() {
    generated_page::check("reference/command-line.md", "command line", &reference());
}

#[test]
fn every_command_of_the_book_is_accepted() {
    let mut checked = 0;
    let mut refused = Vec::new();
    let readme = Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md");
    for path in pages().into_iter().chain([readme]) {
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
