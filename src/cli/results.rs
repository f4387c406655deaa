//! Results of a project as JSON.

use anyhow::Result;
use serde_json::{Map, Value, json};

use super::drive::Driver;
use super::memory::peak_bytes;
use super::print::print_json;
use ostra_project::{Project, ResultKind, ResultRecord, SparseModelRecord};
use ostra_session::Command;

/// Returns the results of a project by name.
pub(super) fn results_json(project: &Project) -> Map<String, Value> {
    let value = |(kind, record): (&ResultKind, &ResultRecord)| {
        let mut value = json!({
            "engine": record.engine.name(), "frames": record.frames, "seconds": record.seconds, "stale": record.stale,
        });
        if !record.steps.is_empty() {
            value["steps"] = json!(record.steps);
        }
        if !record.models.is_empty() {
            value["models"] = models_json(record);
        }
        (result_name(*kind).to_owned(), value)
    };
    project.results.iter().map(value).collect()
}

/// Returns the models that the images fall into.
fn models_json(record: &ResultRecord) -> Value {
    let in_use = record.model_in_use();
    let models = record.models.iter().enumerate();
    let model = |(index, model): (usize, &SparseModelRecord)| {
        json!({
            "model": index + 1, "images": model.frames, "points": model.points,
            "in_use": in_use == Some(index),
        })
    };
    models.map(model).collect()
}

/// Returns the name of a kind of result in texts and JSON.
pub(super) fn result_name(kind: ResultKind) -> &'static str {
    match kind {
        ResultKind::Tracking => "tracking",
        ResultKind::Cameras => "cameras",
        ResultKind::Depths => "depths",
        ResultKind::Cloud => "cloud",
    }
}

/// Runs a command and saves the project. With `is_json`, prints the results of these kinds.
///
/// Notices then go to standard error, so that the JSON is all of standard output.
pub(super) fn act_and_print(
    driver: Driver,
    command: Command,
    kinds: &[ResultKind],
    is_json: bool,
) -> Result<()> {
    if !is_json {
        return driver.act_and_save([command]);
    }
    let driver = driver.with_notices_on_stderr().keep([command])?;
    let mut results = results_json(driver.project()?);
    results.retain(|name, _| kinds.iter().any(|&kind| result_name(kind) == name));
    print_json(&json!({ "results": results, "peak_memory_bytes": peak_bytes() }));
    Ok(())
}
