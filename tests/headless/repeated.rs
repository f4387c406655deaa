//! Tests that the recipe of a project recreates it elsewhere, and that wrong recipes are refused.

use super::recording::Recording;
use crate::program::{done, ostra, refused};

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

/// A misspelt key was once replaced by its default without a word.
#[test]
fn recipe_with_a_misspelt_key_is_refused_before_anything_is_done() {
    let recording = Recording::new();
    let project = recording.project();
    let path = recording.path("recipe.json");
    let label =
        serde_json::json!({"add_label": {"name": "thing", "parent": null, "colour": [1, 2, 3]}});
    let recipe = serde_json::json!({"format": 1, "commands": [{"open": project}, label, "undo"]});
    std::fs::write(&path, recipe.to_string()).unwrap();
    let message = refused(&["run", &path]);
    assert!(
        message.contains("'colour' of command 2 is not known"),
        "{message}"
    );
    let info: serde_json::Value =
        serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
    assert_eq!(info["labels"].as_array().map(Vec::len), Some(0));
    let correct = recipe.to_string().replace("colour", "color");
    std::fs::write(&path, correct).unwrap();
    done(&["run", &path]);
}

#[test]
fn schema_of_recipes_is_printed() {
    let schema: serde_json::Value = serde_json::from_str(&done(&["run", "--schema"])).unwrap();
    assert_eq!(schema["title"], "OSTRA recipe");
    assert!(schema.pointer("/$defs/Command").is_some());
    assert_eq!(ostra(&["run"]).status.code(), Some(2), "no recipe");
}
