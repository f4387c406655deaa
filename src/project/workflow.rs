//! The steps from frames to measures: what is done, what is out of date, what comes next.

use std::ops::RangeInclusive;

use crate::{MaskOrigin, Project, ResultKind};
use ostra_frames::{Frame, ImageSource};

/// Step of the way from frames to measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum WorkflowStep {
    /// Marks objects on some frames.
    Label,
    /// Carries the masks to the other frames.
    Track,
    /// Computes cameras and depth maps.
    Geometry,
    /// Fuses the frames into a labelled cloud.
    Cloud,
    /// Measures and exports the result.
    Measure,
}

/// State of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepState {
    /// Not done, and something else comes first.
    Open,
    /// Recommended now.
    Next,
    /// Done with the present inputs.
    Done,
    /// Done, but its inputs have changed since.
    Stale,
}

/// A step with its state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StepStatus {
    /// The step.
    pub step: WorkflowStep,
    /// Its state. The recommended step may be [`StepState::Stale`].
    pub state: StepState,
    /// What is there, in a few words.
    pub text: String,
}

/// What is known outside the project's document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WorkflowInput {
    /// Whether a cloud is there.
    pub has_cloud: bool,
    /// Frames to track, both ends included.
    pub range: RangeInclusive<usize>,
}

/// Steps in the recommended order, and the one to do next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Workflow {
    /// The steps with their states.
    pub steps: [StepStatus; 5],
    /// Step to do next.
    pub next: WorkflowStep,
}

impl Workflow {
    /// Returns the state of a step.
    #[must_use]
    pub fn of(&self, step: WorkflowStep) -> Option<&StepStatus> {
        self.steps.iter().find(|status| status.step == step)
    }
}

/// Returns the steps of a project in the recommended order with their states.
///
/// Photos get cameras and depth maps before tracking, because re-projection then carries their
/// masks. Frames of a video are tracked first.
#[must_use]
pub fn workflow(project: &Project, input: &WorkflowInput) -> Workflow {
    let label = label_status(project);
    let track = track_status(project, input);
    let geometry = geometry_status(project);
    let cloud = cloud_status(project, input);
    let measure = StepStatus {
        step: WorkflowStep::Measure,
        state: StepState::Open,
        text: match cloud.state {
            StepState::Done => "ready",
            StepState::Stale => "cloud out of date",
            _ => "needs a cloud",
        }
        .into(),
    };
    let is_cloud_done = cloud.state == StepState::Done;
    let mut steps = if is_video(project) {
        [label, track, geometry, cloud, measure]
    } else {
        [label, geometry, track, cloud, measure]
    };
    let unfinished = steps
        .iter()
        .find(|status| status.state != StepState::Done)
        .map_or(WorkflowStep::Measure, |status| status.step);
    // Who fuses without tracking every frame is not sent back.
    let next = match unfinished {
        WorkflowStep::Label => WorkflowStep::Label,
        _ if is_cloud_done => WorkflowStep::Measure,
        step => step,
    };
    for status in &mut steps {
        if status.step == next && status.state == StepState::Open {
            status.state = StepState::Next;
        }
    }
    Workflow { steps, next }
}

fn is_video(project: &Project) -> bool {
    project
        .frames
        .first()
        .is_some_and(|frame| matches!(frame.image, ImageSource::Video { .. }))
}

fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

fn label_status(project: &Project) -> StepStatus {
    let keyframes = project
        .masks
        .values()
        .filter(|mask| mask.origin == MaskOrigin::Keyframe)
        .count();
    let labels = project.labels.iter().count();
    let (state, text) = if keyframes > 0 {
        (StepState::Done, counted(keyframes, "keyframe", "keyframes"))
    } else if labels > 0 {
        (StepState::Open, counted(labels, "label", "labels"))
    } else {
        (StepState::Open, "nothing marked".into())
    };
    StepStatus {
        step: WorkflowStep::Label,
        state,
        text,
    }
}

fn track_status(project: &Project, input: &WorkflowInput) -> StepStatus {
    let last = project.frames.len().saturating_sub(1);
    let (from, to) = (*input.range.start(), (*input.range.end()).min(last));
    let count = if project.frames.is_empty() {
        0
    } else {
        (to + 1).saturating_sub(from)
    };
    let masks = || {
        project
            .masks
            .iter()
            .filter(|(frame, _)| (from..=to).contains(*frame))
    };
    let stale = masks().filter(|(_, mask)| mask.stale).count();
    let there = masks().count();
    let (state, text) = if stale > 0 {
        let text = format!("{} to redo", counted(stale, "frame", "frames"));
        (StepState::Stale, text)
    } else if count > 0 && there == count {
        (StepState::Done, counted(count, "frame", "frames"))
    } else {
        (StepState::Open, format!("{there} of {count} frames"))
    };
    StepStatus {
        step: WorkflowStep::Track,
        state,
        text,
    }
}

fn geometry_status(project: &Project) -> StepStatus {
    let count = |is_counted: fn(&Frame) -> bool| {
        project
            .frames
            .iter()
            .filter(|frame| is_counted(frame))
            .count()
    };
    let cameras = count(|frame| frame.posed_camera().is_some());
    let depths = count(|frame| frame.depth.is_some());
    let is_stale = [ResultKind::Cameras, ResultKind::Depths]
        .iter()
        .filter_map(|kind| project.results.get(kind))
        .any(|record| record.stale);
    let is_done = count(Frame::has_posed_depth) > 0;
    let (state, text) = match (is_done, is_stale) {
        (true, true) => (StepState::Stale, "out of date".into()),
        (true, false) if cameras < project.frames.len() => {
            let text = format!("{cameras} of {} cameras", project.frames.len());
            (StepState::Done, text)
        }
        (true, false) => (StepState::Done, counted(cameras, "camera", "cameras")),
        (false, _) if cameras > 0 => (StepState::Open, "no depth maps".into()),
        (false, _) if depths > 0 => (StepState::Open, "no cameras".into()),
        (false, _) => (StepState::Open, "none yet".into()),
    };
    StepStatus {
        step: WorkflowStep::Geometry,
        state,
        text,
    }
}

fn cloud_status(project: &Project, input: &WorkflowInput) -> StepStatus {
    let record = project.results.get(&ResultKind::Cloud);
    let (state, text) = match record {
        Some(record) if record.stale => (StepState::Stale, "out of date"),
        Some(_) => (StepState::Done, "up to date"),
        None if input.has_cloud => (StepState::Done, "up to date"),
        None => (StepState::Open, "not fused"),
    };
    StepStatus {
        step: WorkflowStep::Cloud,
        state,
        text: text.into(),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::ResultRecord;
    use crate::testing::{camera, frame, keyframe, mask};
    use ostra_frames::DepthSource;

    fn photos(count: usize) -> Project {
        let frames = (0..count).map(|number| frame(&format!("{number}.png")));
        Project {
            frames: Arc::new(frames.collect()),
            ..Project::default()
        }
    }

    fn with_geometry(mut project: Project) -> Project {
        let mut frames = project.frames.to_vec();
        for frame in &mut frames {
            frame.camera = Some(camera(0.0));
            frame.depth = Some(DepthSource::Sensor {
                path: "/d.png".into(),
                unit: 0.001,
                orientation: Default::default(),
                camera: None,
            });
        }
        project.frames = Arc::new(frames);
        project
    }

    fn flow(project: &Project) -> Workflow {
        let last = project.frames.len().saturating_sub(1);
        let input = WorkflowInput {
            has_cloud: false,
            range: 0..=last,
        };
        workflow(project, &input)
    }

    fn order(flow: &Workflow) -> [WorkflowStep; 5] {
        flow.steps.each_ref().map(|status| status.step)
    }

    fn state(flow: &Workflow, step: WorkflowStep) -> StepState {
        flow.of(step).unwrap().state
    }

    fn tracked(project: &mut Project, stale: bool) {
        project.masks.insert(0, keyframe([0, 1, 0]));
        for number in 1..project.frames.len() {
            let mask = mask([0, 1, 0], MaskOrigin::Tracked, stale);
            project.masks.insert(number, mask);
        }
    }

    fn fused(project: &mut Project, stale: bool) {
        let record = ResultRecord {
            stale,
            ..ResultRecord::default()
        };
        project.results.insert(ResultKind::Cloud, record);
    }

    #[test]
    fn photos_get_cameras_before_tracking_and_videos_after_it() {
        use WorkflowStep as S;
        let mut project = photos(3);
        assert_eq!(
            order(&flow(&project)),
            [S::Label, S::Geometry, S::Track, S::Cloud, S::Measure]
        );
        assert_eq!(flow(&project).next, S::Label);
        project.masks.insert(0, keyframe([0, 1, 0]));
        assert_eq!(flow(&project).next, S::Geometry);
        let mut frames = project.frames.to_vec();
        for (index, frame) in (0..).zip(&mut frames) {
            frame.image = ImageSource::Video {
                path: "/v.mp4".into(),
                index,
                time_s: 0.0,
            };
        }
        project.frames = Arc::new(frames);
        assert_eq!(
            order(&flow(&project)),
            [S::Label, S::Track, S::Geometry, S::Cloud, S::Measure]
        );
        assert_eq!(flow(&project).next, S::Track);
        assert_eq!(state(&flow(&project), S::Track), StepState::Next);
    }

    #[test]
    fn rgbd_recording_with_cameras_needs_no_reconstruction() {
        let mut project = with_geometry(photos(2));
        assert_eq!(
            state(&flow(&project), WorkflowStep::Geometry),
            StepState::Done
        );
        project.masks.insert(0, keyframe([0, 1, 0]));
        assert_eq!(flow(&project).next, WorkflowStep::Track);
        let text = |project: &Project| {
            flow(project)
                .of(WorkflowStep::Geometry)
                .unwrap()
                .text
                .clone()
        };
        assert_eq!(text(&project), "2 cameras");
        let mut partly = project.clone();
        let mut frames = partly.frames.to_vec();
        frames[1].camera = None;
        partly.frames = Arc::new(frames);
        assert_eq!(text(&partly), "1 of 2 cameras");
        let stale = ResultRecord {
            stale: true,
            ..ResultRecord::default()
        };
        project.results.insert(ResultKind::Depths, stale);
        assert_eq!(
            state(&flow(&project), WorkflowStep::Geometry),
            StepState::Stale
        );
        assert_eq!(flow(&project).next, WorkflowStep::Geometry);
    }

    #[test]
    fn tracking_is_done_when_every_frame_of_the_range_has_a_fresh_mask() {
        let mut project = with_geometry(photos(4));
        tracked(&mut project, false);
        assert_eq!(state(&flow(&project), WorkflowStep::Track), StepState::Done);
        project.masks.get_mut(&2).unwrap().stale = true;
        let stale = flow(&project);
        let status = stale.of(WorkflowStep::Track).unwrap();
        assert_eq!(
            (status.state, status.text.as_str(), stale.next),
            (StepState::Stale, "1 frame to redo", WorkflowStep::Track)
        );
        project.masks.remove(&2);
        let part = flow(&project);
        let status = part.of(WorkflowStep::Track).unwrap();
        assert_eq!(
            (status.state, status.text.as_str()),
            (StepState::Next, "3 of 4 frames")
        );
        let input = WorkflowInput {
            has_cloud: false,
            range: 0..=1,
        };
        let part = workflow(&project, &input);
        assert_eq!(state(&part, WorkflowStep::Track), StepState::Done);
        assert_eq!(part.next, WorkflowStep::Cloud);
    }

    #[test]
    fn measuring_is_next_with_a_fresh_cloud_only() {
        let mut project = with_geometry(photos(2));
        tracked(&mut project, false);
        assert_eq!(flow(&project).next, WorkflowStep::Cloud);
        fused(&mut project, false);
        assert_eq!(flow(&project).next, WorkflowStep::Measure);
        assert_eq!(
            state(&flow(&project), WorkflowStep::Measure),
            StepState::Next
        );
        project.masks.remove(&1);
        assert_eq!(
            flow(&project).next,
            WorkflowStep::Measure,
            "fused on purpose"
        );
        fused(&mut project, true);
        tracked(&mut project, false);
        assert_eq!(
            state(&flow(&project), WorkflowStep::Cloud),
            StepState::Stale
        );
        assert_eq!(flow(&project).next, WorkflowStep::Cloud);
    }
}
