use std::path::Path;

use anyhow::{Result, bail};

use super::args::ModelsVerb;
use super::print::say;
use crate::session::{CheckedFile, Proof, Row, add_model, check_model, list_models};

pub(super) fn models(verb: &ModelsVerb) -> Result<()> {
    match verb {
        ModelsVerb::List => list_models()?.iter().for_each(|row| say(&line(row))),
        ModelsVerb::Install { name } => bail!(
            "{name}: this version cannot fetch networks yet; get its files and give them with 'ostra models add {name} \
             FILE…'"
        ),
        ModelsVerb::Add { name, files } => {
            for added in add_model(name, files)? {
                say(&format!("{}: {}\n", added.path.display(), told(&added.proof)));
            }
        }
        ModelsVerb::Check { name } => check_model(name)?.iter().for_each(|file| say(&checked(file))),
    }
    Ok(())
}

fn line(row: &Row) -> String {
    let state = match &row.installed {
        Some(installed) => {
            let place = installed.paths.first().map(|path| path.display().to_string()).unwrap_or_default();
            format!("{:.1} MB in {place}", installed.bytes as f64 / 1e6)
        }
        None => "not installed".into(),
    };
    format!("{:<18} {} ({}): {state}\n", row.name, row.purpose, row.licence)
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
            let ports = signature.inputs.iter().map(|port| format!("  in  {port}\n"));
            let ports: String = ports.chain(signature.outputs.iter().map(|port| format!("  out {port}\n"))).collect();
            format!("{}: {verdict}\n{ports}", name(&file.path))
        }
    }
}
