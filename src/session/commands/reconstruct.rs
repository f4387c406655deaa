use anyhow::{Result, bail, ensure};

use crate::frames::Frame;
use crate::session::jobs::{Kind, Landing};
use crate::session::{Edit, JobId, Project, ReconstructMethod, ReconstructRequest, ResultKind, ResultRecord, Session};

impl Session {
    /// Takes given poses and depths as they are; making them is not possible yet.
    pub(in crate::session) fn reconstruct(&mut self, request: &ReconstructRequest) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        check(&project, request)?;
        let count = |has: fn(&Frame) -> bool| project.frames.iter().step_by(request.every).filter(|f| has(f)).count();
        let posed = count(|frame| frame.posed_camera().is_some());
        let with_depth = count(|frame| frame.depth.is_some());
        let both = count(|frame| frame.posed_camera().is_some() && frame.depth.is_some());
        ensure!(both > 0, "no frame has both a camera pose and depth; {}", needs(posed, with_depth));
        let settings = if request.every > 1 { format!("every {}", request.every) } else { String::new() };
        let edits =
            vec![given(ResultKind::Cameras, posed, &settings), given(ResultKind::Depths, with_depth, &settings)];
        Ok(self.start("Reconstruct", Kind::Long, move |_| {
            Ok(Box::new(move |session: &mut Self| session.commit("Reconstruct", edits)) as Landing)
        }))
    }
}

fn check(project: &Project, request: &ReconstructRequest) -> Result<()> {
    ensure!(request.every > 0, "every 0th frame is none; give 1 or more");
    ensure!(!project.frames.is_empty(), "the project has no frames");
    match request.method {
        ReconstructMethod::Auto => Ok(()),
        ReconstructMethod::Sfm => {
            bail!("structure from motion is not in this version yet; give cameras with --cameras")
        }
        ReconstructMethod::Mvs => bail!("stereo is not in this version yet; give depth pictures with --depth"),
        ReconstructMethod::Rgbd => bail!("RGB-D registration is not in this version yet; give cameras with --cameras"),
    }
}

/// What is missing, and how it can be given.
fn needs(posed: usize, with_depth: usize) -> &'static str {
    match (posed > 0, with_depth > 0) {
        (false, false) => "this version cannot make them yet: make the project with --cameras and --depth",
        (false, true) => "this version cannot find poses yet: make the project with --cameras",
        (true, false) => "this version cannot make depth yet: make the project with --depth",
        (true, true) => "the frames with poses are not those with depth: give both for the same frames",
    }
}

fn given(kind: ResultKind, frames: usize, settings: &str) -> Edit {
    let settings = settings.to_owned();
    let record = ResultRecord { engine: "given".into(), frames, seconds: 0.0, stale: false, settings, version: 0 };
    Edit::SetResult { kind, record: Some(record) }
}
