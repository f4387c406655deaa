//! The default synthetic scene, rendered once for all tests.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use ostra_core::job::Progress;
use ostra_eval::synthetic::{Scene, SceneOptions};

/// The default scene and the folder of its recording, which tests only read.
pub struct Tiller {
    pub scene: Scene,
    pub recording: PathBuf,
}

impl Tiller {
    /// Copies the true masks with their labels into `folder`; gives the folder of the copies.
    pub fn true_masks(&self, folder: &Path) -> PathBuf {
        let (truth, masks) = (self.recording.join("truth"), folder.join("masks"));
        std::fs::create_dir(&masks).unwrap();
        std::fs::copy(truth.join("labels.json"), masks.join("labels.json")).unwrap();
        for entry in std::fs::read_dir(truth.join("masks")).unwrap() {
            let entry = entry.unwrap();
            std::fs::copy(entry.path(), masks.join(entry.file_name())).unwrap();
        }
        masks
    }
}

/// The default scene. Cargo's folder for the files of tests keeps one recording, which the next run replaces.
pub fn tiller() -> &'static Tiller {
    static TILLER: OnceLock<Tiller> = OnceLock::new();
    TILLER.get_or_init(|| {
        let recording = Path::new(env!("CARGO_TARGET_TMPDIR")).join("tiller");
        if recording.exists() {
            std::fs::remove_dir_all(&recording).unwrap();
        }
        std::fs::create_dir_all(&recording).unwrap();
        let scene = Scene::build(&SceneOptions::default()).unwrap();
        scene.write(&recording, &Progress::default()).unwrap();
        Tiller { scene, recording }
    })
}
