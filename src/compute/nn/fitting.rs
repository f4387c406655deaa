use std::path::PathBuf;

use super::catalogue::{CatalogueEntry, NetworkVariant};
use super::error::NnError;
use super::network::Network;
use super::network_file::{FileKind, NetworkFile};
use super::runtime::Runtime;

/// Loaded networks, and the variant of the catalogue whose interface they have.
pub(super) struct Fitting<'a> {
    pub variant: &'a NetworkVariant,
    /// One network per file that is not text or data.
    pub networks: Vec<Network>,
}

/// Returns the variants that have `count` files, `preferred` first.
pub(super) fn candidates<'a>(
    entry: &'a CatalogueEntry,
    preferred: Option<&str>,
    count: usize,
) -> Vec<&'a NetworkVariant> {
    let mut found: Vec<&NetworkVariant> = entry
        .variants()
        .iter()
        .filter(|variant| variant.files.len() == count)
        .collect();
    // Stable: the others stay in the order of the catalogue.
    found.sort_by_key(|variant| Some(variant.name.as_str()) != preferred);
    found
}

/// Loads the network files of `paths` and finds the first variant whose interface they have.
///
/// All variants have the same kinds of files in the same order.
///
/// # Errors
/// Fails if a file does not load. If no variant fits, the error is that of the most similar one.
pub(super) fn fit<'a>(
    runtime: &Runtime,
    variants: &[&'a NetworkVariant],
    paths: &[PathBuf],
) -> Result<Fitting<'a>, NnError> {
    let Some(first) = variants.first() else {
        return Err(NnError::Request(
            "no variant of this network has that many files".to_owned(),
        ));
    };
    let kinds = first.files.iter().map(|file| file.kind);
    let network_paths = kinds
        .zip(paths)
        .filter(|(kind, _)| *kind == FileKind::Network)
        .map(|(_, path)| path);
    let mut remaining = variants.to_vec();
    let mut networks = Vec::new();
    for (at, path) in network_paths.enumerate() {
        let network = Network::load(runtime, path, None)?;
        let mut closest: Option<(usize, NnError)> = None;
        remaining.retain(|variant| match misfit(variant, at, &network) {
            None => true,
            Some((missing, error)) => {
                if closest.as_ref().is_none_or(|(least, _)| missing < *least) {
                    closest = Some((missing, error));
                }
                false
            }
        });
        if let Some((_, error)) = closest.filter(|_| remaining.is_empty()) {
            return Err(error);
        }
        networks.push(network);
    }
    let variant = remaining.first().copied().unwrap_or(first);
    for (network, file) in networks.iter_mut().zip(network_files(variant)) {
        if let Some(expected) = &file.signature {
            network.read_only(&expected.outputs);
        }
    }
    Ok(Fitting { variant, networks })
}

fn network_files(variant: &NetworkVariant) -> impl Iterator<Item = &NetworkFile> {
    variant
        .files
        .iter()
        .filter(|file| file.kind == FileKind::Network)
}

/// Returns how the network at a place of a variant differs, and how many of its inputs are missing.
fn misfit(variant: &NetworkVariant, at: usize, network: &Network) -> Option<(usize, NnError)> {
    let file = network_files(variant).nth(at)?;
    let expected = file.signature.as_ref()?;
    let error = network.expect(expected).err()?;
    let has = |name: &str| {
        let mut inputs = network.signature().inputs.iter();
        inputs.any(|port| port.name == name)
    };
    let missing = expected.inputs.iter().filter(|port| !has(&port.name));
    Some((missing.count(), error))
}
