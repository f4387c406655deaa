//! Small projects and their parts for tests.
#![expect(missing_docs, reason = "short functions for tests")]
#![expect(clippy::unwrap_used, reason = "a panic in a test is the report")]

use crate::ResultEngine;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use ostra_frames::{Frame, FrameCamera, ImageSource, Orientation};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{Label, LabelId, RunMask};

use crate::{Edit, FrameMask, MaskOrigin, Project, ResultRecord};

pub fn frame(name: &str) -> Frame {
    let image = ImageSource::File {
        path: Path::new("/nowhere").join(name),
        orientation: Orientation::default(),
    };
    Frame {
        name: name.into(),
        width: 4,
        height: 3,
        image,
        depth: None,
        camera: None,
    }
}

pub fn label(id: u16, name: &str) -> Label {
    Label {
        id: LabelId(id),
        name: name.into(),
        color: [id as u8, 20, 30],
        parent: None,
    }
}

pub fn camera(shift: f64) -> FrameCamera {
    let pose = Pose {
        translation: glam::DVec3::new(shift, 0.1, 1.0 / 3.0),
        ..Pose::IDENTITY
    };
    FrameCamera::given(Camera::pinhole(4, 3, [4.0, 4.0], [2.0, 1.5]), Some(pose))
}

pub fn mask(ids: [u16; 3], origin: MaskOrigin, stale: bool) -> FrameMask {
    let runs = RunMask::new(4, 3, ids.iter().map(|&id| (LabelId(id), 4)).collect()).unwrap();
    FrameMask {
        runs: Arc::new(runs),
        origin,
        stale,
        confidence: BTreeMap::new(),
    }
}

pub fn keyframe(ids: [u16; 3]) -> FrameMask {
    mask(ids, MaskOrigin::Keyframe, false)
}

pub fn tracked(ids: [u16; 3]) -> FrameMask {
    FrameMask {
        confidence: BTreeMap::from([(LabelId(1), 0.7)]),
        ..mask(ids, MaskOrigin::Tracked, false)
    }
}

pub fn record(engine: &str) -> ResultRecord {
    let settings = "made for a test".into();
    ResultRecord {
        engine: ResultEngine::from(engine),
        frames: 2,
        seconds: 0.1,
        stale: false,
        settings,
        version: 0,
        ..ResultRecord::default()
    }
}

/// Returns a project with five frames and two labels.
pub fn project() -> Project {
    let mut project = Project::default();
    let frames = ["a/0.png", "a/1.png", "b/0.png", "b/1.jpg", "b/1.png"]
        .map(frame)
        .to_vec();
    project.apply(Edit::AddFrames { frames }).unwrap();
    for label in [label(1, "leaf"), label(2, "stem")] {
        project
            .apply(Edit::SetLabel {
                id: label.id,
                label: Some(label),
            })
            .unwrap();
    }
    project
}
