//! A project in its own folder, driven through the program as a process.

use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::program::ostra;

/// A project in its own temporary folder.
pub struct Project {
    /// Folder that contains the project.
    pub dir: TempDir,
}

impl Project {
    pub fn new(frames: &Path, more: &[&str]) -> Self {
        let project = Self {
            dir: TempDir::new().unwrap(),
        };
        let root = project.root();
        let args = ["new", &root, "--frames", frames.to_str().unwrap()];
        project.done(&[&args[..], more].concat());
        project
    }

    pub fn root(&self) -> String {
        self.dir.path().join("project").display().to_string()
    }

    /// Runs the program and returns both outputs.
    pub fn done(&self, args: &[&str]) -> String {
        let output = ostra(args);
        let text = format!(
            "{}{}",
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        );
        assert!(output.status.success(), "{args:?}: {text}");
        text
    }

    pub fn info(&self) -> Value {
        // Warnings follow on later lines.
        serde_json::from_str(
            self.done(&["info", &self.root(), "--json"])
                .lines()
                .next()
                .unwrap(),
        )
        .unwrap()
    }
}
