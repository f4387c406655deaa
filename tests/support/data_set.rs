//! A data set as frames with cameras, and with depth and ground-truth masks where it has them.

use std::path::Path;
use std::sync::Arc;

use ostra_cloud::SceneError;
use ostra_cloud::fuse::Views;
use ostra_core::job::Progress;
use ostra_frames::cameras::GivenCameras;
use ostra_frames::{DepthMap, Frame, FrameFolder, FrameStore, Image, OpenRequest, open};
use ostra_masks::{LabelMask, read_palette_png};

/// A data set opened through the library, ready for fusion.
pub struct DataSet {
    /// Frames with the cameras of `sparse/`.
    pub frames: Vec<Frame>,
    /// Mask of each frame, if there is one.
    pub masks: Vec<Option<Arc<LabelMask>>>,
    store: FrameStore,
}

impl DataSet {
    /// Opens the images of a data set's folder, with the folders of depth and masks where given.
    ///
    /// Images and depth maps are cached up to `cache_bytes`.
    pub fn open(
        set: &Path,
        images: &str,
        depths: Option<&str>,
        masks: Option<&str>,
        cache_bytes: usize,
    ) -> Self {
        let source = FrameFolder {
            frames: set.join(images),
            depth: depths.map(|folder| set.join(folder)),
        };
        let request = OpenRequest {
            sources: vec![source],
            ..OpenRequest::default()
        };
        let mut frames = open(&request, &Progress::default()).unwrap().frames;
        GivenCameras::read(&set.join("sparse"))
            .unwrap()
            .match_to(&mut frames)
            .unwrap();
        let mask = |frame: &Frame| {
            let path = set
                .join(masks?)
                .join(Path::new(&frame.name).with_extension("png"));
            Some(Arc::new(read_palette_png(&path).unwrap()))
        };
        Self {
            masks: frames.iter().map(mask).collect(),
            frames,
            store: FrameStore::new(cache_bytes),
        }
    }
}

impl Views for DataSet {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn has_depth(&self, index: usize) -> bool {
        self.frames[index].depth.is_some()
    }

    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        Ok(self.store.image(&self.frames[index])?)
    }

    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        Ok(self.store.depth(&self.frames[index])?)
    }

    fn mask(&self, index: usize) -> Option<Arc<LabelMask>> {
        self.masks[index].clone()
    }
}
