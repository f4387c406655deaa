//! Tests of structure from motion with learned features: networks are installed, checked and used.

use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use super::networks::{Needs, ostra, refused};
use crate::data::data_dir;
use crate::project::Project;

/// Returns the line of a network in the list.
fn listed(data: &Path, name: &str) -> String {
    let (code, out, err) = ostra(data, None, &["models", "list"]);
    assert_eq!(code, Some(0), "{err}");
    let line = out
        .lines()
        .find(|line| line.split_whitespace().next() == Some(name));
    line.unwrap_or_else(|| panic!("{name} is not in the list: {out}"))
        .to_owned()
}

fn learned_features_are_refused_until_their_networks_are_installed() {
    let set = data_dir().join("strecha_fountain_P11");
    let data = TempDir::new().unwrap();
    let project = Project::new(&set.join("images"), &[]);
    let root = project.root();
    let reconstruct = ["reconstruct", &root, "--method", "sfm"];
    assert!(listed(data.path(), "xfeat").contains(": not installed, from files only"));
    let output = refused(
        data.path(),
        None,
        &[&reconstruct[..], &["--features", "xfeat"]].concat(),
    );
    assert!(
        output.contains("'xfeat' is not installed") && output.contains("ostra models add"),
        "{output}"
    );
    let output = refused(data.path(), None, &["models", "check", "xfeat"]);
    assert!(output.contains("ostra models add xfeat FILE"), "{output}");
    let output = refused(
        data.path(),
        None,
        &[&reconstruct[..], &["--matcher", "lighterglue"]].concat(),
    );
    assert!(
        output.contains("'lighterglue'") && output.contains("features of xfeat"),
        "{output}"
    );
    let output = refused(
        data.path(),
        None,
        &[&reconstruct[..], &["--features", "superpoint"]].concat(),
    );
    assert!(
        output.contains("'superpoint' is not installed") && output.contains("ostra models add"),
        "{output}"
    );
    let output = refused(
        data.path(),
        None,
        &[&reconstruct[..], &["--matcher", "superglue"]].concat(),
    );
    assert!(
        output.contains("superglue-outdoor or superglue-indoor"),
        "{output}"
    );
    assert_eq!(
        project.info()["results"]["cameras"]["frames"]
            .as_u64()
            .unwrap_or(0),
        0
    );
}

fn fountain_with_learned_features() {
    let needs = Needs::of("strecha_fountain_P11");
    let data = TempDir::new().unwrap();
    let run = |args: &[&str]| {
        let (code, out, err) = ostra(data.path(), Some(&needs.runtime), args);
        assert_eq!(code, Some(0), "{args:?}: {out}{err}");
        out + &err
    };
    for network in ["xfeat", "lighterglue"] {
        assert!(listed(data.path(), network).contains(": not installed"));
        let file = needs.networks.join(format!("{network}.onnx"));
        let output = run(&["models", "add", network, file.to_str().unwrap()]);
        assert!(output.contains("added; it loads"), "{output}");
        let line = listed(data.path(), network);
        assert!(line.contains(data.path().to_str().unwrap()), "{line}");
        let output = run(&["models", "check", network]);
        assert!(
            output
                .lines()
                .next()
                .unwrap()
                .ends_with(": inputs and outputs are as expected"),
            "{output}"
        );
    }

    let project = Project::new(&needs.set.join("images"), &[]);
    let root = project.root();
    let reconstruct = ["reconstruct", &root, "--method", "sfm"];
    let sift = [
        &reconstruct[..],
        &["--features", "sift", "--matcher", "lighterglue"],
    ]
    .concat();
    let output = refused(data.path(), Some(&needs.runtime), &sift);
    assert!(output.contains("choose --features xfeat"), "{output}");

    let learned = [
        "--features",
        "xfeat",
        "--matcher",
        "lighterglue",
        "--max-side",
        "480",
    ];
    let output = run(&[&reconstruct[..], &learned].concat());
    assert!(
        output.contains("11 of 11 frames by xfeat + lighterglue"),
        "{output}"
    );
    assert_eq!(project.placed(), 11);
    let errors = project.errors(&needs.set.join("sparse"));
    let centre = errors
        .pointer("/centre_percent")
        .and_then(Value::as_f64)
        .unwrap();
    println!(
        "fountain, xfeat + lighterglue: {} cameras, centre {centre:.3} %",
        errors["result"]
    );
    assert!(centre <= 0.5);
}

crate::registry::tests! {
    Data(&["strecha_fountain_P11"]) => learned_features_are_refused_until_their_networks_are_installed;
    Networks(&["strecha_fountain_P11"]) => fountain_with_learned_features;
}
