//! Tests that the demo can run again into its own folder.

use std::path::Path;

use crate::program::{contents, done, refused};

fn demo_keeps_foreign_files_and_edits_in_its_project() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let demo = ["--headless", "--frames", "6", "--size", "96x128"];
    let out = path("demo");
    for file in [
        "recording/day1.bag",
        "truth/measured.csv",
        "project/thesis.tex",
    ] {
        let path = Path::new(&out).join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, file).unwrap();
    }
    refused(&[&["demo", &out], &demo[..]].concat());
    assert_eq!(contents(Path::new(&out)).len(), 3);

    let fresh = path("fresh");
    let args = [&["demo", &fresh], &demo[..]].concat();
    done(&args);
    done(&args);
    done(&["label", &format!("{fresh}/project"), "mine"]);
    assert!(refused(&args).contains("changed"));
    assert!(done(&["info", &format!("{fresh}/project")]).contains("mine"));
}

crate::registry::tests! {
    Nothing => demo_keeps_foreign_files_and_edits_in_its_project;
}
