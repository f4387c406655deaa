use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Subcommand;

use super::print::{printable, say, say_aside};
use super::stop;
use ostra_compute::nn::{Added, CheckedFile, Fetched, Proof, Row};
use ostra_session::{add_model, check_model, install_model, list_models};

#[derive(Debug, Subcommand)]
pub(super) enum ModelsVerb {
    /// What is known and what is installed.
    List,
    /// Get a network.
    Install {
        /// Its name in the catalogue.
        name: String,
    },
    /// Take a network from files.
    Add {
        /// Its name in the catalogue.
        name: String,
        /// Its files.
        #[arg(required = true)]
        files: Vec<PathBuf>,
    },
    /// Load a network and check its inputs and outputs.
    Check {
        /// Its name in the catalogue.
        name: String,
    },
}

pub(super) fn models(verb: &ModelsVerb) -> Result<()> {
    match verb {
        ModelsVerb::List => list_models()?.iter().for_each(|row| say(&line(row))),
        ModelsVerb::Install { name } => say_added(&install_model(name, &mut progress())?),
        ModelsVerb::Add { name, files } => say_added(&add_model(name, files)?),
        ModelsVerb::Check { name } => check_model(name)?
            .iter()
            .for_each(|file| say(&checked(file))),
    }
    Ok(())
}

fn say_added(files: &[Added]) {
    files.iter().for_each(|added| {
        say(&format!(
            "{}: {}\n",
            added.path.display(),
            told(&added.proof)
        ));
    });
}

/// Bytes after which it is said again how far a download is.
const SAID_EVERY: u64 = 10_000_000;

/// Says what is fetched and, now and then, how much of it is there.
fn progress() -> impl FnMut(Fetched<'_>) -> bool {
    let mut last = (String::new(), 0);
    move |now| {
        if last.0 != now.what || now.bytes >= last.1 + SAID_EVERY {
            let of = now.of.map_or(String::new(), |bytes| {
                format!(" of {:.1}", bytes as f64 / 1e6)
            });
            let there = (now.bytes > 0 || now.of.is_some())
                .then(|| format!(": {:.1}{of} MB", now.bytes as f64 / 1e6));
            say_aside(&printable(&format!(
                "{}{}\n",
                now.what,
                there.unwrap_or_default()
            )));
            last = (now.what.to_owned(), now.bytes);
        }
        !stop::is_requested()
    }
}

fn line(row: &Row) -> String {
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

fn told(proof: &Proof) -> String {
    match proof {
        Proof::Fits => "added; it loads and takes and gives what it should".into(),
        Proof::Loads => "added; it loads".into(),
        Proof::Known => "added; it is the file that is known".into(),
        Proof::None(why) => format!("added unchecked: {why}"),
    }
}

fn checked(file: &CheckedFile) -> String {
    let name = |path: &Path| path.display().to_string();
    match &file.signature {
        None => format!("{}: loads\n", name(&file.path)),
        Some(signature) => {
            let verdict = if file.is_compared { "fits" } else { "loads" };
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
