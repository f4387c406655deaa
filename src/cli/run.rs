use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use clap::{ArgMatches, CommandFactory, FromArgMatches};

use super::args::{Cli, Verb};
use super::drive::Driver;
use super::print::{finish, one_line, say, say_aside};
use super::{
    cloud, demo, eval, export, info, masks, memory, models, project, range, shot, sources, stop,
};
use ostra_compute::nn::Provider;
use ostra_session::{Command, Recipe};

/// The program: reads the words, does the job, gives the exit code (0 done, 1 failed, 2 usage, 130 stopped).
#[must_use]
pub fn main() -> ExitCode {
    memory::return_what_is_freed();
    let matches = Cli::command().get_matches();
    let outcome = match Cli::from_arg_matches(&matches) {
        Ok(cli) => run(cli, &matches),
        Err(error) => error.exit(),
    };
    let outcome = outcome.and_then(|()| {
        finish().context("standard output cannot be written; check the disk's free space")
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        // A command that Ctrl+C ended may report what it met on the way, such as a helper program that ended too.
        Err(_) if stop::is_requested() => {
            say_aside(&format!("ostra: {}\n", stop::Interrupted));
            ExitCode::from(stop::EXIT_CODE)
        }
        Err(error) => {
            say_aside(&format!("ostra: {}\n", one_line(&format!("{error:#}"))));
            ExitCode::FAILURE
        }
    }
}

fn run(cli: Cli, matches: &ArgMatches) -> Result<()> {
    Provider::from(cli.provider).choose();
    let Some(verb) = cli.verb else {
        return ostra_app::run(cli.path);
    };
    stop::watch(if only_reads(&verb) {
        Duration::ZERO
    } else {
        stop::TIME_TO_SAVE
    });
    match verb {
        Verb::Demo(args) => demo::demo(&args),
        Verb::New(args) => {
            let new = sources::new_project(args.project, args.sources, of_verb(matches)?)?;
            Driver::new().act_and_save([Command::New(new)])
        }
        Verb::Add(args) => {
            let new = sources::new_project(args.project.clone(), args.sources, of_verb(matches)?)?;
            Driver::open(&args.project)?.act_and_save([Command::AddFrames(new)])
        }
        Verb::Relocate(args) => project::relocate(args),
        Verb::Label(args) => project::label(args),
        Verb::Prompt(args) => masks::prompt(&args),
        Verb::Trace(args) => masks::trace(args),
        Verb::Tidy(args) => masks::tidy(&args),
        Verb::Ground(args) => masks::ground(&args),
        Verb::Masks(args) => masks::masks(args),
        Verb::Track(args) => project::track(args),
        Verb::Range(args) => range::range(&args),
        Verb::Suggest { project, frame } => suggest(&project, frame),
        Verb::Reconstruct(args) => project::reconstruct(args),
        Verb::Scale(args) => project::scale(args),
        Verb::Fuse(args) => cloud::fuse(args),
        Verb::Doubt(args) => cloud::doubt(&args),
        Verb::Adopt(args) => cloud::adopt(&args),
        Verb::Instances(args) => cloud::instances(&args),
        Verb::Export(args) => export::export(args),
        Verb::Shot(args) => shot::shot(&args),
        Verb::Info(args) => info::info(&args),
        Verb::Eval(verb) => eval::eval(verb),
        Verb::Models(verb) => models::models(&verb),
        Verb::Run { recipe } => run_recipe(&recipe),
    }
}

/// Whether a command leaves every project as it is.
fn only_reads(verb: &Verb) -> bool {
    matches!(
        verb,
        Verb::Export(_) | Verb::Shot(_) | Verb::Info(_) | Verb::Eval(_)
    )
}

fn of_verb(matches: &ArgMatches) -> Result<&ArgMatches> {
    Ok(matches.subcommand().context("no command was given")?.1)
}

fn run_recipe(path: &Path) -> Result<()> {
    let text = ostra_core::disk::read_text(path)
        .with_context(|| format!("{}: cannot be read; check the path", path.display()))?;
    let recipe = read_recipe(&text)
        .with_context(|| format!("{}: is no recipe; save one from the window", path.display()))?;
    if recipe.format != 1 {
        bail!(
            "{}: the recipe has format {}, this program knows 1; get a newer ostra",
            path.display(),
            recipe.format
        );
    }
    Driver::new().act_and_save(recipe.commands)
}

/// A saved recipe, or the `recipe.jsonl` of a project: a command on each line.
fn read_recipe(text: &str) -> serde_json::Result<Recipe> {
    let saved = serde_json::from_str::<Recipe>(text);
    if saved.is_ok() {
        return saved;
    }
    let lines = text.lines().filter(|line| !line.trim().is_empty());
    let commands: serde_json::Result<Vec<Command>> = lines.map(serde_json::from_str).collect();
    match commands {
        Ok(commands) if !commands.is_empty() => Ok(Recipe {
            format: 1,
            commands,
        }),
        _ => saved,
    }
}

fn suggest(project: &Path, frame: Option<usize>) -> Result<()> {
    let mut driver = Driver::view(project)?;
    let propose = |frame| Command::Propose {
        frame,
        segmenter: "auto".into(),
    };
    driver.act(frame.map_or(Command::Suggest, propose))?;
    for found in driver.suggestions() {
        say(&format!(
            "{}, at {:.0},{:.0}\n",
            found.text(),
            found.at_px.x,
            found.at_px.y
        ));
    }
    Ok(())
}
