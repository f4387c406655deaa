use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// Number of projects whose shown frame is remembered.
const MOST: usize = 50;

/// Frames that were shown last in projects, the latest project first.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LastFrames(Vec<LastFrame>);

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct LastFrame {
    root: PathBuf,
    frame: usize,
}

impl LastFrames {
    /// Returns the frame that was shown last in a project; the first one if none is known.
    #[must_use]
    pub fn of(&self, root: &Path) -> usize {
        let last = self.0.iter().find(|last| last.root == root);
        last.map_or(0, |last| last.frame)
    }

    /// Remembers the shown frame of a project.
    pub fn note(&mut self, root: &Path, frame: usize) {
        match self.0.first_mut() {
            Some(last) if last.root == root => last.frame = frame,
            _ => {
                self.forget(root);
                self.0.truncate(MOST - 1);
                let root = root.to_owned();
                self.0.insert(0, LastFrame { root, frame });
            }
        }
    }

    /// Forgets the shown frame of a project, because another one takes its place.
    pub fn forget(&mut self, root: &Path) {
        self.0.retain(|last| last.root != root);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_the_latest_projects_are_remembered() {
        let mut frames = LastFrames::default();
        let root = |n: usize| PathBuf::from(format!("/p/{n}"));
        for n in 0..60 {
            frames.note(&root(n), n);
        }
        frames.note(&root(30), 7);
        assert_eq!(frames.of(&root(59)), 59);
        assert_eq!(frames.of(&root(30)), 7);
        assert_eq!(frames.of(&root(5)), 0);
        assert_eq!(frames.0.len(), MOST);
        frames.forget(&root(59));
        assert_eq!(frames.of(&root(59)), 0);
        let text = serde_json::to_string(&frames).unwrap();
        assert_eq!(serde_json::from_str::<LastFrames>(&text).unwrap(), frames);
    }
}
