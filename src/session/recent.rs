use std::path::{Path, PathBuf};

use ostra_core::disk;

/// Projects opened before, latest first, kept in the system's data folder (`XDG_DATA_HOME` is honoured).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Recent {
    paths: Vec<PathBuf>,
    file: Option<PathBuf>,
}

/// More would be no choice any more.
const MOST: usize = 12;

impl Recent {
    /// Reads the list; empty where there is none yet or it cannot be read.
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

    /// The projects, latest first.
    #[must_use]
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Puts a project at the top and writes the list. A list that cannot be written is no reason to bother anyone.
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
    fn the_latest_comes_first_and_is_there_once() {
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
