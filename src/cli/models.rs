use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use super::print::{print_json, print_text, print_to_stderr, printable};
use super::stop;
use ostra_compute::nn::{
    Added, CheckedFile, Fetched, InstallOptions, ListedAddress, ModelStatus, TestResult,
    Verification,
};
use ostra_core::job::Progress;
use ostra_session::{
    NetworkTest, add_model, check_model, failed_test_text, install_model, list_addresses,
    list_models, not_run_text, remove_model, test_model,
};

#[derive(Debug, clap::Subcommand)]
pub(super) enum ModelsCommand {
    /// List known and installed networks.
    List {
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Download, install and test a network.
    Install {
        /// Name in the catalogue.
        name: String,
        /// Variant to install; the recommended one if not given.
        #[arg(long)]
        variant: Option<String>,
        /// Folder of files that were downloaded by other means.
        #[arg(long, value_name = "FOLDER")]
        from: Option<PathBuf>,
        /// Accept the licence of a network that asks for it.
        #[arg(long)]
        accept_licence: bool,
    },
    /// Install a network from files, and test it.
    Add {
        /// Name in the catalogue.
        name: String,
        /// Files of the network.
        #[arg(required = true)]
        files: Vec<PathBuf>,
    },
    /// Load an installed network, check its inputs and outputs, and test it.
    Check {
        /// Name in the catalogue.
        name: String,
    },
    /// Ask an installed network questions with known answers.
    Test {
        /// Name in the catalogue.
        name: String,
    },
    /// Delete the files of a network.
    Remove {
        /// Name in the catalogue.
        name: String,
    },
    /// List the files to download, for machines without a network connection.
    Addresses {
        /// Name in the catalogue; all networks if not given.
        name: Option<String>,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
}

pub(super) fn models(command: &ModelsCommand) -> Result<()> {
    match command {
        ModelsCommand::List { json } => {
            let rows = list_models()?;
            if *json {
                print_json(&serde_json::to_string(&rows)?);
            } else {
                rows.iter().for_each(|row| print_text(&lines(row)));
            }
        }
        ModelsCommand::Install {
            name,
            variant,
            from,
            accept_licence,
        } => {
            let options = InstallOptions {
                variant: variant.clone(),
                from: from.clone(),
                accept_licence: *accept_licence,
            };
            print_added(&install_model(name, &options, &mut progress())?);
            test(name)?;
        }
        ModelsCommand::Add { name, files } => {
            print_added(&add_model(name, files)?);
            test(name)?;
        }
        ModelsCommand::Check { name } => {
            check_model(name)?
                .iter()
                .for_each(|file| print_text(&checked(file)));
            test(name)?;
        }
        ModelsCommand::Test { name } => test(name)?,
        ModelsCommand::Remove { name } => remove_model(name)?
            .iter()
            .for_each(|path| print_text(&format!("{}: removed\n", path.display()))),
        ModelsCommand::Addresses { name, json } => {
            let listed = list_addresses(name.as_deref())?;
            if *json {
                print_json(&serde_json::to_string(&listed)?);
            } else {
                listed.iter().for_each(|file| print_text(&address(file)));
            }
        }
    }
    Ok(())
}

/// Tests an installed network.
///
/// # Errors
/// Fails if it does not run or its answers are wrong.
fn test(name: &str) -> Result<()> {
    match test_model(name, &Progress::default())? {
        NetworkTest::Passed(figures) => print_text(&format!("{name}: test passed: {figures}\n")),
        NetworkTest::Failed(what) => bail!(failed_test_text(name, &what)),
        NetworkTest::NotRun(why) => bail!(not_run_text(name, &why)),
        NetworkTest::Untested(why) => print_text(&format!("{name}: not tested: {why}\n")),
    }
    Ok(())
}

fn print_added(files: &[Added]) {
    files.iter().for_each(|added| {
        let digest = if added.is_known {
            String::new()
        } else {
            format!("; SHA-256 {}", added.sha256)
        };
        print_text(&format!(
            "{}: {}{digest}\n",
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

/// Returns the lines of a network in the list.
fn lines(row: &ModelStatus) -> String {
    let state = match &row.installed {
        Some(installed) => {
            let place = installed
                .paths
                .first()
                .map(|path| path.display().to_string())
                .unwrap_or_default();
            let variant = row
                .installed_variant
                .as_ref()
                .map_or(String::new(), |variant| format!(" ({variant})"));
            let test = match &row.tested {
                Some(TestResult::Passed) => "; test passed".to_owned(),
                Some(TestResult::Failed(what)) => {
                    format!("; not used, its test failed: {what}")
                }
                None => String::new(),
            };
            format!("{}{variant} in {place}{test}", megabytes(installed.bytes))
        }
        None if row.has_address => {
            let size = row.download_text();
            let size = size.map_or(String::new(), |size| format!(" {size}"));
            let server = row.server.as_deref();
            let server = server.map_or(String::new(), |server| format!(" from {server}"));
            format!("not installed, download{size}{server}")
        }
        None => format!("not installed, from files only: {}", row.source),
    };
    let variants: String = row
        .variants
        .iter()
        .filter(|_| row.variants.len() > 1)
        .map(|variant| {
            let size = variant.download_text();
            let memory = variant
                .memory_mb
                .map(|mb| format!("about {mb} MB of memory"));
            let facts: Vec<String> = [size, memory].into_iter().flatten().collect();
            format!(
                "{:<20}--variant {}: {} ({})\n",
                "",
                variant.name,
                variant.summary,
                facts.join(", ")
            )
        })
        .collect();
    format!(
        "{:<18} {} ({}): {state}\n{variants}",
        row.name, row.purpose, row.licence
    )
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

/// Returns the lines of a file to download.
fn address(file: &ListedAddress) -> String {
    let variant = if file.variant.is_empty() {
        String::new()
    } else {
        format!(" --variant {}", file.variant)
    };
    let bytes = file
        .bytes
        .map_or(String::new(), |bytes| format!("  {bytes} bytes"));
    let digest = file
        .sha256
        .as_ref()
        .map_or(String::new(), |digest| format!("  SHA-256 {digest}"));
    format!(
        "{}{variant}{bytes}{digest}\n  {}\n",
        file.network,
        file.urls.join("\n  or ")
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
