//! The default synthetic scene, rendered once for all tests.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use ostra_core::job::Progress;
use ostra_eval::synthetic::{Scene, SceneOptions};

/// The default scene and the folder of its recording, which tests must not change.
pub struct Tiller {
    pub scene: Scene,
    pub recording: PathBuf,
}

impl Tiller {
    /// Copies the ground-truth masks and their labels into `folder`; returns the copies' folder.
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

/// Returns the default scene.
///
/// Cargo's temporary test folder keeps one recording, which the next run replaces.
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
