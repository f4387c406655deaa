use anyhow::{Result, bail, ensure};

use super::cameras::Poses;
use crate::frames::Frame;
use crate::session::jobs::{Kind, Landing};
use crate::session::{Edit, JobId, Project, ReconstructMethod, ReconstructRequest, ResultKind, ResultRecord, Session};

/// What a reconstruction comes down to.
enum Way {
    /// Poses and depths are there.
    Given,
    /// Cameras are found.
    Cameras(Poses),
}

impl Session {
    /// Finds cameras that are missing; takes given poses and depths as they are. Making depths is not possible yet.
    pub(in crate::session) fn reconstruct(&mut self, request: &ReconstructRequest) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        match way(&project, request)? {
            Way::Given => self.take_given(&project, request),
            Way::Cameras(poses) => self.find_cameras(project, request, poses),
        }
    }

    fn take_given(&mut self, project: &Project, request: &ReconstructRequest) -> Result<JobId> {
        let count = |has: fn(&Frame) -> bool| project.frames.iter().step_by(request.every).filter(|f| has(f)).count();
        let posed = count(is_posed);
        let with_depth = count(|frame| frame.depth.is_some());
        let both = count(|frame| is_posed(frame) && frame.depth.is_some());
        ensure!(
            both > 0,
            "all frames have cameras, and depth without depth pictures is not in this version yet; to find the cameras \
             anew choose the method 'sfm' (cameras only)"
        );
        let settings = if request.every > 1 { format!("every {}", request.every) } else { String::new() };
        let edits =
            vec![given(ResultKind::Cameras, posed, &settings), given(ResultKind::Depths, with_depth, &settings)];
        Ok(self.start("Reconstruct", Kind::Long, move |_| {
            Ok(Box::new(move |session: &mut Self| session.commit("Reconstruct", edits)) as Landing)
        }))
    }
}

fn way(project: &Project, request: &ReconstructRequest) -> Result<Way> {
    ensure!(request.every > 0, "every 0th frame is none; give 1 or more");
    ensure!(!project.frames.is_empty(), "the project has no frames");
    match request.method {
        ReconstructMethod::Auto => {
            let posed = project.frames.iter().filter(|frame| is_posed(frame)).count();
            let chosen_posed = project.frames.iter().step_by(request.every).all(is_posed);
            Ok(match posed {
                _ if chosen_posed => Way::Given,
                0 | 1 => Way::Cameras(Poses::Anew),
                _ => Way::Cameras(Poses::Kept),
            })
        }
        ReconstructMethod::Sfm => Ok(Way::Cameras(Poses::Anew)),
        ReconstructMethod::Mvs => bail!("stereo is not in this version yet; give depth pictures with --depth"),
        ReconstructMethod::Rgbd => bail!("RGB-D registration is not in this version yet; give cameras with --cameras"),
    }
}

fn is_posed(frame: &Frame) -> bool {
    frame.posed_camera().is_some()
}

/// The record of a result that came with the frames.
pub(super) fn given(kind: ResultKind, frames: usize, settings: &str) -> Edit {
    let settings = settings.to_owned();
    let record = ResultRecord { engine: "given".into(), frames, seconds: 0.0, stale: false, settings, version: 0 };
    Edit::SetResult { kind, record: Some(record) }
}
