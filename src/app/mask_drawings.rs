//! Masks drawn small on a worker thread: over thumbnails, and over images during playback.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use egui::{Color32, ColorImage, Context, TextureHandle, TextureOptions};
use ostra_core::job::Loader;
use ostra_masks::{LabelId, LabelTree, RunMask};
use ostra_project::Project;
use ostra_view::{OverlayStyle, overlay};

/// Size at which a mask is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum MaskSize {
    /// During playback.
    Preview,
    /// Over a thumbnail.
    Thumbnail,
}

impl MaskSize {
    /// Returns the maximum side in pixels, like that of the image below the mask.
    fn side_px(self) -> u32 {
        match self {
            Self::Preview => 1280,
            Self::Thumbnail => 160,
        }
    }

    /// Returns the maximum number of drawings kept; all of them together take about 100 MB.
    fn kept(self) -> usize {
        match self {
            Self::Preview => 16,
            Self::Thumbnail => 300,
        }
    }
}

/// Opacity of masks over thumbnails, which are too small for outlines.
const THUMBNAIL_OPACITY: f32 = 0.6;

/// Labels and style that masks of one size are drawn with.
#[derive(Debug, PartialEq)]
struct MaskLook {
    tree: LabelTree,
    style: OverlayStyle,
}

/// A mask to draw.
#[derive(Clone)]
struct MaskRequest {
    size: MaskSize,
    frame: usize,
    runs: Arc<RunMask>,
    /// Labels that are hidden on this frame.
    hidden: BTreeSet<LabelId>,
    look: Arc<MaskLook>,
}

impl PartialEq for MaskRequest {
    /// Masks and looks are compared by identity: a changed one is a new one.
    fn eq(&self, other: &Self) -> bool {
        self.size == other.size
            && self.frame == other.frame
            && Arc::ptr_eq(&self.runs, &other.runs)
            && Arc::ptr_eq(&self.look, &other.look)
            && self.hidden == other.hidden
    }
}

struct MaskDrawing {
    request: MaskRequest,
    image: Arc<ColorImage>,
    texture: Option<TextureHandle>,
    seen: u64,
}

/// Drawn masks by size and frame. The least recently used is dropped first.
#[derive(Default)]
pub(super) struct MaskDrawings {
    loader: Option<Loader<MaskRequest, Arc<ColorImage>>>,
    looks: BTreeMap<MaskSize, Arc<MaskLook>>,
    drawings: BTreeMap<(MaskSize, usize), MaskDrawing>,
    wanted: Vec<MaskRequest>,
    sent: Vec<MaskRequest>,
    clock: u64,
}

impl MaskDrawings {
    /// Sets the labels and the style of the drawings; those over thumbnails have no outlines.
    ///
    /// Call it before masks are requested.
    pub fn set_looks(&mut self, tree: &LabelTree, style: &OverlayStyle) {
        let small = OverlayStyle {
            opacity: THUMBNAIL_OPACITY,
            outlines: false,
            hidden: style.hidden.clone(),
            only: style.only,
        };
        self.set_look(MaskSize::Preview, tree, style);
        self.set_look(MaskSize::Thumbnail, tree, &small);
    }

    /// Takes finished drawings and sends the requests since the last call.
    ///
    /// Call it once per frame of the window, after the requests.
    pub fn turn(&mut self, ctx: &Context) {
        let loader = self.loader.get_or_insert_with(|| {
            let waker = ctx.clone();
            Loader::new("masks", 1, draw, move || waker.request_repaint())
        });
        let finished = loader.take_done();
        let mut wanted = std::mem::take(&mut self.wanted);
        for (request, image) in finished {
            wanted.retain(|other| *other != request);
            self.sent.retain(|other| *other != request);
            self.put(request, image);
        }
        wanted.sort_by_key(|request| request.size);
        if wanted != self.sent {
            self.sent.clone_from(&wanted);
            if let Some(loader) = &self.loader {
                loader.want(wanted);
            }
        }
    }

    fn set_look(&mut self, size: MaskSize, tree: &LabelTree, style: &OverlayStyle) {
        let is_same = self
            .looks
            .get(&size)
            .is_some_and(|look| look.tree == *tree && look.style == *style);
        if !is_same {
            let (tree, style) = (tree.clone(), style.clone());
            self.looks.insert(size, Arc::new(MaskLook { tree, style }));
        }
    }

    /// Requests the drawing of a frame's mask; returns `true` if it is ready or there is none.
    pub fn request(&mut self, project: &Project, size: MaskSize, frame: usize) -> bool {
        let (Some(mask), Some(look)) = (project.masks.get(&frame), self.looks.get(&size)) else {
            return !project.masks.contains_key(&frame);
        };
        let hidden = project
            .marks
            .iter()
            .filter(|(_, marks)| marks.hidden.contains(frame))
            .map(|(&label, _)| label)
            .collect();
        let request = MaskRequest {
            size,
            frame,
            runs: Arc::clone(&mask.runs),
            hidden,
            look: Arc::clone(look),
        };
        self.clock += 1;
        if let Some(drawing) = self.drawings.get_mut(&(size, frame)) {
            drawing.seen = self.clock;
            if drawing.request == request {
                return true;
            }
        }
        if !self.wanted.contains(&request) {
            self.wanted.push(request);
        }
        false
    }

    /// Returns the drawing of a frame's mask, and requests it.
    ///
    /// After a change, the previous drawing is returned until the new one is ready. Of the previews,
    /// only the last one returned is kept on the GPU.
    pub fn texture(
        &mut self,
        ctx: &Context,
        project: &Project,
        size: MaskSize,
        frame: usize,
    ) -> Option<TextureHandle> {
        self.request(project, size, frame);
        if !project.masks.contains_key(&frame) {
            return None;
        }
        if size == MaskSize::Preview {
            let others = self.drawings.range_mut((size, 0)..=(size, usize::MAX));
            for (_, other) in others.filter(|((_, number), _)| *number != frame) {
                other.texture = None;
            }
        }
        let drawing = self.drawings.get_mut(&(size, frame))?;
        let texture = drawing.texture.get_or_insert_with(|| {
            let image = egui::ImageData::Color(Arc::clone(&drawing.image));
            ctx.load_texture("small mask", image, TextureOptions::LINEAR)
        });
        Some(texture.clone())
    }

    fn put(&mut self, request: MaskRequest, image: Arc<ColorImage>) {
        self.clock += 1;
        let (size, frame) = (request.size, request.frame);
        let drawing = MaskDrawing {
            request,
            image,
            texture: None,
            seen: self.clock,
        };
        self.drawings.insert((size, frame), drawing);
        let of_size = || self.drawings.range((size, 0)..=(size, usize::MAX));
        if of_size().count() > size.kept() {
            let oldest = of_size().min_by_key(|(_, drawing)| drawing.seen);
            if let Some(key) = oldest.map(|(&key, _)| key) {
                self.drawings.remove(&key);
            }
        }
    }
}

fn draw(request: &MaskRequest) -> Arc<ColorImage> {
    let mut mask = request.runs.decode_small(request.size.side_px());
    if !request.hidden.is_empty() {
        for id in &mut mask.ids {
            if request.hidden.contains(id) {
                *id = LabelId::NONE;
            }
        }
    }
    let pixels = overlay(&mask, &request.look.tree, &request.look.style);
    let pixels = pixels
        .into_iter()
        .map(|[r, g, b, a]| Color32::from_rgba_unmultiplied(r, g, b, a))
        .collect();
    let size = [mask.width as usize, mask.height as usize];
    Arc::new(ColorImage::new(size, pixels))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use ostra_masks::Label;
    use ostra_project::{FrameMask, Marks, MaskOrigin};

    const LEAF: LabelId = LabelId(1);

    fn project() -> Project {
        let mut project = Project::default();
        project
            .labels
            .set(Label {
                id: LEAF,
                name: "leaf".into(),
                color: [10, 200, 30],
                parent: None,
            })
            .unwrap();
        let runs = RunMask::new(320, 4, vec![(LEAF, 640), (LabelId::NONE, 640)]).unwrap();
        let mask = FrameMask {
            runs: Arc::new(runs),
            origin: MaskOrigin::Keyframe,
            stale: false,
            confidence: BTreeMap::new(),
        };
        project.masks.insert(3, mask);
        project
    }

    /// Turns until the drawing of frame 3 is ready.
    fn drawn(drawings: &mut MaskDrawings, project: &Project) -> Arc<ColorImage> {
        let (ctx, size) = (Context::default(), MaskSize::Thumbnail);
        drawings.set_looks(&project.labels, &OverlayStyle::default());
        for _ in 0..2000 {
            if drawings.request(project, size, 3) {
                return Arc::clone(&drawings.drawings[&(size, 3)].image);
            }
            drawings.turn(&ctx);
            std::thread::park_timeout(Duration::from_millis(5));
        }
        panic!("the mask was not drawn")
    }

    #[test]
    fn changed_mask_colour_and_hidden_range_are_drawn_again() {
        let (mut drawings, mut project) = (MaskDrawings::default(), project());
        assert!(
            drawings.request(&project, MaskSize::Thumbnail, 0),
            "no mask"
        );
        let first = drawn(&mut drawings, &project);
        assert_eq!(first.size, [160, 2]);
        let [r, g, b, a] = first.pixels[0].to_srgba_unmultiplied();
        assert!(r < 14 && g.abs_diff(200) < 4 && b.abs_diff(30) < 4 && a == 153);
        assert_eq!(first.pixels[160], Color32::TRANSPARENT);
        assert!(Arc::ptr_eq(&drawn(&mut drawings, &project), &first));

        let runs = Arc::new(RunMask::empty(320, 4));
        project.masks.get_mut(&3).unwrap().runs = runs;
        let empty = drawn(&mut drawings, &project);
        assert_eq!(empty.pixels[0], Color32::TRANSPARENT);

        let mut hidden = super::tests::project();
        hidden.marks.insert(
            LEAF,
            Marks {
                hidden: vec![(3, 3)].into(),
                ..Marks::default()
            },
        );
        let blank = drawn(&mut drawings, &hidden);
        assert_eq!(blank.pixels[0], Color32::TRANSPARENT);
        hidden.marks.clear();
        assert_ne!(
            drawn(&mut drawings, &hidden).pixels[0],
            Color32::TRANSPARENT
        );
    }

    #[test]
    fn number_of_kept_drawings_is_limited() {
        let (mut drawings, project) = (MaskDrawings::default(), project());
        drawings.set_look(MaskSize::Preview, &project.labels, &OverlayStyle::default());
        let look = Arc::clone(&drawings.looks[&MaskSize::Preview]);
        for frame in 0..40 {
            let request = MaskRequest {
                size: MaskSize::Preview,
                frame,
                runs: Arc::new(RunMask::empty(1, 1)),
                hidden: BTreeSet::new(),
                look: Arc::clone(&look),
            };
            let image = ColorImage::new([1, 1], vec![Color32::TRANSPARENT]);
            drawings.put(request, Arc::new(image));
        }
        assert_eq!(drawings.drawings.len(), 16);
        assert!(drawings.drawings.contains_key(&(MaskSize::Preview, 39)));
    }
}
