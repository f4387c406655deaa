//! Small projects and their parts for tests.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::frames::{Frame, FrameCamera, Orientation, PictureSource};
use crate::geometry::{Camera, Pose};
use crate::masks::{Label, LabelId, RunMask};
use crate::session::{Command, Edit, Event, FrameMask, MaskOrigin, Project, ResultRecord, Session};

pub fn frame(name: &str) -> Frame {
    let picture = PictureSource::File { path: Path::new("/nowhere").join(name), orientation: Orientation::default() };
    Frame { name: name.into(), width: 4, height: 3, picture, depth: None, camera: None }
}

pub fn label(id: u16, name: &str) -> Label {
    Label { id: LabelId(id), name: name.into(), color: [id as u8, 20, 30], parent: None }
}

pub fn camera(shift: f64) -> FrameCamera {
    let pose = Pose { translation: glam::DVec3::new(shift, 0.1, 1.0 / 3.0), ..Pose::IDENTITY };
    FrameCamera::given(Camera::pinhole(4, 3, 4.0, 4.0, 2.0, 1.5), Some(pose))
}

pub fn mask(ids: [u16; 3], origin: MaskOrigin, stale: bool) -> FrameMask {
    let runs = RunMask::new(4, 3, ids.iter().map(|&id| (LabelId(id), 4)).collect()).unwrap();
    FrameMask { runs: Arc::new(runs), origin, stale, confidence: BTreeMap::new() }
}

pub fn anchor(ids: [u16; 3]) -> FrameMask {
    mask(ids, MaskOrigin::Anchor, false)
}

pub fn tracked(ids: [u16; 3]) -> FrameMask {
    FrameMask { confidence: BTreeMap::from([(LabelId(1), 0.7)]), ..mask(ids, MaskOrigin::Tracked, false) }
}

pub fn record(engine: &str) -> ResultRecord {
    let settings = "made for a test".into();
    ResultRecord {
        engine: engine.into(),
        frames: 2,
        seconds: 0.1,
        stale: false,
        settings,
        version: 0,
        ..ResultRecord::default()
    }
}

/// Five frames, two labels, nothing else.
pub fn project() -> Project {
    let mut project = Project::default();
    let frames = ["a/0.png", "a/1.png", "b/0.png", "b/1.jpg", "b/1.png"].map(frame).to_vec();
    project.apply(Edit::AddFrames { frames }).unwrap();
    for label in [label(1, "leaf"), label(2, "stem")] {
        project.apply(Edit::SetLabel { id: label.id, label: Some(label) }).unwrap();
    }
    project
}

/// Writes three small pictures and gives their folder.
pub fn pictures(folder: &Path) -> PathBuf {
    let place = folder.join("pictures");
    std::fs::create_dir_all(&place).unwrap();
    for k in 0..3u8 {
        let picture = image::RgbImage::from_fn(64, 48, |x, _| {
            image::Rgb(if (20..40).contains(&x) { [200, 40, 40] } else { [30, 60 + k, 90] })
        });
        picture.save(place.join(format!("{k}.png"))).unwrap();
    }
    place
}

/// Carries out a command to its end; a failure of its job is an error.
pub fn perform(session: &mut Session, command: Command) -> anyhow::Result<Vec<Event>> {
    session.act(command)?;
    let events = session.settle(|_| ControlFlow::Continue(()));
    for event in &events {
        if let Event::Failed { error, .. } = event {
            anyhow::bail!("{error}");
        }
    }
    Ok(events)
}
