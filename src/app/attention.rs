//! What is seen of running work while the window is in the background.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use ostra_core::job::JobId;
use ostra_session::{Event, JobView};

/// Time that work takes at least for its end to call for attention.
const WORTH_ATTENTION: Duration = Duration::from_secs(20);

/// When each running job started.
#[derive(Default)]
pub(super) struct Attention {
    started: BTreeMap<JobId, Instant>,
}

impl Attention {
    /// Returns `true` if an event ends work that took long and that the user did not stop.
    pub fn is_due(&mut self, event: &Event, now: Instant) -> bool {
        let (job, was_stopped) = match event {
            Event::Started { job, .. } => {
                self.started.insert(*job, now);
                return false;
            }
            Event::Finished { job, .. } | Event::Failed { job, .. } | Event::Paused { job, .. } => {
                (job, false)
            }
            Event::Stopped { job, .. } => (job, true),
            _ => return false,
        };
        let started = self.started.remove(job);
        let took = started.map(|started| now.saturating_duration_since(started));
        !was_stopped && took.is_some_and(|took| took >= WORTH_ATTENTION)
    }
}

/// Shows a message of the system for the end of a job.
///
/// It is sent on a thread of its own, because the service may be slow to answer. A system without
/// such a service shows none; the window asks for attention in any case.
pub(super) fn notify_end(event: &Event, project: &str) {
    let Some(text) = end_text(event) else {
        return;
    };
    let mut notification = notify_rust::Notification::new();
    notification.appname("OSTRA").summary(&text).body(project);
    std::thread::spawn(move || notification.show().map(drop));
}

/// Returns what to say about the end of a job.
fn end_text(event: &Event) -> Option<String> {
    Some(match event {
        Event::Finished { title, .. } => format!("{title}: done"),
        Event::Failed { title, .. } => format!("{title}: failed"),
        Event::Paused { .. } => "Tracking waits for a correction".into(),
        _ => return None,
    })
}

/// Returns the window's title with the share done of the oldest job, if it takes a while.
pub(super) fn title_with_progress(title: &str, jobs: &[JobView]) -> String {
    let slow = jobs.iter().find(|job| job.elapsed.as_secs() >= 1);
    match slow.and_then(|job| job.overview.fraction) {
        Some(fraction) => format!("{:.0} % – {title}", (fraction * 100.0).floor()),
        None => title.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_core::job::{Overview, ProgressReport};

    fn started(job: JobId) -> Event {
        Event::Started {
            job,
            title: "Fuse".into(),
        }
    }

    #[test]
    fn only_the_end_of_long_work_calls_for_attention() {
        let (mut attention, now) = (Attention::default(), Instant::now());
        let ends = |job| Event::Finished {
            job,
            title: "Fuse".into(),
        };
        let later = |seconds| now + Duration::from_secs(seconds);
        for job in [1, 2, 3].map(JobId) {
            assert!(!attention.is_due(&started(job), now));
        }
        assert!(!attention.is_due(&ends(JobId(1)), later(3)));
        assert!(attention.is_due(&ends(JobId(2)), later(25)));
        let stopped = Event::Stopped {
            job: JobId(3),
            title: "Fuse".into(),
        };
        assert!(!attention.is_due(&stopped, later(60)));
    }

    #[test]
    fn title_shows_the_share_of_work_that_takes_a_while() {
        let job = |seconds, fraction| JobView {
            id: JobId(1),
            title: "Fuse".into(),
            task: None,
            report: ProgressReport::default(),
            overview: Overview {
                fraction,
                ..Overview::default()
            },
            elapsed: Duration::from_secs(seconds),
        };
        let title = |job| title_with_progress("plant – OSTRA", &[job]);
        assert_eq!(title(job(9, Some(0.357))), "35 % – plant – OSTRA");
        assert_eq!(title(job(0, Some(0.357))), "plant – OSTRA");
        assert_eq!(title(job(9, None)), "plant – OSTRA");
    }
}
