use ostra_project::{SegmenterId, TrackerId};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::channel;

use anyhow::{Result, bail};

use super::{InteractOptions, InteractReport, Sequence, interact};
use crate::demo::ProgressSink;
use ostra_core::job::{Progress, Stopped};
use ostra_session::Event;
use ostra_session::{JobCompletion, JobKind};
use ostra_session::{Session, TrackSettings, engines};

/// Input of a simulated user.
#[derive(Debug, Clone, PartialEq)]
pub struct InteractRequest {
    /// A folder of frames, a video, or a project.
    pub frames: PathBuf,
    /// A folder of ground truth masks.
    pub truth: PathBuf,
    /// The tracker.
    pub tracker: TrackerId,
    /// The segmenter.
    pub segmenter: SegmenterId,
    /// Options of the simulated user.
    pub options: InteractOptions,
}

/// Runs [`interact`] as a job of a new session; also returns warnings about the files.
///
/// `watch` may stop the job.
///
/// # Errors
/// Returns the errors of [`Sequence::open`] and [`interact`], and an error if an engine is not
/// installed or does not fit the frames.
pub fn evaluate_interaction(
    request: &InteractRequest,
    watch: &mut ProgressSink<'_>,
) -> Result<(InteractReport, Vec<String>)> {
    let (request, (sender, receiver)) = (request.clone(), channel());
    let mut session = Session::new();
    session.start("Interact", JobKind::Long, move |context| {
        let played = play(&request, &context.progress)?;
        Ok(Box::new(move |_: &mut Session| Ok(sender.send(played)?)) as JobCompletion)
    });
    for event in session.settle(watch) {
        match event {
            Event::Failed { error, .. } => bail!(error),
            Event::Stopped { .. } => return Err(Stopped.into()),
            _ => {}
        }
    }
    Ok(receiver.try_recv()?)
}

fn play(request: &InteractRequest, progress: &Progress) -> Result<(InteractReport, Vec<String>)> {
    let (sequence, warnings) = Sequence::open(&request.frames, &request.truth, progress)?;
    let geometry = engines::geometry_segmenter(
        Arc::clone(&sequence.project().frames),
        Arc::clone(&sequence.store),
    );
    let segmenter = engines::click_segmenter(request.segmenter, geometry)?;
    let settings = TrackSettings {
        tracker: request.tracker,
        ..TrackSettings::default()
    };
    let tracker = engines::tracker(&settings, &sequence.project())?;
    let report = interact(
        &sequence,
        segmenter.as_ref(),
        tracker.as_ref(),
        &request.options,
        progress,
    )?;
    Ok((report, warnings))
}
