use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use glam::Vec2;

use super::arranging::beside_jobs;
use super::{Appearance, Clip, ViewCamera, pick_point};
use ostra_cloud::LabelledCloud;

/// The point seen at a pixel of a view, looked for in the background: large clouds take longer than a picture of the window.
pub struct Picking {
    found: Receiver<Option<usize>>,
}

impl Picking {
    /// Begins to look for what [`pick_point`] gives; `wake` is called when it is known.
    pub fn begin(
        cloud: Arc<LabelledCloud>,
        camera: ViewCamera,
        (at_px, radius_px): (Vec2, f32),
        (appearance, clip): (Appearance, Clip),
        wake: impl FnOnce() + Send + 'static,
    ) -> Self {
        let (sender, found) = channel();
        beside_jobs(move || {
            // An error says that nobody waits any more.
            let _ = sender.send(pick_point(
                &cloud,
                &camera,
                at_px,
                radius_px,
                &appearance,
                &clip,
            ));
            wake();
        });
        Self { found }
    }

    /// The number of the point, or that there is none, once that is known.
    #[must_use]
    pub fn next(&self) -> Option<Option<usize>> {
        match self.found.try_recv() {
            Ok(found) => Some(found),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(None),
        }
    }
}
