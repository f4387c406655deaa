use super::super::{Catalogue, CatalogueEntry, Dialect, Element, FileKind, NetworkFile};
use super::networks;
use crate::nn::digests::sha256;

/// Returns the files of all variants.
fn files_of(entry: &CatalogueEntry) -> impl Iterator<Item = &NetworkFile> {
    entry.variants().iter().flat_map(|variant| &variant.files)
}

#[test]
fn every_network_has_files_and_known_elements() {
    let catalogue = Catalogue::bundled().unwrap();
    let names: Vec<&str> = catalogue
        .entries()
        .iter()
        .map(|entry| entry.name.as_str())
        .collect();
    let expected = "onnxruntime sam-vit-b mobile-sam sam2.1-tiny sam2.1-small sam2.1-base-plus sam2.1-large \
                    efficient-sam grounding-dino xmem deaot superpoint superglue-indoor superglue-outdoor xfeat \
                    lighterglue aliked aliked-lightglue sift-lightglue yolox";
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
        for signature in files_of(entry).filter_map(|file| file.signature.as_ref()) {
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
        .flat_map(CatalogueEntry::file_names)
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
    let files = catalogue.entries().iter().flat_map(files_of);
    let here: Vec<_> = files
        .filter(|file| file.sha256.is_some() && folder.join(&file.name).exists())
        .collect();
    assert!(here.len() >= 3, "{here:?}");
    for file in here {
        let found = sha256(&folder.join(&file.name)).unwrap();
        assert!(file.knows(&found), "{}", file.name);
    }
}

#[test]
fn addresses_have_https_and_complete_digests() {
    let catalogue = Catalogue::bundled().unwrap();
    let files = catalogue.entries().iter().flat_map(files_of);
    let with_address = files.filter(|file| !file.addresses.is_empty());
    let mut count = 0;
    for file in with_address {
        count += 1;
        let is_digest =
            |digest: &str| digest.len() == 64 && digest.bytes().all(|b| b.is_ascii_hexdigit());
        assert!(
            file.sha256.as_deref().is_some_and(is_digest),
            "{} could not be verified",
            file.name
        );
        for address in &file.addresses {
            assert!(address.url.starts_with("https://"), "{}", address.url);
            if address.is_packed() {
                assert!(address.sha256.as_deref().is_some_and(is_digest));
                assert!(address.bytes.is_some(), "{}", address.url);
            }
        }
    }
    assert!(count > 15);
}

#[test]
fn every_download_has_a_size() {
    let catalogue = Catalogue::bundled().unwrap();
    let entries = catalogue.entries().iter();
    let variants = entries.flat_map(|entry| entry.variants().iter().map(move |one| (entry, one)));
    for (entry, variant) in variants.filter(|(_, variant)| variant.has_address()) {
        let sizes = [variant.download_bytes(), variant.about_bytes()];
        assert_eq!(
            sizes.iter().flatten().count(),
            1,
            "{}: {sizes:?}",
            entry.name
        );
    }
    let aliked = catalogue.entry("aliked").unwrap();
    let [n16rot, n32] = [0, 1].map(|at| &aliked.variants()[at]);
    assert_eq!(n16rot.download_bytes(), Some(2_997_054));
    assert_eq!(n32.about_bytes(), Some(4_000_000));
}

#[test]
fn variants_of_a_network_have_the_same_files() {
    let catalogue = Catalogue::bundled().unwrap();
    for entry in catalogue.entries() {
        let shape = |files: &[NetworkFile]| -> Vec<(String, FileKind)> {
            let kept = files.iter().filter(|file| file.kind != FileKind::Data);
            kept.map(|file| (file.name.clone(), file.kind)).collect()
        };
        let mut names = Vec::new();
        for variant in entry.variants() {
            assert_eq!(
                shape(&variant.files),
                shape(entry.files()),
                "{}",
                entry.name
            );
            assert!(!names.contains(&&variant.name), "{}", entry.name);
            names.push(&variant.name);
        }
    }
}

#[test]
fn segment_anything_can_be_installed_in_every_size() {
    let catalogue = Catalogue::bundled().unwrap();
    let expected = [
        ("sam-vit-b", Dialect::SamHwc),
        ("mobile-sam", Dialect::SamHwc),
        ("sam2.1-tiny", Dialect::Sam2),
        ("sam2.1-small", Dialect::Sam2),
        ("sam2.1-base-plus", Dialect::Sam2),
        ("sam2.1-large", Dialect::Sam2),
        ("efficient-sam", Dialect::EfficientSam),
    ];
    for (name, dialect) in expected {
        let entry = catalogue.entry(name).unwrap();
        assert_eq!(entry.variants()[0].dialect, Some(dialect), "{name}");
        assert!(entry.variants()[0].has_address(), "{name}");
    }
    let int8 = &catalogue.entry("sam-vit-b").unwrap().variants()[1];
    assert_eq!(
        (int8.name.as_str(), int8.dialect),
        ("int8", Some(Dialect::SamX))
    );
    assert_eq!(int8.download_bytes(), Some(99_827_688 + 8_743_656));
    let full = &catalogue.entry("sam-vit-b").unwrap().variants()[0];
    assert_eq!(
        full.download_bytes(),
        Some(348_403_199),
        "both files are in one archive"
    );
}

#[test]
fn mistakes_in_a_catalogue_are_reported() {
    let entry = "[[entry]]\nname = 'a'\npurpose = ''\nlicence = ''\nsource = ''\n";
    let cases = [
        ("[[entry.file]]\nname = '../a'\n", "not a file name"),
        (
            "[[entry.file]]\nname = 'a'\ninterface = 'b'\n",
            "no interface `b`",
        ),
        (
            "[[entry.file]]\nname = 'a'\ntext = true\ndata = true\n",
            "both text and data",
        ),
        (
            "[[entry.file]]\nname = 'a'\nfrom = [{ url = 'u', member = 'm', gzip = true }]\n",
            "either a ZIP archive or gzip",
        ),
        (
            "[[entry.file]]\nname = 'a'\nfrom = [{ url = 'u', sha256 = '0' }]\n",
            "belong to the file",
        ),
        ("", "needs files"),
        (
            "[[entry.file]]\nname = 'a'\nurls = []\n",
            "line 7: unknown field",
        ),
        (
            "[[entry.variant]]\nname = 'v'\nsummary = ''\ndialect = 'sam3'\n",
            "unknown variant `sam3`",
        ),
    ];
    for (rest, reported) in cases {
        let error = Catalogue::parse(&format!("{entry}{rest}")).unwrap_err();
        let error = error.to_string();
        assert!(error.contains(reported) && !error.contains('\n'), "{error}");
    }
}
