use crate::job_task::JobTask;
use ostra_project::ResultEngine;
use std::sync::Arc;

use anyhow::{Result, ensure};

use super::cameras::{CameraWork, Finder};
use super::found_cameras::{Poses, given, is_posed};
use super::stereo::{StereoWork, depth_options, make_depths};
use crate::Session;
use crate::{JobCompletion, JobKind};
use ostra_core::job::{JobId, PlannedStage, Stopped};
use ostra_frames::Frame;
use ostra_project::{Edit, Project, ReconstructMethod, ReconstructRequest, ResultKind};
use ostra_reconstruct::{rgbd, sfm, stereo};

/// How a reconstruction is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ReconstructionPlan {
    /// Poses and depths already exist.
    Given,
    /// Cameras are found and depths are made, if requested.
    Made {
        cameras: Option<Finder>,
        depths: bool,
    },
}

impl Session {
    /// Finds missing cameras and makes depths by stereo; given poses and depths are kept.
    pub(crate) fn reconstruct(&mut self, request: &ReconstructRequest) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        match way(&project, request)? {
            ReconstructionPlan::Given => self.take_given(&project, request),
            ReconstructionPlan::Made { cameras, depths } => {
                self.make(project, request, cameras, depths)
            }
        }
    }

    fn make(
        &mut self,
        project: Arc<Project>,
        request: &ReconstructRequest,
        cameras: Option<Finder>,
        depths: bool,
    ) -> Result<JobId> {
        let camera_work = cameras
            .map(|finder| CameraWork::new(Arc::clone(&project), request, finder, self))
            .transpose()?;
        let work = StereoWork {
            project,
            root: self.opened()?.root().to_owned(),
            store: Arc::clone(&self.store),
            request: request.clone(),
            version: self.opened()?.next_version()?,
        };
        let plan = planned_stages(&work.project, request, cameras, depths);
        Ok(
            self.start(JobTask::Reconstruct, JobKind::Long, move |context| {
                context.progress.plan(&plan);
                let mut work = work;
                if let Some(camera_work) = camera_work {
                    let found = camera_work.find(context)?;
                    let stopped = found.stopped;
                    work.project = Arc::new(found.applied()?);
                    context.send(move |session: &mut Self| found.land(session))?;
                    if stopped {
                        return Err(Stopped.into());
                    }
                }
                if depths {
                    make_depths(work, context)?;
                }
                Ok(Box::new(|_: &mut Self| Ok(())) as JobCompletion)
            }),
        )
    }

    fn take_given(&mut self, project: &Project, request: &ReconstructRequest) -> Result<JobId> {
        let count = |has: fn(&Frame) -> bool| {
            project
                .frames
                .iter()
                .step_by(request.every)
                .filter(|f| has(f))
                .count()
        };
        let posed = count(is_posed);
        let with_depth = count(|frame| frame.depth.is_some());
        let settings = if request.every > 1 {
            format!("every {}", request.every)
        } else {
            String::new()
        };
        // Results with files of their own were made here and stay unchanged.
        let was_made = |kind| {
            project
                .results
                .get(&kind)
                .is_some_and(|record| record.version > 0)
        };
        let counts = [
            (ResultKind::Cameras, posed),
            (ResultKind::Depths, with_depth),
        ];
        let given = counts.into_iter().filter(|&(kind, _)| !was_made(kind));
        let mut edits: Vec<Edit> = given
            .map(|(kind, frames)| self::given(kind, frames, &settings))
            .collect();
        for edit in &mut edits {
            // Given cameras that were scaled stay so.
            if let Edit::SetResult {
                kind,
                record: Some(record),
            } = edit
                && let Some(before) = project
                    .results
                    .get(kind)
                    .filter(|before| before.engine == ResultEngine::Given)
            {
                (record.coordinates, record.scaled) = (before.coordinates, before.scaled);
            }
        }
        Ok(self.start(JobTask::Reconstruct, JobKind::Long, move |_| {
            Ok(
                Box::new(move |session: &mut Self| session.commit("Reconstruct", edits))
                    as JobCompletion,
            )
        }))
    }
}

/// Returns the stages of a reconstruction, by the number and size of its images.
fn planned_stages(
    project: &Project,
    request: &ReconstructRequest,
    cameras: Option<Finder>,
    depths: bool,
) -> Vec<PlannedStage> {
    let chosen = || project.frames.iter().step_by(request.every);
    let (count, has_depth) = (
        chosen().count(),
        project.frames.iter().any(Frame::has_sensor_depth),
    );
    let between = project.frames.len() - count;
    let mut stages = match cameras {
        Some(Finder::Sfm(_)) => sfm::planned_stages(count, between, has_depth),
        Some(Finder::Rgbd) => rgbd::planned_stages(count, between),
        None => Vec::new(),
    };
    if depths {
        let options = depth_options(request);
        let views = || chosen().filter(|frame| !frame.has_sensor_depth());
        let pixels = |frame: &Frame| {
            let (width, height) = (f64::from(frame.width), f64::from(frame.height));
            let longest = width.max(height).max(1.0);
            let scale = (f64::from(options.max_side) / longest).min(1.0);
            width * height * scale * scale
        };
        stages.extend(stereo::planned_stages(
            views().count(),
            views().map(pixels).sum(),
            &options,
        ));
    }
    stages
}

fn way(project: &Project, request: &ReconstructRequest) -> Result<ReconstructionPlan> {
    ensure!(!project.frames.is_empty(), "the project has no frames");
    let posed = project
        .frames
        .iter()
        .filter(|frame| is_posed(frame))
        .count();
    let missing = match posed {
        _ if project.frames.iter().step_by(request.every).all(is_posed) => None,
        0 | 1 => Some(Poses::FromScratch),
        _ => Some(Poses::Kept),
    };
    let measured = project.frames.iter().any(Frame::has_sensor_depth);
    match request.method {
        ReconstructMethod::Auto if measured && missing.is_none() => Ok(ReconstructionPlan::Given),
        ReconstructMethod::Auto
            if missing == Some(Poses::FromScratch)
                && is_rgbd(project)
                && !request.only_labelled =>
        {
            Ok(ReconstructionPlan::Made {
                cameras: Some(Finder::Rgbd),
                depths: false,
            })
        }
        ReconstructMethod::Auto => Ok(ReconstructionPlan::Made {
            cameras: missing.map(Finder::Sfm),
            depths: !measured,
        }),
        ReconstructMethod::Sfm => Ok(ReconstructionPlan::Made {
            cameras: Some(Finder::Sfm(Poses::FromScratch)),
            depths: false,
        }),
        // Existing cameras are sufficient. A frame that was left out before does not cause a new
        // search for all.
        ReconstructMethod::Mvs => {
            let cameras = missing.filter(|_| posed < 2).map(Finder::Sfm);
            Ok(ReconstructionPlan::Made {
                cameras,
                depths: true,
            })
        }
        ReconstructMethod::Rgbd => {
            ensure!(
                measured,
                "no frame has depth of a sensor; give it with --depth, or --method sfm or mvs"
            );
            ensure!(
                !request.only_labelled,
                "RGB-D registration takes all that the sensor sees; leave out --only-labelled"
            );
            Ok(ReconstructionPlan::Made {
                cameras: Some(Finder::Rgbd),
                depths: false,
            })
        }
    }
}

/// Returns whether all frames have sensor depth and given intrinsics.
fn is_rgbd(project: &Project) -> bool {
    let known = |frame: &Frame| {
        frame
            .camera
            .as_ref()
            .is_some_and(|camera| !camera.estimated)
    };
    project
        .frames
        .iter()
        .all(|frame| frame.has_sensor_depth() && known(frame))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::{ImageSource, Orientation};

    #[test]
    fn steps_are_named_in_order_and_larger_images_take_a_larger_share() {
        let request = ReconstructRequest::default();
        let stages = |side: u32| {
            let frame = Frame {
                name: "a.jpg".into(),
                width: side,
                height: side,
                image: ImageSource::File {
                    path: "a.jpg".into(),
                    orientation: Orientation::default(),
                },
                depth: None,
                camera: None,
            };
            let project = Project {
                frames: Arc::new(vec![frame; 4]),
                ..Project::default()
            };
            let cameras = Some(Finder::Sfm(Poses::FromScratch));
            planned_stages(&project, &request, cameras, true)
        };
        let mut steps: Vec<&str> = stages(500).iter().map(|stage| stage.step).collect();
        steps.dedup();
        assert_eq!(
            steps,
            [
                "Find features",
                "Match images",
                "Compute cameras",
                "Choose views",
                "Compute depth",
                "Check depth consistency",
                "Clean depth",
                "Keep results"
            ]
        );
        let share = |stages: &[PlannedStage]| {
            let total: f64 = stages.iter().map(|stage| stage.weight).sum();
            stages
                .iter()
                .filter(|stage| stage.name.ends_with("depth"))
                .map(|stage| stage.weight / total)
                .sum::<f64>()
        };
        assert!(share(&stages(1200)) > share(&stages(300)));
    }
}
