use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ostra_core::job::Loader;
use ostra_frames::{FrameStore, Image};
use ostra_project::store::read_frames;

use crate::images::thumbnail;

/// Memory for the decoded first frames, in bytes. Each is reduced to a thumbnail at once.
const PIXEL_BYTES: usize = 16 << 20;

/// What the folder of a recent project holds.
#[derive(Debug, Clone, PartialEq)]
pub enum RecentProject {
    /// The project can be opened.
    Available {
        /// Number of frames.
        frames: usize,
        /// Thumbnail of the first frame; `None` if it has none or it cannot be read.
        thumbnail: Option<Arc<Image>>,
    },
    /// The project cannot be opened, with the reason.
    Unavailable(String),
}

/// The states of recent projects, read on a worker thread and polled without waiting.
pub struct RecentProjects {
    loader: Loader<PathBuf, RecentProject>,
    known: BTreeMap<PathBuf, RecentProject>,
    sent: Vec<PathBuf>,
}

impl RecentProjects {
    /// Creates the states, none of which is known.
    ///
    /// `notify` is called on a worker's thread when one has arrived.
    #[must_use]
    pub fn new(notify: impl Fn() + Send + Sync + 'static) -> Self {
        Self {
            loader: Loader::new("recent projects", 1, |root: &PathBuf| look_at(root), notify),
            known: BTreeMap::new(),
            sent: Vec::new(),
        }
    }

    /// Returns the states that are known.
    #[must_use]
    pub fn known(&self) -> &BTreeMap<PathBuf, RecentProject> {
        &self.known
    }

    /// Requests the states of these projects, as far as they are not known.
    pub fn request(&mut self, roots: &[PathBuf]) {
        self.known.extend(self.loader.take_done());
        let missing = roots.iter().filter(|root| !self.known.contains_key(*root));
        let missing: Vec<PathBuf> = missing.cloned().collect();
        if missing != self.sent {
            self.sent.clone_from(&missing);
            self.loader.want(missing);
        }
    }

    /// Forgets the states, because projects may have changed.
    pub fn clear(&mut self) {
        self.known.clear();
        self.sent.clear();
    }
}

fn look_at(root: &Path) -> RecentProject {
    if !root.exists() {
        return RecentProject::Unavailable("the folder is missing".into());
    }
    if !root.join("project.toml").is_file() {
        return RecentProject::Unavailable("the folder holds no project".into());
    }
    match read_frames(root) {
        Err(error) => RecentProject::Unavailable(format!("{error:#}")),
        Ok(frames) => RecentProject::Available {
            frames: frames.len(),
            thumbnail: frames.first().and_then(|frame| {
                let image = FrameStore::new(PIXEL_BYTES).image(frame).ok()?;
                Some(Arc::new(thumbnail(&image)))
            }),
        },
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;
    use crate::{Command, NewProject, Session};
    use ostra_frames::{FrameFolder, OpenRequest};

    fn project(folder: &Path) -> PathBuf {
        let photos = folder.join("photos");
        std::fs::create_dir(&photos).unwrap();
        for name in ["1.png", "2.png"] {
            let image = image::RgbImage::from_pixel(640, 480, image::Rgb([200, 10, 30]));
            image.save(photos.join(name)).unwrap();
        }
        let root = folder.join("plant");
        let mut session = Session::new();
        let open = OpenRequest {
            sources: vec![FrameFolder::from(photos)],
            ..OpenRequest::default()
        };
        let new = NewProject {
            root: root.clone(),
            open,
            cameras: None,
            intrinsics: None,
        };
        session.act(Command::New(new)).unwrap();
        session.settle(|_| std::ops::ControlFlow::Continue(()));
        root
    }

    #[test]
    fn first_frame_is_shown_and_missing_projects_have_a_reason() {
        let folder = tempfile::tempdir().unwrap();
        let roots = [
            project(folder.path()),
            folder.path().join("gone"),
            folder.path().join("photos"),
        ];
        let (reported, notified) = channel();
        let mut recent = RecentProjects::new(move || reported.send(()).unwrap());
        recent.request(&roots);
        while recent.known().len() < 3 {
            notified.recv_timeout(Duration::from_secs(60)).unwrap();
            recent.request(&roots);
        }
        let known = recent.known();
        let RecentProject::Available {
            frames: 2,
            thumbnail: Some(image),
        } = &known[&roots[0]]
        else {
            panic!("{known:?}");
        };
        assert_eq!(
            (image.width, image.height, image.pixels[0]),
            (160, 120, [200, 10, 30])
        );
        let reason = |root: &PathBuf| match &known[root] {
            RecentProject::Unavailable(reason) => reason.clone(),
            available => panic!("{available:?}"),
        };
        assert_eq!(reason(&roots[1]), "the folder is missing");
        assert_eq!(reason(&roots[2]), "the folder holds no project");
    }
}
