use serde::Serialize;

use super::catalogue::{Catalogue, CatalogueEntry};
use super::error::NnError;
use super::network_file::NetworkFile;
use super::runtime_package::RuntimePackage;

/// A file to download for a network, for machines without a network connection.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ListedAddress {
    /// Name of the network.
    pub network: String,
    /// Name of the variant; empty if there is only one.
    pub variant: String,
    /// Addresses with the same content, the preferred one first.
    pub urls: Vec<String>,
    /// Size in bytes, if known.
    pub bytes: Option<u64>,
    /// Digest, lower-case hexadecimal, if known.
    pub sha256: Option<String>,
}

/// Lists the files to download for one network, or for all that can be downloaded.
///
/// # Errors
/// Fails if the name is unknown, or the network has no download address.
pub fn addresses(catalogue: &Catalogue, name: Option<&str>) -> Result<Vec<ListedAddress>, NnError> {
    let Some(name) = name else {
        let all = catalogue.entries().iter().flat_map(of_entry);
        return Ok(all.collect());
    };
    let entry = catalogue.entry(name)?;
    let found = of_entry(entry);
    if found.is_empty() {
        return Err(entry.without_address());
    }
    Ok(found)
}

fn of_entry(entry: &CatalogueEntry) -> Vec<ListedAddress> {
    let mut listed = Vec::new();
    if entry.is_library()
        && let Ok(package) = RuntimePackage::for_this_system()
    {
        add(&mut listed, &entry.name, "", &package.file());
    }
    for variant in entry
        .variants()
        .iter()
        .filter(|variant| variant.has_address())
    {
        for file in &variant.files {
            add(&mut listed, &entry.name, &variant.name, file);
        }
    }
    listed
}

/// Adds the addresses of a file; an archive with several files is listed once.
fn add(listed: &mut Vec<ListedAddress>, network: &str, variant: &str, file: &NetworkFile) {
    let Some(first) = file.addresses.first() else {
        return;
    };
    let is_there = |known: &ListedAddress| known.variant == variant && known.urls[0] == first.url;
    if listed.iter().any(is_there) {
        return;
    }
    let (bytes, sha256) = if first.is_packed() {
        (first.bytes, first.sha256.clone())
    } else {
        (file.bytes, file.sha256.clone())
    };
    // Other addresses may have the file in another form, whose size and digest differ.
    let urls = if first.is_packed() {
        vec![first.url.clone()]
    } else {
        let same = file.addresses.iter().filter(|other| !other.is_packed());
        same.map(|address| address.url.clone()).collect()
    };
    listed.push(ListedAddress {
        network: network.to_owned(),
        variant: variant.to_owned(),
        urls,
        bytes,
        sha256,
    });
}
