use std::path::Path;
use std::sync::Arc;

use tempfile::TempDir;

use crate::synthetic::{RenderedView, Scene, SceneOptions, SyntheticView};
use ostra_frames::{DepthSource, Frame, FrameStore, ImageSource, Orientation};
use ostra_masks::{Direction, LabelId, LabelMask, TrackRequest};

/// A label that the scene does not have.
pub const BALL: LabelId = LabelId(200);
/// Distance of the ball in metres; it is in front of the plant.
const BALL_M: f32 = 0.5;
const BALL_PX: f32 = 24.0;

/// A recording of the synthetic plant; each stem and leaf has a label.
pub struct Made {
    _folder: TempDir,
    scene: Scene,
    pub frames: Vec<Frame>,
    pub truth: Arc<Vec<LabelMask>>,
}

impl Made {
    /// Renders views of a still plant.
    pub fn new(views: usize) -> Self {
        Self::with_ball(views, |_| None)
    }

    /// Renders views with a ball that moves through the images, centred at these pixels.
    pub fn with_ball(views: usize, ball: impl Fn(usize) -> Option<[f32; 2]>) -> Self {
        let options = SceneOptions {
            views,
            width: 360,
            height: 480,
            arc_deg: 50.0,
            ..SceneOptions::default()
        };
        let scene = Scene::build(&options).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let (mut frames, mut truth) = (Vec::new(), Vec::new());
        for (k, view) in scene.views().iter().enumerate() {
            let mut rendered = scene.render(view);
            rendered
                .mask
                .ids
                .iter_mut()
                .for_each(|id| *id = scene.tree().at_level(*id, 3));
            if let Some(middle) = ball(k) {
                throw(&mut rendered, middle);
            }
            frames.push(frame(folder.path(), view, &rendered));
            truth.push(rendered.mask);
        }
        Self {
            _folder: folder,
            scene,
            frames,
            truth: Arc::new(truth),
        }
    }

    /// Returns the label of an organ.
    pub fn label(&self, name: &str) -> LabelId {
        self.scene.tree().by_name(name).unwrap().id
    }

    /// Returns a request with the ground truth masks of these frames as keyframes.
    pub fn request(&self, keyframes: &[usize], direction: Direction) -> TrackRequest {
        TrackRequest {
            frames: Arc::new(self.frames.clone()),
            store: Arc::new(FrameStore::new(64 << 20)),
            keyframes: keyframes
                .iter()
                .map(|&frame| (frame, Arc::new(self.truth[frame].clone())))
                .collect(),
            from: 0,
            to: self.frames.len() - 1,
            direction,
            labels: None,
        }
    }

    /// Returns the IoU of a label on a frame with respect to the ground truth.
    pub fn iou(&self, mask: &LabelMask, frame: usize, label: LabelId) -> f64 {
        mask.region(label).iou(&self.truth[frame].region(label))
    }
}

fn throw(rendered: &mut RenderedView, middle: [f32; 2]) {
    let width = rendered.image.width as usize;
    for at in 0..rendered.mask.ids.len() {
        let (x, y) = ((at % width) as f32, (at / width) as f32);
        if (x - middle[0]).hypot(y - middle[1]) < BALL_PX {
            (rendered.image.pixels[at], rendered.depth.depths[at]) = ([220, 60, 200], BALL_M);
            rendered.mask.ids[at] = BALL;
        }
    }
}

fn frame(folder: &Path, view: &SyntheticView, rendered: &RenderedView) -> Frame {
    let (width, height) = (rendered.image.width, rendered.image.height);
    let [image, depth] =
        ["picture", "depth"].map(|kind| folder.join(format!("{kind}-{}.png", view.name)));
    let colors = rendered.image.pixels.as_flattened().to_vec();
    image::RgbImage::from_raw(width, height, colors)
        .unwrap()
        .save(&image)
        .unwrap();
    let steps = rendered
        .depth
        .depths
        .iter()
        .map(|&depth| (f64::from(depth) / Scene::DEPTH_UNIT_M).round() as u16);
    let steps =
        image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_raw(width, height, steps.collect())
            .unwrap();
    steps.save(&depth).unwrap();
    let orientation = Orientation::default();
    Frame {
        name: view.name.clone(),
        width,
        height,
        image: ImageSource::File {
            path: image,
            orientation,
        },
        depth: Some(DepthSource::Sensor {
            path: depth,
            unit: Scene::DEPTH_UNIT_M,
            orientation,
            camera: None,
        }),
        camera: Some(view.frame_camera()),
    }
}
