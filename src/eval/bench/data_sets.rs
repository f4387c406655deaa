use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

/// A public data set as it lies in the folder of data sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StandardSet {
    /// Name on the command line and in reports.
    pub name: &'static str,
    /// Folder of the set.
    pub folder: &'static str,
    /// Subfolder of the images.
    images: &'static str,
    /// Subfolder of the depth maps, for sets that are registered by depth.
    depth: Option<&'static str>,
    /// Subfolder of the true cameras; their intrinsics are given to the programs.
    truth: Option<&'static str>,
    /// Every so many images are used.
    every: usize,
    /// Whether the images follow a path, in the order of their names.
    is_sequence: bool,
}

impl StandardSet {
    /// Photos in no order, with true cameras.
    const fn photos(name: &'static str, folder: &'static str) -> Self {
        Self {
            name,
            folder,
            images: "images",
            depth: None,
            truth: Some("sparse"),
            every: 1,
            is_sequence: false,
        }
    }

    /// A recording of an RGB-D sensor, with true cameras.
    const fn recording(name: &'static str, folder: &'static str) -> Self {
        Self {
            images: "color",
            depth: Some("depth"),
            is_sequence: true,
            ..Self::photos(name, folder)
        }
    }

    const fn without_truth(self) -> Self {
        Self {
            truth: None,
            ..self
        }
    }
}

/// Units of the depth maps of all sets: millimetres.
pub(super) const DEPTH_UNITS_PER_METRE: f64 = 1000.0;

/// The standard sets, those of photos first.
pub const STANDARD_SETS: [StandardSet; 9] = [
    StandardSet::photos("fountain", "strecha_fountain_P11"),
    StandardSet::photos("dtu", "dtu_scan24"),
    StandardSet::photos("temple", "middlebury_templeSparseRing"),
    StandardSet::photos("castle", "sceaux_castle").without_truth(),
    StandardSet::photos("banana", "banana").without_truth(),
    StandardSet {
        is_sequence: true,
        ..StandardSet::photos("plant", "romi_real_plant").without_truth()
    },
    // Colour only, every third frame: a long path whose ends do not meet.
    StandardSet {
        depth: None,
        every: 3,
        ..StandardSet::recording("kitchen", "redkitchen_rgbd_a")
    },
    StandardSet::recording("kitchen-rgbd", "redkitchen_rgbd_a"),
    StandardSet::recording("shelf-rgbd", "apc_shelf_rgbd_labels"),
];

impl StandardSet {
    /// Returns the set in the folder of data sets, or `None` if it is not there.
    #[must_use]
    pub fn find(&self, data: &Path) -> Option<DataSet> {
        let below = |name: &str| data.join(self.folder).join(name);
        let set = DataSet {
            name: self.name.to_owned(),
            images: below(self.images),
            depth: self.depth.map(below),
            truth: self.truth.map(below),
            every: self.every,
            is_sequence: self.is_sequence,
        };
        let parts = [Some(&set.images), set.depth.as_ref(), set.truth.as_ref()];
        let is_whole = parts.into_iter().flatten().all(|part| part.is_dir());
        is_whole.then_some(set)
    }
}

/// Images to reconstruct, with what is known about them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DataSet {
    /// Name in reports.
    pub name: String,
    /// Folder of the images.
    pub images: PathBuf,
    /// Folder of the depth maps; the cameras are then found by depth, and lengths are metres.
    pub depth: Option<PathBuf>,
    /// True cameras, whose intrinsics are given to the programs.
    pub truth: Option<PathBuf>,
    /// Every so many images are used.
    pub every: usize,
    /// Whether the images follow a path, in the order of their names.
    pub is_sequence: bool,
}

impl DataSet {
    /// Returns the names of the images that are used, in order.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be read.
    pub fn image_names(&self) -> Result<Vec<String>> {
        let cannot = || format!("{}: cannot be read", self.images.display());
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&self.images).with_context(cannot)? {
            let entry = entry.with_context(cannot)?;
            if entry.path().is_file() {
                names.push(entry.file_name().to_string_lossy().into_owned());
            }
        }
        names.sort();
        Ok(names.into_iter().step_by(self.every).collect())
    }
}
