use std::fs;
use std::path::Path;

use super::super::{Catalogue, NnError, Verification, add, check, list, load, load_text};
use super::ready;

fn files_in(folder: &Path) -> usize {
    fs::read_dir(folder).map_or(0, Iterator::count)
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn added_network_can_be_listed_checked_and_loaded() {
    let (_, folder) = ready();
    let (catalogue, scratch) = (Catalogue::bundled().unwrap(), tempfile::tempdir().unwrap());
    let target = scratch.path().join("models");
    let source = folder.join("xfeat.onnx");
    let listed = || {
        list(&catalogue, &target)
            .into_iter()
            .find(|row| row.name == "xfeat")
            .unwrap()
            .installed
    };
    assert_eq!(listed(), None);
    let added = add(&catalogue, &target, "xfeat", std::slice::from_ref(&source)).unwrap();
    assert_eq!(
        (added[0].path.clone(), &added[0].proof),
        (target.join("xfeat.onnx"), &Verification::Fits)
    );
    assert_eq!(
        listed().unwrap().bytes,
        fs::metadata(&source).unwrap().len()
    );
    let checked = check(&catalogue, &target, "xfeat").unwrap();
    assert!(
        checked[0].is_compared && checked[0].signature.as_ref().unwrap().inputs[0].name == "input"
    );
    assert_eq!(load(&target, "xfeat").unwrap().len(), 1);
    assert_eq!(
        files_in(&target),
        2,
        "the network and the digests; no temporary file stays"
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn adding_an_installed_file_keeps_it() {
    let (_, folder) = ready();
    let (catalogue, scratch) = (Catalogue::bundled().unwrap(), tempfile::tempdir().unwrap());
    let added = add(
        &catalogue,
        scratch.path(),
        "yolox",
        &[folder.join("yolox_nano.onnx")],
    )
    .unwrap();
    add(
        &catalogue,
        scratch.path(),
        "yolox",
        &[added[0].path.clone()],
    )
    .unwrap();
    assert_eq!(
        fs::read(&added[0].path).unwrap(),
        fs::read(folder.join("yolox_nano.onnx")).unwrap()
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn folder_can_be_given_instead_of_its_files() {
    let (_, folder) = ready();
    let (catalogue, scratch) = (Catalogue::bundled().unwrap(), tempfile::tempdir().unwrap());
    let added = add(
        &catalogue,
        scratch.path(),
        "xfeat",
        std::slice::from_ref(&folder),
    )
    .unwrap();
    assert_eq!(
        fs::read(&added[0].path).unwrap(),
        fs::read(folder.join("xfeat.onnx")).unwrap()
    );
    let error = add(&catalogue, scratch.path(), "xmem", &[folder])
        .unwrap_err()
        .to_string();
    assert!(error.contains("xmem") && error.contains(".onnx"), "{error}");
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn network_with_another_interface_is_rejected() {
    let (_, folder) = ready();
    let (catalogue, scratch) = (Catalogue::bundled().unwrap(), tempfile::tempdir().unwrap());
    let error = add(
        &catalogue,
        scratch.path(),
        "xfeat",
        &[folder.join("lighterglue.onnx")],
    )
    .unwrap_err();
    assert!(matches!(error, NnError::Mismatch { .. }), "{error}");
    assert_eq!(files_in(scratch.path()), 0);
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn network_without_a_known_interface_is_verified_by_loading() {
    let (_, folder) = ready();
    let text = "[[entry]]\nname = 'a'\npurpose = ''\nlicence = ''\nsource = ''\n[[entry.file]]\nname = 'a.onnx'\n";
    let (catalogue, scratch) = (
        Catalogue::parse(text).unwrap(),
        tempfile::tempdir().unwrap(),
    );
    let added = add(
        &catalogue,
        scratch.path(),
        "a",
        &[folder.join("xfeat.onnx")],
    )
    .unwrap();
    assert_eq!(added[0].proof, Verification::Loads);
    assert!(!check(&catalogue, scratch.path(), "a").unwrap()[0].is_compared);
}

#[test]
fn error_for_a_wrong_number_of_files_lists_their_names() {
    let (catalogue, scratch) = (Catalogue::bundled().unwrap(), tempfile::tempdir().unwrap());
    let error = add(&catalogue, scratch.path(), "sam-vit-b", &["a.onnx".into()])
        .unwrap_err()
        .to_string();
    assert_eq!(
        error,
        "`sam-vit-b` takes 2 files in this order: sam-vit-b-encoder.onnx, sam-vit-b-decoder.onnx"
    );
}

#[test]
fn error_for_a_missing_network_tells_how_to_install_it() {
    let (catalogue, scratch) = (Catalogue::bundled().unwrap(), tempfile::tempdir().unwrap());
    let error = check(&catalogue, scratch.path(), "xfeat")
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("`xfeat` is not installed") && error.contains("ostra models add xfeat FILE"),
        "{error}"
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn text_files_of_a_network_are_read_and_not_run() {
    let (_, folder) = ready();
    let text = r#"[[entry]]
name = "yolox"
purpose = "p"
licence = "l"
source = "https://s"
[[entry.file]]
name = "n.onnx"
[[entry.file]]
name = "words.txt"
text = true
"#;
    let (catalogue, scratch): (Catalogue, _) = (
        Catalogue::parse(text).unwrap(),
        tempfile::tempdir().unwrap(),
    );
    let (network, words) = (
        folder.join("yolox_nano.onnx"),
        scratch.path().join("vocab.txt"),
    );
    let target = scratch.path().join("models");
    fs::write(&words, [0xff, 0xfe]).unwrap();
    let files = [network, words.clone()];
    let error = add(&catalogue, &target, "yolox", &files)
        .unwrap_err()
        .to_string();
    assert!(error.contains("vocab.txt") && !target.exists(), "{error}");
    fs::write(&words, "naïve\n").unwrap();
    add(&catalogue, &target, "yolox", &files).unwrap();
    assert_eq!(
        fs::read_to_string(target.join("words.txt")).unwrap(),
        "naïve\n"
    );
    let checked = check(&catalogue, &target, "yolox").unwrap();
    assert!(checked[0].signature.is_some() && checked[1].signature.is_none());
}

#[test]
fn text_files_and_networks_of_one_name_are_distinguished() {
    let scratch = tempfile::tempdir().unwrap();
    let error = load_text(scratch.path(), "grounding-dino")
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("`grounding-dino` is not installed"),
        "{error}"
    );
    fs::write(scratch.path().join("grounding-dino.onnx"), "no network").unwrap();
    fs::write(
        scratch.path().join("grounding-dino-vocab.txt"),
        "[CLS]\n[SEP]\n",
    )
    .unwrap();
    assert_eq!(
        load_text(scratch.path(), "grounding-dino").unwrap(),
        ["[CLS]\n[SEP]\n"]
    );
}
