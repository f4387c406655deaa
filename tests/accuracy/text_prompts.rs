//! Tests of finding objects by text, with the real weights of a small network.

use std::path::Path;

use ostra_masks::{LabelId, read_palette_png};
use serde_json::Value;
use tempfile::TempDir;

use super::networks::{Needs, ostra, refused};
use crate::project::Project;

/// A project of banana images, with a separate data folder.
struct Bananas {
    needs: Needs,
    data: TempDir,
    project: Project,
}

impl Bananas {
    fn new() -> Self {
        let needs = Needs::of("banana");
        let project = Project::new(&needs.set.join("images"), &[]);
        Self {
            needs,
            data: TempDir::new().unwrap(),
            project,
        }
    }

    fn ground(&self, words: &str) -> Vec<String> {
        let root = self.project.root();
        [
            "ground",
            &root,
            "--frame",
            "3",
            "--text",
            words,
            "--segmenter",
            "builtin",
        ]
        .map(str::to_owned)
        .to_vec()
    }

    fn done(&self, args: &[String]) -> String {
        let (code, out, err) = ostra(self.data.path(), Some(&self.needs.runtime), args);
        assert_eq!(code, Some(0), "{args:?}: {out}{err}");
        out
    }

    fn refused(&self, args: &[String]) -> String {
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        refused(self.data.path(), Some(&self.needs.runtime), &args)
    }

    fn add_network(&self) {
        let file = self
            .needs
            .networks
            .join("yolox_nano.onnx")
            .display()
            .to_string();
        self.done(&["models", "add", "yolox", &file].map(str::to_owned));
    }
}

fn bananas_are_found_by_their_name() {
    let bananas = Bananas::new();
    let output = bananas.refused(&bananas.ground("banana"));
    assert!(
        output.contains("yolox") && output.contains("ostra models install"),
        "{output}"
    );
    bananas.add_network();
    let output = bananas.refused(&bananas.ground("banana; panicle"));
    assert!(
        output.contains("'panicle'") && output.contains("toothbrush"),
        "it lists the words that it knows: {output}"
    );
    let output = bananas.refused(&bananas.ground("zebra"));
    assert!(
        output.contains("zebra") && output.contains("--threshold"),
        "{output}"
    );
    assert_eq!(
        bananas.project.info()["labels"].as_array().unwrap().len(),
        0,
        "nothing changed so far"
    );

    let output = bananas.done(&bananas.ground("banana"));
    assert!(
        output.contains("grounder: yolox") && output.contains("banana: "),
        "{output}"
    );
    let info = bananas.project.info();
    let names: Vec<&str> = info["labels"]
        .as_array()
        .unwrap()
        .iter()
        .map(|label| label["name"].as_str().unwrap())
        .collect();
    assert_eq!(names[..2], ["banana", "banana 1"]);
    assert_eq!(
        (&info["labels"][1]["parent"], &info["frames"][3]["mask"]),
        (&Value::from("banana"), &Value::from("anchor"))
    );
    let name = info["frames"][3]["name"].as_str().unwrap();
    let stem = Path::new(name).with_extension("png");
    let mask =
        read_palette_png(&Path::new(&bananas.project.root()).join("masks").join(stem)).unwrap();
    let share =
        mask.ids.iter().filter(|&&id| id != LabelId::NONE).count() as f64 / mask.ids.len() as f64;
    assert!(
        (0.01..0.4).contains(&share),
        "the bunch is a part of the image: {share}"
    );
}

crate::registry::tests! {
    Networks(&["banana"]) => bananas_are_found_by_their_name;
}
