use super::super::{Catalogue, Element};
use super::networks;
use crate::nn::digests::sha256;

#[test]
fn every_network_has_files_and_known_elements() {
    let catalogue = Catalogue::bundled().unwrap();
    let names: Vec<&str> = catalogue
        .entries()
        .iter()
        .map(|entry| entry.name.as_str())
        .collect();
    let expected = "onnxruntime sam-vit-b mobile-sam efficient-sam grounding-dino xmem deaot superpoint \
                    superglue-indoor superglue-outdoor xfeat lighterglue yolox";
    assert_eq!(names.join(" "), expected);
    for entry in catalogue.entries() {
        assert_eq!(
            entry.files().is_empty(),
            entry.is_library(),
            "{}",
            entry.name
        );
        assert!(
            !entry.purpose.is_empty()
                && !entry.licence.is_empty()
                && entry.source.starts_with("https://")
        );
        for signature in entry
            .files()
            .iter()
            .filter_map(super::super::NetworkFile::signature)
        {
            let mut ports = signature.inputs.iter().chain(&signature.outputs);
            assert!(
                ports.all(|port| !matches!(port.element, Element::Other(_))),
                "{}",
                entry.name
            );
        }
    }
}

#[test]
fn file_names_are_unique() {
    let catalogue = Catalogue::bundled().unwrap();
    let mut names: Vec<String> = catalogue
        .entries()
        .iter()
        .flat_map(super::super::CatalogueEntry::file_names)
        .collect();
    let count = names.len();
    names.sort();
    names.dedup();
    assert_eq!(
        names.len(),
        count,
        "one would overwrite the other: {names:?}"
    );
}

#[test]
fn error_for_an_unknown_name_lists_the_known_ones() {
    let error = Catalogue::bundled()
        .unwrap()
        .entry("xfaet")
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("`xfaet`") && error.contains("xfeat, lighterglue"),
        "{error}"
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn known_digests_match_the_files() {
    let folder = networks();
    let catalogue = Catalogue::bundled().unwrap();
    let files = catalogue
        .entries()
        .iter()
        .flat_map(super::super::CatalogueEntry::files);
    let known: Vec<_> = files.filter(|file| file.sha256.is_some()).collect();
    assert_eq!(known.len(), 5);
    for file in known.iter().filter(|file| folder.join(&file.name).exists()) {
        let found = sha256(&folder.join(&file.name)).unwrap();
        assert!(
            file.sha256.as_ref() == Some(&found) || file.other_sha256.contains(&found),
            "{}",
            file.name
        );
    }
}

#[test]
fn files_with_an_address_have_a_digest_and_size() {
    let catalogue = Catalogue::bundled().unwrap();
    for file in catalogue
        .entries()
        .iter()
        .flat_map(super::super::CatalogueEntry::files)
        .filter(|file| file.url.is_some())
    {
        let digest = file.sha256.as_deref().unwrap_or_default();
        assert!(
            file.url
                .as_deref()
                .is_some_and(|url| url.starts_with("https://")),
            "{}",
            file.name
        );
        assert!(
            digest.len() == 64 && file.bytes.is_some(),
            "{} could not be verified",
            file.name
        );
    }
}
