//! The JSON Schema of recipes allows what `ostra run` reads, and the book has it.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use super::book::book_pages::pages;
use super::recipe::{read, schema_text};
use ostra_session::recipe_schema;

/// Returns whether a schema allows a value.
///
/// Only the keywords of recipes are known; others panic.
fn allows(root: &Value, schema: &Value, value: &Value) -> bool {
    let Some(rules) = schema.as_object() else {
        return schema == &json!(true);
    };
    let all = |schemas: &Value| schemas.as_array().unwrap().clone();
    rules.iter().all(|(keyword, rule)| match keyword.as_str() {
        "$schema" | "$defs" | "title" | "description" | "default" | "format" | "deprecated" => true,
        "$ref" => {
            let at = rule.as_str().unwrap().strip_prefix('#').unwrap();
            allows(root, root.pointer(at).unwrap(), value)
        }
        "type" if rule.is_array() => all(rule).iter().any(|name| is_a(value, name)),
        "type" => is_a(value, rule),
        "const" => value == rule,
        "enum" => all(rule).contains(value),
        "anyOf" => all(rule).iter().any(|one| allows(root, one, value)),
        "oneOf" => {
            let count = all(rule)
                .iter()
                .filter(|one| allows(root, one, value))
                .count();
            count == 1
        }
        "minimum" => value
            .as_f64()
            .is_none_or(|value| value >= rule.as_f64().unwrap()),
        "maximum" => value
            .as_f64()
            .is_none_or(|value| value <= rule.as_f64().unwrap()),
        "minItems" => value
            .as_array()
            .is_none_or(|items| items.len() as u64 >= rule.as_u64().unwrap()),
        "maxItems" => value
            .as_array()
            .is_none_or(|items| items.len() as u64 <= rule.as_u64().unwrap()),
        "prefixItems" => {
            let items = value.as_array().into_iter().flatten();
            all(rule)
                .iter()
                .zip(items)
                .all(|(rule, item)| allows(root, rule, item))
        }
        "items" => value
            .as_array()
            .into_iter()
            .flatten()
            .all(|item| allows(root, rule, item)),
        "required" => value.as_object().is_none_or(|object| {
            all(rule)
                .iter()
                .all(|key| object.contains_key(key.as_str().unwrap()))
        }),
        "properties" => value
            .as_object()
            .into_iter()
            .flatten()
            .all(|(key, inner)| rule.get(key).is_none_or(|rule| allows(root, rule, inner))),
        "additionalProperties" => {
            assert_eq!(rule, &json!(false), "{schema}");
            value
                .as_object()
                .into_iter()
                .flatten()
                .all(|(key, _)| rules["properties"].get(key).is_some())
        }
        _ => panic!("the keyword '{keyword}' is not known here"),
    })
}

fn is_a(value: &Value, name: &Value) -> bool {
    match name.as_str().unwrap() {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "number" => value.is_number(),
        "integer" => value.is_i64() || value.is_u64(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        name => panic!("{name}"),
    }
}

fn is_allowed(recipe: &Value) -> bool {
    let schema = recipe_schema();
    allows(&schema, &schema, recipe)
}

/// Returns whether `ostra run` reads a recipe.
fn is_read(recipe: &Value) -> bool {
    read(&recipe.to_string())
        .is_ok_and(|(recipe, unknown)| recipe.format == 1 && unknown.is_empty())
}

/// Lists values of JSON.
macro_rules! commands {
    ($($command:tt),+ $(,)?) => {
        vec![$(json!($command)),+]
    };
}

/// Returns all commands, each with all of its keys.
fn commands() -> Vec<Value> {
    let camera = json!({"width": 640, "height": 480, "focal_px": [500.0, 500.0], "principal_px": [320.0, 240.0],
        "distortion": {"open_cv": {"k": [0.1, 0.0], "p": [0.0, 0.0]}}});
    let pose = json!({"rotation": [0.0, 0.0, 0.0, 1.0], "translation": [0.0, 0.0, 2.0]});
    let region = json!({"eye": {"free": {"camera": camera, "camera_from_world": pose}}, "points_px": [[1.0, 2.0], [3.0, 4.0]],
        "radius_px": 3.0, "remove": false, "hidden": [2], "isolated": 1, "uncertain_below": 0.5, "cube_from_world": [1.0, 0.0,
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]});
    let sources = json!({"root": "plant", "open": {"sources": [{"frames": "photos", "depth": "depths"}], "depth_unit": 0.001,
        "float_depth_unit": 1.0, "depth_camera": {"intrinsics": "k.txt", "pose": "pose.txt"}, "every": 2, "from": 0, "to": 9},
        "cameras": "sparse", "intrinsics": [500.0, 500.0, 320.0, 240.0]});
    let prompt = json!({"clicks": [{"at_px": [5.0, 6.0], "include": true}], "boxes": [{"min_px": [1.0, 1.0], "max_px": [9.0, 9.0]}],
        "corrects": true});
    let track = json!({"tracker": "flow", "from": 0, "to": 5, "direction": "forward", "constrain": true, "labels": [1],
        "replace": true, "pause_below": 0.5, "short_side": 480});
    let export = json!({"cloud": "a.ply", "mesh": "a.obj", "voxels": "a.npz", "cameras": "sparse", "camera_encoding": "binary",
        "undistorted": "flat", "solid": true, "masks": "masks", "mask_format": "coco", "depths": "depths", "traits": "a.csv",
        "ground": {"plane": {"normal": [0.0, 0.0, 1.0], "offset": 0.5}}, "angles": [[1, 2]], "unit": "centimetre", "level": 1,
        "twin": true, "per_label": true, "simplify": 0.5, "overwrite": true});
    let reconstruct = json!({"method": "sfm", "every": 2, "device": "cpu", "features": "sift", "matcher": "nearest",
        "registration": "fgr", "max_side": 900, "only_labelled": true, "pairs": [[0, 4]],
        "cache_limit_gib": 4});
    let thing = json!(["cup", {"min_px": [1.0, 1.0], "max_px": [9.0, 9.0]}]);
    let points = json!([[1.0, 2.0], [3.0, 4.0]]);
    let range = |change: Value| json!({"range": {"labels": [1], "from": 0, "to": 5, "change": change, "replace": true}});
    let mut list = commands![
        {"new": sources}, {"open": "plant"}, {"view": "plant"}, {"inspect": "a.ply"}, "close", {"add_frames": sources},
        {"relocate": {"from": "old", "to": "new"}}, {"add_label": {"name": "leaf", "parent": "plant", "color": [1, 2, 3]}},
        {"edit_label": {"id": 2, "name": "leaf", "color": [1, 2, 3], "parent": 1}}, {"remove_label": 2},
        {"prompt": {"frame": 1, "label": 2, "prompt": prompt, "segmenter": "sam-close"}},
        {"ground": {"frame": 1, "phrases": ["cup"], "threshold": 0.3, "grounder": "yolox"}},
        {"take_found": {"frame": 1, "things": [thing], "segmenter": "builtin"}},
        {"paint": {"frame": 1, "label": 2, "points_px": points, "radius_px": 3.0, "erase": false, "replace": true, "snap": true}},
        {"move_border": {"frame": 1, "label": 2, "from_px": [1.0, 2.0], "to_px": [3.0, 4.0], "replace": true}},
        {"trace": {"frame": 1, "label": 2, "points_px": points, "replace": true}},
        {"clean": {"frame": 1, "label": 2, "holes_below_px": 5, "islands_below_px": 6}},
        {"make_keyframe": {"frame": 1}}, {"accept_vote": {"frame": 1, "labels": [1]}},
        {"instances": {"label": 1, "options": {"radius": 3.0, "min_neighbours": 5, "min_points": 50}}},
        {"attach": {"radius": 3.0}},
        {"correct_cloud": {"select": [{"seen": region}, {"seen": {"eye": {"frame": 3}, "points_px": points}}, {"label": 1},
            {"only": 2}, {"grow": {"normal_deg": 20.0, "color": 15.0}}, {"piece": 0}], "change": {"assign": 2},
            "as_keyframes": true}},
        {"correct_cloud": {"select": [], "change": "clear"}},
        {"merge_labels": {"label": 1, "into": 2}}, {"clear_mask": {"frame": 1}},
        {"import_masks": {"dir": "masks", "format": "coco"}},
        {"export_masks": {"dir": "masks", "format": "coco", "overwrite": true}},
        {"track": track}, "suggest", {"propose": {"frame": 1, "segmenter": "sam"}}, {"reconstruct": reconstruct},
        {"select_model": {"model": 2}},
        {"scale": {"ends": [{"world": [0.0, 0.0, 1.0]}, {"seen": [[0, [1.0, 2.0]], [1, [3.0, 4.0]]]}], "length": 0.5}},
        {"fuse": {"voxel": 0.01, "min_confidence": 0.5, "drop_unlabelled": true, "onto": "a.ply"}},
        {"export": export}, {"export": {"ground": {"label": 1}}},
        {"model": {"name": "xmem", "task": {"add": ["a.onnx"]}}}, {"model": {"name": "xmem", "task": "check"}},
        "undo", "redo", "stop",
        {"pull": {"frame": 1, "label": 2, "from_px": [1.0, 2.0], "to_px": [3.0, 4.0], "replace": true}},
        {"tidy": {"frame": 1, "label": 2}}, {"make_anchor": {"frame": 1}}, {"adopt": {}},
        {"correct_cloud": {"select": [{"seen": {"eye": {"frame": 3}, "points_px": points, "doubtful_below": 0.5}}],
            "change": "clear", "as_anchors": true}},
    ];
    let changes = commands![
        "delete", "restore", "lock", "unlock", "hide", "show", {"merge": {"into": 2}}, "interpolate",
        {"split": {"frame": 1, "at_px": [1.0, 2.0], "into": 2}}, {"copy": {"frame": 1}},
    ];
    list.extend(changes.into_iter().map(range));
    list
}

fn recipe_of(command: &Value) -> Value {
    json!({"format": 1, "commands": [command]})
}

/// Returns the value with each of its parts damaged in turn: a key left out or misspelt, or a value of another type.
fn damaged(value: &Value) -> Vec<Value> {
    let others = [
        json!(null),
        json!(true),
        json!(-1.5),
        json!("x"),
        json!([]),
        json!({}),
    ];
    let is_other = |other: &&Value| {
        // serde also reads objects as lists of their values.
        !(value.is_object() && other.is_array()) && *other != value
    };
    let mut all: Vec<Value> = others.iter().filter(is_other).cloned().collect();
    match value {
        Value::Object(object) => {
            for (key, inner) in object {
                let mut without = object.clone();
                without.remove(key);
                let mut misspelt = without.clone();
                misspelt.insert(format!("{key}x"), inner.clone());
                all.extend([without.into(), misspelt.into()]);
                for inner in damaged(inner) {
                    let mut copy = object.clone();
                    copy.insert(key.clone(), inner);
                    all.push(copy.into());
                }
            }
        }
        Value::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                for item in damaged(item) {
                    let mut copy = items.clone();
                    copy[index] = item;
                    all.push(copy.into());
                }
            }
        }
        _ => {}
    }
    all
}

/// Returns whether a number of a recipe is the one of [`damaged`], which the session may refuse as out of range.
fn has_wrong_number(recipe: &Value) -> bool {
    recipe.to_string().contains("-1.5")
}

#[test]
fn schema_allows_every_command_and_what_the_program_saves() {
    let mut names = BTreeSet::new();
    for command in commands() {
        let recipe = recipe_of(&command);
        assert!(is_read(&recipe), "{:?}", read(&recipe.to_string()));
        assert!(is_allowed(&recipe), "{command}");
        let (read, _) = read(&recipe.to_string()).unwrap();
        assert!(
            is_allowed(&serde_json::to_value(&read).unwrap()),
            "{command}"
        );
        let object = command.as_object().and_then(|object| object.keys().next());
        names.insert(object.map_or_else(|| command.as_str().unwrap().to_owned(), Clone::clone));
    }
    let schema = recipe_schema();
    let variants = schema.pointer("/$defs/Command/oneOf").unwrap();
    let mut known = BTreeSet::new();
    for variant in variants.as_array().unwrap() {
        known.extend(
            variant["properties"]
                .as_object()
                .into_iter()
                .flatten()
                .map(|(name, _)| name.clone()),
        );
        let words = [&variant["enum"], &json!([variant["const"]])].map(Clone::clone);
        let words = words.iter().filter_map(Value::as_array).flatten();
        known.extend(words.filter_map(Value::as_str).map(String::from));
    }
    assert_eq!(names, known, "a command is missing in this test");
}

#[test]
fn schema_refuses_what_the_program_refuses() {
    let schema = recipe_schema();
    let (mut refused, mut differences) = (0, Vec::new());
    let damaged_format = [
        json!({"format": 2, "commands": []}),
        json!({"commands": []}),
        json!({"format": 1}),
    ];
    let commands = commands();
    let recipes = commands
        .iter()
        .flat_map(damaged)
        .map(|command| recipe_of(&command));
    for recipe in recipes.chain(damaged_format) {
        let (allowed, read) = (allows(&schema, &schema, &recipe), is_read(&recipe));
        refused += usize::from(!allowed);
        if allowed != read && !(allowed && has_wrong_number(&recipe)) {
            differences.push(format!("allowed: {allowed}, read: {read}: {recipe}"));
        }
    }
    assert!(differences.is_empty(), "{}", differences.join("\n"));
    assert!(refused > 1000, "only {refused} recipes were refused");
}

#[test]
fn unknown_keys_are_named_with_their_command() {
    let misspelt = json!({"fuse": {"voxle": 0.01}});
    let text = recipe_of(&misspelt).to_string();
    assert_eq!(read(&text).unwrap().1, ["'voxle' of command 1"]);
    let lines = format!("\"undo\"\n\n{misspelt}\n");
    assert_eq!(read(&lines).unwrap().1, ["'voxle' of command 2"]);
    let inner = json!({"track": {"tracker": "flow"}, });
    let clicks =
        json!({"prompt": {"frame": 1, "label": 1, "prompt": {"click": []}, "segmenter": "auto"}});
    let recipe = json!({"format": 1, "commands": [inner, clicks], "made": "today"});
    assert_eq!(
        read(&recipe.to_string())
            .unwrap()
            .1
            .iter()
            .collect::<BTreeSet<_>>(),
        BTreeSet::from([
            &"'prompt.click' of command 2".to_owned(),
            &"'made'".to_owned()
        ])
    );
}

#[test]
fn recipes_of_the_book_are_allowed() {
    let mut checked = 0;
    for path in pages() {
        let page = fs::read_to_string(&path).unwrap();
        for block in page.split("```json\n").skip(1) {
            let text = block.split("```").next().unwrap();
            let value: Value = serde_json::from_str(text).unwrap();
            let recipe = if value.get("commands").is_some() {
                value
            } else {
                recipe_of(&value)
            };
            assert!(
                is_allowed(&recipe) && is_read(&recipe),
                "{}: {text}",
                path.display()
            );
            checked += 1;
        }
    }
    assert!(checked >= 3, "only {checked} recipes were found");
}

#[test]
fn schema_of_the_book_is_up_to_date() {
    let path: &Path =
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book/src/reference/recipe.schema.json");
    let text = schema_text().unwrap();
    if std::env::var_os("OSTRA_UPDATE_BOOK").is_some() {
        fs::write(path, text).unwrap();
    } else {
        let now = fs::read_to_string(path).unwrap();
        assert!(
            now == text,
            "run `OSTRA_UPDATE_BOOK=1 cargo test book` to write the schema again"
        );
    }
}
