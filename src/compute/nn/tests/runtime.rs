use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::super::{
    Catalogue, Network, NnError, Provider, Runtime, Verification, add, models_folder,
    take_fall_backs,
};
use super::{networks, ready};
use crate::nn::runtime::{RuntimeLocation, library_name, places};

/// Runs one ignored test of this module in its own process.
///
/// A process loads ONNX Runtime only once.
fn alone(test: &str, library: Option<&OsStr>, data: &Path) {
    let mut command = Command::new(std::env::current_exe().unwrap());
    let name = format!("{}::{test}", module_path!().split_once("::").unwrap().1);
    command
        .args([name.as_str(), "--exact", "--ignored", "--nocapture"])
        .env("XDG_DATA_HOME", data);
    match library {
        Some(library) => command.env("ORT_DYLIB_PATH", library),
        None => command.env_remove("ORT_DYLIB_PATH"),
    };
    let output = command.output().unwrap();
    let reported = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && reported.contains("1 passed"),
        "{reported}"
    );
}

#[test]
fn named_library_is_tried_before_the_installed_and_the_systems_one() {
    let scratch = tempfile::tempdir().unwrap();
    let own = scratch.path().join(library_name());
    let system = RuntimeLocation::System(PathBuf::from(library_name()));
    assert_eq!(places(None, Some(scratch.path()))[0], system);
    std::fs::write(&own, "").unwrap();
    let found = places(Some(PathBuf::new()), Some(scratch.path()));
    assert_eq!(
        found[..2],
        [RuntimeLocation::File(own), system],
        "an empty variable names nothing"
    );
    let named = PathBuf::from("/somewhere/libonnxruntime.so");
    assert_eq!(
        places(Some(named.clone()), Some(scratch.path())),
        [RuntimeLocation::Named(named)]
    );
}

#[test]
fn missing_library_is_reported() {
    let scratch = tempfile::tempdir().unwrap();
    alone(
        "a_child_with_a_wrong_library",
        Some(scratch.path().join("missing.so").as_os_str()),
        scratch.path(),
    );
}

#[test]
fn file_that_is_not_a_library_is_reported() {
    let scratch = tempfile::tempdir().unwrap();
    let file = scratch.path().join("text.so");
    std::fs::write(&file, "no library").unwrap();
    alone(
        "a_child_with_a_wrong_library",
        Some(file.as_os_str()),
        scratch.path(),
    );
}

#[test]
#[cfg(target_os = "linux")]
fn another_library_is_told() {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let library = maps
        .split_whitespace()
        .find(|word| word.contains("/libc.so"))
        .unwrap();
    alone(
        "a_child_with_a_wrong_library",
        Some(OsStr::new(library)),
        tempfile::tempdir().unwrap().path(),
    );
}

#[test]
#[ignore = "run by others in a process of its own"]
fn a_child_with_a_wrong_library() {
    for _ in 0..2 {
        let error = Runtime::find().unwrap_err();
        let named = std::env::var("ORT_DYLIB_PATH").unwrap();
        let text = error.to_string();
        assert!(
            matches!(error, NnError::RuntimeUnusable { .. }) && text.contains(&named),
            "{text}"
        );
        assert!(
            text.contains("1.24 or newer") && !text.contains('\n'),
            "{text}"
        );
    }
}

#[test]
fn error_without_a_library_tells_how_to_install_it() {
    alone(
        "a_child_without_a_library",
        None,
        tempfile::tempdir().unwrap().path(),
    );
}

#[test]
#[ignore = "run by others in a process of its own"]
fn a_child_without_a_library() {
    match Runtime::find() {
        Ok(runtime) => assert!(
            runtime.path().is_relative(),
            "the system's own: {}",
            runtime.path().display()
        ),
        Err(error) => {
            let text = error.to_string();
            assert!(
                matches!(error, NnError::RuntimeMissing { .. })
                    && text.contains("is not installed"),
                "{text}"
            );
            assert!(
                text.contains("ostra models add onnxruntime FILE")
                    && text.contains("ORT_DYLIB_PATH"),
                "{text}"
            );
        }
    }
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn files_are_verified_by_digest_without_onnx_runtime() {
    networks();
    let scratch = tempfile::tempdir().unwrap();
    alone(
        "a_child_that_adds_without_a_runtime",
        Some(OsStr::new("/nowhere/onnxruntime")),
        scratch.path(),
    );
}

#[test]
#[ignore = "run by others in a process of its own"]
fn a_child_that_adds_without_a_runtime() {
    let (catalogue, target) = (Catalogue::bundled().unwrap(), models_folder().unwrap());
    let folder = networks();
    let added = add(&catalogue, &target, "xfeat", &[folder.join("xfeat.onnx")]).unwrap();
    assert_eq!(added[0].proof, Verification::Known);
    let added = add(
        &catalogue,
        &target,
        "mobile-sam",
        &[folder.join("xfeat.onnx"), folder.join("xfeat.onnx")],
    )
    .unwrap();
    assert!(
        matches!(&added[0].proof, Verification::None(why) if why.contains("ONNX Runtime")),
        "{added:?}"
    );
    let error = add(
        &catalogue,
        &target,
        "lighterglue",
        &[folder.join("xfeat.onnx")],
    )
    .unwrap_err();
    assert!(matches!(error, NnError::Digest { .. }), "{error}");
    assert!(!target.join("lighterglue.onnx").exists());
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn added_library_is_found_in_the_data_folder() {
    let (runtime, _) = ready();
    let scratch = tempfile::tempdir().unwrap();
    if runtime.path().is_file() {
        let given = scratch.path().join("libonnxruntime.so.1.99");
        std::fs::copy(runtime.path(), given).unwrap();
        alone("a_child_that_adds_a_library", None, scratch.path());
        alone("a_child_with_an_added_library", None, scratch.path());
    }
}

#[test]
#[ignore = "run by others in a process of its own"]
fn a_child_that_adds_a_library() {
    let target = models_folder().unwrap();
    let given = target
        .ancestors()
        .nth(2)
        .unwrap()
        .join("libonnxruntime.so.1.99");
    let added = add(
        &Catalogue::bundled().unwrap(),
        &target,
        "onnxruntime",
        &[given],
    )
    .unwrap();
    assert_eq!(
        (&added[0].path, &added[0].proof),
        (&target.join(library_name()), &Verification::Loads)
    );
}

#[test]
#[ignore = "run by others in a process of its own"]
fn a_child_with_an_added_library() {
    let runtime = Runtime::find().unwrap();
    assert_eq!(
        runtime.path(),
        models_folder().unwrap().join(library_name())
    );
    Network::load(&runtime, &networks().join("xfeat.onnx"), None).unwrap();
    let error = Runtime::open(Path::new("/another/onnxruntime")).unwrap_err();
    assert!(
        error.to_string().contains("in use"),
        "a second one cannot be loaded: {error}"
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn provider_that_does_not_start_is_reported_and_replaced_by_the_processor() {
    let (runtime, _) = ready();
    let library = runtime.path().as_os_str();
    alone(
        "a_child_on_a_card_that_is_not_there",
        Some(library),
        tempfile::tempdir().unwrap().path(),
    );
}

#[test]
#[ignore = "run by another in a process of its own"]
fn a_child_on_a_card_that_is_not_there() {
    let runtime = Runtime::find().unwrap();
    let path = networks().join("xfeat.onnx");
    for provider in Provider::ALL {
        provider.choose();
        Network::load(&runtime, &path, None).unwrap();
        let reported = take_fall_backs();
        let what = format!(
            "runs on the processor, as '{}' does not start",
            provider.name()
        );
        assert!(reported.iter().all(|line| line.contains("xfeat.onnx")
            && line.contains(&what)
            && !line.contains('\n')));
        match provider {
            Provider::Cpu => assert!(reported.is_empty(), "{reported:?}"),
            // These two belong to other systems than the one that runs the test.
            Provider::DirectMl if !cfg!(windows) => assert_eq!(reported.len(), 1),
            Provider::CoreMl if !cfg!(target_os = "macos") => assert_eq!(reported.len(), 1),
            _ => assert!(reported.len() <= 1, "{reported:?}"),
        }
    }
}
