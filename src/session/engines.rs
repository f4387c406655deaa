use std::sync::Arc;

use anyhow::{Result, bail, ensure};

use super::{Project, TrackSettings};
use crate::masks::builtin::BuiltinSegmenter;
use crate::masks::flow::FlowTracker;
use crate::masks::{Segmenter, Tracker};
use crate::scene::GeometryTracker;

/// What an engine is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EngineKind {
    /// Turns prompts into masks.
    Segmenter,
    /// Carries masks through the sequence.
    Tracker,
}

/// A segmenter or tracker as lists show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Engine {
    /// What it is for.
    pub kind: EngineKind,
    /// Its name on the command line.
    pub name: &'static str,
    /// Whether it can be used now.
    pub installed: bool,
    /// What it needs: of the frames where it is installed, to be used at all where it is not.
    pub needs: &'static str,
}

/// Every engine that the command line names, `auto` first within its kind.
#[must_use]
pub fn engines() -> Vec<Engine> {
    const WEIGHTS: &str = "network weights, which this version cannot load yet; use 'builtin', 'geometry' or 'flow'";
    let segmenter = |name, installed, needs| Engine { kind: EngineKind::Segmenter, name, installed, needs };
    let tracker = |name, installed, needs| Engine { kind: EngineKind::Tracker, name, installed, needs };
    vec![
        segmenter("auto", true, "nothing; takes the best that is installed"),
        segmenter("sam", false, WEIGHTS),
        segmenter("builtin", true, "nothing"),
        tracker("auto", true, "what the tracker it takes needs"),
        tracker("xmem", false, WEIGHTS),
        tracker("deaot", false, WEIGHTS),
        tracker("geometry", true, "depth and cameras of the frames"),
        tracker("flow", true, "nothing"),
    ]
}

/// Refuses a name that is no engine, or one that is not installed, in one line that says what it needs.
pub(super) fn check_installed(kind: EngineKind, name: &str) -> Result<()> {
    let all = engines();
    let mut of_kind = all.iter().filter(|engine| engine.kind == kind);
    match of_kind.clone().find(|engine| engine.name == name) {
        Some(engine) if engine.installed => Ok(()),
        Some(engine) => bail!("'{name}' is not installed: it needs {}", engine.needs),
        None => {
            let what = if kind == EngineKind::Segmenter { "segmenter" } else { "tracker" };
            let names = of_kind.by_ref().map(|engine| engine.name).collect::<Vec<_>>().join(", ");
            bail!("there is no {what} '{name}'; choose one of {names}")
        }
    }
}

/// The segmenter of this name; `auto` is the best that is installed.
pub(super) fn segmenter(name: &str) -> Result<Arc<dyn Segmenter>> {
    check_installed(EngineKind::Segmenter, name)?;
    Ok(Arc::new(BuiltinSegmenter))
}

/// The tracker that the settings name; `auto` is the best that is installed and that the frames allow.
pub(super) fn tracker(settings: &TrackSettings, project: &Project) -> Result<Box<dyn Tracker>> {
    check_installed(EngineKind::Tracker, &settings.tracker)?;
    ensure!(
        !settings.constrain,
        "--constrain needs a tracker with network weights, which this version cannot load yet"
    );
    let geometry = project.frames.iter().any(|frame| frame.depth.is_some() && frame.posed_camera().is_some());
    match settings.tracker.as_str() {
        "flow" => Ok(Box::new(FlowTracker::default())),
        "auto" if !geometry => Ok(Box::new(FlowTracker::default())),
        _ => {
            ensure!(geometry, "'geometry' needs frames with depth and cameras; add both first, or track with 'flow'");
            Ok(Box::new(GeometryTracker::default()))
        }
    }
}
