use std::path::{Path, PathBuf};

use anyhow::Result;

use super::print::{print_text, print_to_stderr, printable};
use super::stop;
use ostra_compute::nn::{Added, CheckedFile, Fetched, ModelStatus, Verification};
use ostra_session::{add_model, check_model, install_model, list_models};

#[derive(Debug, clap::Subcommand)]
pub(super) enum ModelsCommand {
    /// List known and installed networks.
    List,
    /// Download and install a network.
    Install {
        /// Name in the catalogue.
        name: String,
    },
    /// Install a network from files.
    Add {
        /// Name in the catalogue.
        name: String,
        /// Files of the network.
        #[arg(required = true)]
        files: Vec<PathBuf>,
    },
    /// Load an installed network and check its inputs and outputs.
    Check {
        /// Name in the catalogue.
        name: String,
    },
}

pub(super) fn models(command: &ModelsCommand) -> Result<()> {
    match command {
        ModelsCommand::List => list_models()?.iter().for_each(|row| print_text(&line(row))),
        ModelsCommand::Install { name } => print_added(&install_model(name, &mut progress())?),
        ModelsCommand::Add { name, files } => print_added(&add_model(name, files)?),
        ModelsCommand::Check { name } => check_model(name)?
            .iter()
            .for_each(|file| print_text(&checked(file))),
    }
    Ok(())
}

fn print_added(files: &[Added]) {
    files.iter().for_each(|added| {
        print_text(&format!(
            "{}: {}\n",
            added.path.display(),
            verification_text(&added.proof)
        ));
    });
}

/// Bytes between two progress lines of a download.
const BYTES_PER_LINE: u64 = 10_000_000;

/// Returns a callback that prints the progress of downloads.
fn progress() -> impl FnMut(Fetched<'_>) -> bool {
    let mut last = (String::new(), 0);
    move |now| {
        if last.0 != now.what || now.bytes >= last.1 + BYTES_PER_LINE {
            let of = now.of.map_or(String::new(), |bytes| {
                format!(" of {:.1}", bytes as f64 / 1e6)
            });
            let there = (now.bytes > 0 || now.of.is_some())
                .then(|| format!(": {:.1}{of} MB", now.bytes as f64 / 1e6));
            print_to_stderr(&printable(&format!(
                "{}{}\n",
                now.what,
                there.unwrap_or_default()
            )));
            last = (now.what.to_owned(), now.bytes);
        }
        !stop::is_requested()
    }
}

fn line(row: &ModelStatus) -> String {
    let state = match &row.installed {
        Some(installed) => {
            let place = installed
                .paths
                .first()
                .map(|path| path.display().to_string())
                .unwrap_or_default();
            format!("{:.1} MB in {place}", installed.bytes as f64 / 1e6)
        }
        None => "not installed".into(),
    };
    format!(
        "{:<18} {} ({}): {state}\n",
        row.name, row.purpose, row.licence
    )
}

fn verification_text(proof: &Verification) -> String {
    match proof {
        Verification::Fits => "added; it loads, and its inputs and outputs are as expected".into(),
        Verification::Loads => "added; it loads".into(),
        Verification::Known => "added; it is the known file".into(),
        Verification::None(why) => format!("added without a check: {why}"),
    }
}

fn checked(file: &CheckedFile) -> String {
    let name = |path: &Path| path.display().to_string();
    match &file.signature {
        None => format!("{}: loads\n", name(&file.path)),
        Some(signature) => {
            let verdict = if file.is_compared {
                "inputs and outputs are as expected"
            } else {
                "loads"
            };
            let ports = signature
                .inputs
                .iter()
                .map(|port| format!("  in  {port}\n"));
            let ports: String = ports
                .chain(
                    signature
                        .outputs
                        .iter()
                        .map(|port| format!("  out {port}\n")),
                )
                .collect();
            format!("{}: {verdict}\n{ports}", name(&file.path))
        }
    }
}
