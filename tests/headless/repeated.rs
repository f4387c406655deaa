//! Tests that the recipe of a project recreates it elsewhere.

use super::recording::Recording;
use crate::program::{done, refused};

#[test]
fn recipe_of_a_project_recreates_it_elsewhere() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    let (steps, again) = (recording.path("steps.jsonl"), recording.path("again"));
    let text = std::fs::read_to_string(format!("{project}/recipe.jsonl")).unwrap();
    std::fs::write(&steps, text.replacen(&project, &again, 1)).unwrap();
    done(&["run", &steps]);
    let described = |project: &str| {
        let info: serde_json::Value =
            serde_json::from_str(&done(&["info", project, "--json"])).unwrap();
        (info["labels"].clone(), info["frames"].clone())
    };
    assert_eq!(described(&again), described(&project));
    std::fs::write(&steps, "{\"new\":\n").unwrap();
    assert!(refused(&["run", &steps]).contains("is not a recipe"));
}
