use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use super::link::Link;
use super::scan::Scan;
use ostra_geometry::Pose;

/// Is told poses as they come to be known, by frame number, in the world of the first frame: while odometry goes on, and
/// better ones after it. Called from worker threads.
pub type OnPose<'a> = dyn Fn(usize, &Pose) + Sync + 'a;

/// Poses from one scan to the next while odometry works on many at once: for looking at, not for the result.
pub struct Chain<'a> {
    scans: &'a [Scan],
    on_pose: &'a OnPose<'a>,
    known: Mutex<Known>,
}

#[derive(Default)]
struct Known {
    /// Of the first scans, in order; `None` behind a break.
    poses: Vec<Option<Pose>>,
    /// What is known of scans beyond.
    beyond: BTreeMap<usize, Option<Link>>,
}

impl<'a> Chain<'a> {
    /// A chain that begins at the first scan.
    #[must_use]
    pub fn new(scans: &'a [Scan], on_pose: &'a OnPose<'a>) -> Self {
        Self {
            scans,
            on_pose,
            known: Mutex::default(),
        }
    }

    /// Takes what links a scan to one before it, and tells the poses that are known by that.
    pub fn take(&self, scan: usize, link: Option<&Link>) {
        for (scan, pose) in self
            .known
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .extend(scan, link)
        {
            (self.on_pose)(self.scans[scan].frame, &pose);
        }
    }
}

impl Known {
    /// The poses that become known by a link.
    fn extend(&mut self, scan: usize, link: Option<&Link>) -> Vec<(usize, Pose)> {
        self.beyond.insert(scan, link.copied());
        let mut news = Vec::new();
        if self.poses.is_empty() {
            self.poses.push(Some(Pose::IDENTITY));
            news.push((0, Pose::IDENTITY));
        }
        while let Some(link) = self.beyond.remove(&self.poses.len()) {
            let pose = link.and_then(|link| {
                let source = self.poses[link.scans[0]]?;
                Some(link.aligned.target_from_source.compose(&source))
            });
            news.extend(pose.map(|pose| (self.poses.len(), pose)));
            self.poses.push(pose);
        }
        news
    }
}
