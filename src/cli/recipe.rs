//! Recipes: reading, running and their schema.

use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::de::DeserializeOwned;
use serde_ignored::Path as Place;

use super::drive::Driver;
use super::print::print_text;
use ostra_session::{Command, Recipe, recipe_schema};

/// Prints the JSON Schema of recipes.
pub(super) fn print_schema() -> Result<()> {
    print_text(&schema_text()?);
    Ok(())
}

/// Returns the JSON Schema of recipes, as a file.
pub(super) fn schema_text() -> Result<String> {
    Ok(format!(
        "{}\n",
        serde_json::to_string_pretty(&recipe_schema())?
    ))
}

/// Runs the commands of a recipe.
pub(super) fn run(path: &Path) -> Result<()> {
    let text = ostra_core::disk::read_text(path)
        .with_context(|| format!("{}: cannot be read; check the path", path.display()))?;
    let (recipe, unknown) = read(&text).with_context(|| {
        format!(
            "{}: is not a recipe; save one from the window",
            path.display()
        )
    })?;
    if recipe.format != 1 {
        bail!(
            "{}: the recipe has format {}, this version of OSTRA reads format 1; install a newer version",
            path.display(),
            recipe.format
        );
    }
    // A misspelt key would otherwise be replaced by a default.
    if let Some(first) = unknown.first() {
        bail!(
            "{}: {first} is not known; check its spelling (`ostra run --schema` prints all keys)",
            path.display()
        );
    }
    Driver::new().act_and_save(recipe.commands)
}

/// Parses a saved recipe or the `recipe.jsonl` of a project, which holds one command per line.
///
/// The result includes the keys that are not known, with the numbers of their commands from 1.
pub(super) fn read(text: &str) -> serde_json::Result<(Recipe, Vec<String>)> {
    let error = match parse::<Recipe>(text) {
        Ok((recipe, places)) => {
            return Ok((
                recipe,
                places.iter().map(|place| described(place)).collect(),
            ));
        }
        Err(error) => error,
    };
    let lines = text.lines().filter(|line| !line.trim().is_empty());
    let commands: serde_json::Result<Vec<_>> = lines.map(parse::<Command>).collect();
    let Some(lines) = commands.ok().filter(|commands| !commands.is_empty()) else {
        return Err(error);
    };
    let mut unknown = Vec::new();
    let mut commands = Vec::new();
    for (index, (command, places)) in lines.into_iter().enumerate() {
        commands.push(command);
        for place in places {
            let at = [vec!["commands".into(), index.to_string()], place].concat();
            unknown.push(described(&at));
        }
    }
    Ok((
        Recipe {
            format: 1,
            commands,
        },
        unknown,
    ))
}

/// Parses a value; the result includes the places of all keys that are not known.
fn parse<T: DeserializeOwned>(text: &str) -> serde_json::Result<(T, Vec<Vec<String>>)> {
    let mut unknown = Vec::new();
    let mut reader = serde_json::Deserializer::from_str(text);
    let value = serde_ignored::deserialize(&mut reader, |place| unknown.push(steps_to(&place)))?;
    reader.end()?;
    Ok((value, unknown))
}

/// Returns the keys and indices that lead to a place.
fn steps_to(place: &Place) -> Vec<String> {
    let (parent, step) = match place {
        Place::Root => return Vec::new(),
        Place::Seq { parent, index } => (parent, Some(index.to_string())),
        Place::Map { parent, key } => (parent, Some(key.clone())),
        Place::Some { parent }
        | Place::NewtypeStruct { parent }
        | Place::NewtypeVariant { parent } => (parent, None),
    };
    let mut steps = steps_to(parent);
    steps.extend(step);
    steps
}

fn described(place: &[String]) -> String {
    match place {
        [commands, index, steps @ ..] if commands == "commands" && !steps.is_empty() => {
            let number = index.parse::<usize>().map_or(0, |index| index + 1);
            format!("'{}' of command {number}", steps.join("."))
        }
        steps => format!("'{}'", steps.join(".")),
    }
}
