//! The images with ground truth that the bench plays.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Image};
use ostra_masks::graph_cut::ranked_click::RankedFrame;
use ostra_masks::{LabelId, LabelMask};

/// An image with ground truth.
pub struct Case {
    pub clip: String,
    image: PathBuf,
    depth: Option<PathBuf>,
    truth: PathBuf,
    /// The only object to play; `None` for all.
    alone: Option<u8>,
    /// Whether the ground truth only distinguishes object and background.
    is_binary: bool,
    /// Maximum number of clicks per object.
    pub clicks: usize,
    /// Whether the simulated user plays it for the report.
    pub is_shown: bool,
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .flatten()
        .map(|entry| entry.path())
        .collect();
    paths.sort();
    paths
}

fn name_of(path: &Path) -> String {
    path.file_stem().unwrap().to_string_lossy().to_string()
}

/// Returns the first, middle, last and every twelfth image of each clip of DAVIS 2016.
pub fn davis(root: &Path) -> Vec<Case> {
    let mut cases = Vec::new();
    for clip in sorted(&root.join("JPEGImages")) {
        let images = sorted(&clip);
        let clip = name_of(&clip);
        let last = images.len() - 1;
        for at in
            (0..images.len()).filter(|at| at % 12 == 0 || *at == last || *at == images.len() / 2)
        {
            cases.push(Case {
                clip: clip.clone(),
                image: images[at].clone(),
                depth: None,
                truth: root
                    .join("Annotations")
                    .join(&clip)
                    .join(format!("{at:05}.png")),
                alone: None,
                is_binary: true,
                clicks: 20,
                is_shown: at == 0 || at == last || at == images.len() / 2,
            });
        }
    }
    cases
}

/// Returns the cases of every folder of images with depth and labels in `root`.
pub fn recordings(root: &Path) -> Vec<Case> {
    sorted(root)
        .iter()
        .flat_map(|folder| recording(folder, &name_of(folder), 1))
        .collect()
}

/// Returns every `every`-th image with depth and labels of one folder.
pub fn recording(root: &Path, clip: &str, every: usize) -> Vec<Case> {
    let mut cases = Vec::new();
    for image in sorted(&root.join("color")).iter().step_by(every) {
        let file = image.file_name().unwrap();
        let truth = root.join("labels").join(file);
        let objects: Vec<Option<u8>> = if clip.contains("alone") {
            values(&truth).into_iter().map(Some).collect()
        } else {
            vec![None]
        };
        cases.extend(objects.into_iter().map(|alone| Case {
            clip: clip.to_owned(),
            image: image.clone(),
            depth: Some(root.join("depth").join(file)),
            truth: truth.clone(),
            alone,
            is_binary: false,
            clicks: if alone.is_some() { 3 } else { 6 },
            is_shown: true,
        }));
    }
    cases
}

/// Returns the objects of at least `LEAST_PX` pixels in the ground truth.
fn values(truth: &Path) -> Vec<u8> {
    const LEAST_PX: usize = 150;
    let mut counts = [0usize; 256];
    image::open(truth)
        .unwrap()
        .to_luma8()
        .pixels()
        .for_each(|pixel| counts[usize::from(pixel.0[0])] += 1);
    (1..=255)
        .filter(|&value| counts[usize::from(value)] >= LEAST_PX)
        .collect()
}

impl Case {
    pub fn has_depth(&self) -> bool {
        self.depth.is_some()
    }

    /// Returns the prepared frame and its ground truth.
    pub fn load(&self) -> (RankedFrame, LabelMask) {
        let image = image::open(&self.image).unwrap().to_rgb8();
        let (width, height) = image.dimensions();
        let image = Arc::new(Image {
            width,
            height,
            pixels: image.pixels().map(|pixel| pixel.0).collect(),
        });
        let depth = self.depth.as_ref().map(|path| {
            let depths = image::open(path)
                .unwrap()
                .to_luma16()
                .pixels()
                .map(|pixel| f32::from(pixel.0[0]) * 1e-3)
                .collect();
            DepthMap {
                width,
                height,
                depths,
            }
        });
        let id = |value: u8| match self.alone {
            Some(object) => u16::from(value == object),
            None if self.is_binary => u16::from(value > 127),
            None => u16::from(value),
        };
        let truth = image::open(&self.truth).unwrap().to_luma8();
        let ids = truth
            .pixels()
            .map(|pixel| LabelId(id(pixel.0[0])))
            .collect();
        (
            RankedFrame::new(&image, depth.as_ref(), &Progress::default()).unwrap(),
            LabelMask { width, height, ids },
        )
    }
}
