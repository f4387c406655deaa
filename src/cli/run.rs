use ostra_project::SegmenterId;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result};
use clap::{ArgMatches, CommandFactory, FromArgMatches};

use super::args::{Cli, Subcommand};
use super::drive::Driver;
use super::print::{finish, one_line, print_text, print_to_stderr};
use super::{
    bench, cloud, demo, eval, export, info, masks, memory, models, project, range, recipe, shot,
    sources, stop,
};
use ostra_compute::nn::Provider;
use ostra_session::Command;

/// Runs the program and returns its exit code: 0 done, 1 failed, 2 wrong usage, 130 stopped.
#[must_use]
pub fn main() -> ExitCode {
    memory::return_freed_memory();
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
        // After Ctrl+C a command may fail for another reason, such as a child process that ended
        // too.
        Err(_) if stop::is_requested() => {
            print_to_stderr(&format!("ostra: {}\n", stop::Interrupted));
            ExitCode::from(stop::EXIT_CODE)
        }
        Err(error) => {
            print_to_stderr(&format!("ostra: {}\n", one_line(&format!("{error:#}"))));
            ExitCode::FAILURE
        }
    }
}

fn run(cli: Cli, matches: &ArgMatches) -> Result<()> {
    Provider::from(cli.provider).choose();
    let Some(command) = cli.command else {
        return ostra_app::run(cli.path, demo::example);
    };
    stop::watch(if saves_nothing(&command) {
        Duration::ZERO
    } else {
        stop::TIME_TO_SAVE
    });
    match command {
        Subcommand::Demo(args) => demo::demo(&args),
        Subcommand::New(args) => {
            let new =
                sources::new_project(args.project, args.sources, subcommand_matches(matches)?)?;
            Driver::new().act_and_save([Command::New(new)])
        }
        Subcommand::Add(args) => {
            let new = sources::new_project(
                args.project.clone(),
                args.sources,
                subcommand_matches(matches)?,
            )?;
            Driver::open(&args.project)?.act_and_save([Command::AddFrames(new)])
        }
        Subcommand::Relocate(args) => project::relocate(args),
        Subcommand::Label(args) => project::label(args),
        Subcommand::Prompt(args) => masks::prompt(&args),
        Subcommand::Trace(args) => masks::trace(args),
        Subcommand::Clean(args) => masks::clean(&args),
        Subcommand::Ground(args) => masks::ground(&args),
        Subcommand::Masks(args) => masks::masks(args),
        Subcommand::Track(args) => project::track(&args),
        Subcommand::Range(args) => range::range(&args),
        Subcommand::Suggest { project, frame } => suggest(&project, frame),
        Subcommand::Reconstruct(args) => project::reconstruct(args),
        Subcommand::SelectModel(args) => project::select_model(&args),
        Subcommand::Scale(args) => project::scale(args),
        Subcommand::Fuse(args) => cloud::fuse(args),
        Subcommand::Conflicts(args) => cloud::conflicts(&args),
        Subcommand::Attach(args) => cloud::attach(&args),
        Subcommand::Instances(args) => cloud::instances(&args),
        Subcommand::Export(args) => export::export(args),
        Subcommand::Shot(args) => shot::shot(&args),
        Subcommand::Info(args) => info::info(&args),
        Subcommand::CleanCache { project } => info::clean_cache(&project),
        Subcommand::Eval(command) => eval::eval(command),
        Subcommand::Bench(args) => bench::bench(args),
        Subcommand::Models(command) => models::models(&command),
        Subcommand::Run {
            recipe: Some(recipe),
            ..
        } => recipe::run(&recipe),
        Subcommand::Run { recipe: None, .. } => recipe::print_schema(),
    }
}

/// Returns `true` if a command has nothing to save when it is stopped.
///
/// An export has: it removes the records of unfinished files, which the next export would otherwise
/// report as left by an interrupted one.
fn saves_nothing(command: &Subcommand) -> bool {
    matches!(
        command,
        Subcommand::Shot(_) | Subcommand::Info(_) | Subcommand::Eval(_) | Subcommand::Bench(_)
    )
}

fn subcommand_matches(matches: &ArgMatches) -> Result<&ArgMatches> {
    Ok(matches.subcommand().context("no command was given")?.1)
}

fn suggest(project: &Path, frame: Option<usize>) -> Result<()> {
    let mut driver = Driver::view(project)?;
    let propose = |frame| Command::Propose {
        frame,
        segmenter: SegmenterId::Auto,
    };
    driver.act(frame.map_or(Command::Suggest, propose))?;
    for found in driver.suggestions() {
        print_text(&format!(
            "{}, at {:.0},{:.0}\n",
            found.text(),
            found.at_px.x,
            found.at_px.y
        ));
    }
    Ok(())
}
