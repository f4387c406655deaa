use std::path::{Path, PathBuf};

use ostra_core::disk;

/// Recently opened projects, latest first, stored in the system's data folder.
///
/// `XDG_DATA_HOME` is respected.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Recent {
    paths: Vec<PathBuf>,
    file: Option<PathBuf>,
}

/// Maximum number of projects; a longer list would not help the user to choose.
const MOST: usize = 12;

impl Recent {
    /// Reads the list; it is empty if there is none yet or it cannot be read.
    #[must_use]
    pub fn load() -> Self {
        dirs::data_dir().map_or_else(Self::default, |dir| {
            Self::load_from(dir.join("ostra").join("recent.txt"))
        })
    }

    fn load_from(file: PathBuf) -> Self {
        let text = ostra_core::disk::read_text(&file).unwrap_or_default();
        let paths = text
            .lines()
            .filter(|line| !line.is_empty())
            .map(PathBuf::from)
            .take(MOST)
            .collect();
        Self {
            paths,
            file: Some(file),
        }
    }

    /// Returns the projects, latest first.
    #[must_use]
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Moves a project to the top and writes the list.
    ///
    /// A list that cannot be written is not reported, because it is only a convenience.
    pub fn opened(&mut self, path: &Path) {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        self.paths.retain(|other| *other != path);
        self.paths.insert(0, path);
        self.paths.truncate(MOST);
        if let Some(file) = &self.file {
            let lines: Vec<String> = self
                .paths
                .iter()
                .map(|path| path.display().to_string())
                .collect();
            let _ = file.parent().map(std::fs::create_dir_all);
            let _ = disk::write(file, lines.join("\n").as_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latest_project_comes_first_and_is_listed_once() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("ostra").join("recent.txt");
        let mut recent = Recent::load_from(file.clone());
        for path in ["/a", "/b", "/a"] {
            recent.opened(Path::new(path));
        }
        assert_eq!(recent.paths(), [PathBuf::from("/a"), PathBuf::from("/b")]);
        assert_eq!(Recent::load_from(file), recent);
    }
}
