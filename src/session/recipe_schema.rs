use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

use crate::Recipe;

/// Commands with their names in earlier versions, which are read too.
const EARLIER_COMMANDS: [(&str, &str); 4] = [
    ("move_border", "pull"),
    ("clean", "tidy"),
    ("make_keyframe", "make_anchor"),
    ("attach", "adopt"),
];

/// Types and their keys with the names in earlier versions, which are read too.
const EARLIER_KEYS: [(&str, &str, &str); 2] = [
    ("CloudCorrection", "as_keyframes", "as_anchors"),
    ("SeenRegion", "uncertain_below", "doubtful_below"),
];

/// Returns the JSON Schema (2020-12) of a [`Recipe`].
///
/// It is made from the types that recipes are read into; their documentation becomes descriptions.
/// Unknown keys are not allowed. `#/$defs/Command` describes one command, and therefore one line of
/// a project's `recipe.jsonl`.
#[must_use]
pub fn recipe_schema() -> Value {
    let generator = SchemaSettings::draft2020_12().into_generator();
    let mut schema = generator.into_root_schema_for::<Recipe>().to_value();
    adapt(&mut schema);
    if let Some(types) = schema.get_mut("$defs") {
        for (name, key, earlier) in EARLIER_KEYS {
            if let Some(Value::Object(keys)) = types.pointer_mut(&format!("/{name}/properties")) {
                add_earlier(keys, key, earlier);
            }
        }
        if let Some(Value::Array(commands)) = types.pointer_mut("/Command/oneOf") {
            let earlier: Vec<Value> = EARLIER_COMMANDS
                .iter()
                .filter_map(|(name, earlier)| renamed(commands, name, earlier))
                .collect();
            commands.extend(earlier);
        }
    }
    schema
}

/// Adds a copy of the schema of `key` under the name `earlier`.
fn add_earlier(keys: &mut Map<String, Value>, key: &str, earlier: &str) {
    if let Some(Value::Object(mut schema)) = keys.get(key).cloned() {
        schema.insert("deprecated".into(), true.into());
        keys.insert(earlier.into(), schema.into());
    }
}

/// Returns a copy of the schema of a command, under an earlier name of the command.
fn renamed(commands: &[Value], name: &str, earlier: &str) -> Option<Value> {
    let command = commands
        .iter()
        .find(|command| command["properties"].get(name).is_some())?;
    let mut copy = command.clone();
    copy["properties"] = json!({ earlier: command["properties"][name] });
    copy["required"] = json!([earlier]);
    copy["deprecated"] = true.into();
    Some(copy)
}

/// Forbids unknown keys everywhere, and makes descriptions from documentation of Rust readable.
fn adapt(schema: &mut Value) {
    match schema {
        Value::Object(object) => {
            if object.get("properties").is_some_and(Value::is_object) {
                object
                    .entry("additionalProperties")
                    .or_insert(Value::Bool(false));
            }
            if let Some(Value::String(text)) = object.get_mut("description") {
                *text = described(text);
            }
            object.values_mut().for_each(adapt);
        }
        Value::Array(values) => values.iter_mut().for_each(adapt),
        _ => {}
    }
}

/// Returns the text of a documentation comment for readers of JSON.
///
/// Each paragraph becomes one line, `None` becomes `null`, and links keep only their text.
fn described(text: &str) -> String {
    let paragraphs: Vec<String> = text
        .split("\n\n")
        .map(|paragraph| paragraph.split_whitespace().collect::<Vec<_>>().join(" "))
        .collect();
    paragraphs
        .join("\n\n")
        .replace("`None`", "`null`")
        .replace("[`", "`")
        .replace("`]", "`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptions_have_no_traces_of_rust() {
        assert_eq!(
            described("First frame;\n`None` means 0.\n\nSee [`Frame`]."),
            "First frame; `null` means 0.\n\nSee `Frame`."
        );
        let text = recipe_schema().to_string();
        for trace in ["None", "Some(", "::", "Vec<", "Self", "PathBuf", "](", "[`"] {
            assert!(!text.contains(trace), "{trace}");
        }
    }

    #[test]
    fn everything_has_a_description() {
        fn collect(schema: &Value, path: &str, missing: &mut Vec<String>) {
            for (key, inner) in schema["properties"].as_object().into_iter().flatten() {
                let path = format!("{path}.{key}");
                if inner.get("description").is_none() && schema.get("description").is_none() {
                    missing.push(path.clone());
                }
                collect(inner, &path, missing);
            }
            for choice in schema["oneOf"].as_array().into_iter().flatten() {
                collect(choice, path, missing);
            }
        }
        let schema = recipe_schema();
        let mut missing = Vec::new();
        collect(&schema, "recipe", &mut missing);
        for (name, inner) in schema["$defs"].as_object().unwrap() {
            assert!(inner.get("description").is_some(), "{name}");
            collect(inner, name, &mut missing);
        }
        assert_eq!(missing, [] as [String; 0]);
    }
}
