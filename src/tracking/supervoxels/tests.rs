use std::path::Path;
use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};

use super::frame::FrameBodies;
use super::segmenter::GeometrySegmenter;
use super::surfaces::SurfacePartitions;
use super::voxels::ColoredView;
use crate::reprojection::{CalibratedView, DepthView, rays_of};
use ostra_core::job::Progress;
use ostra_frames::{
    DepthMap, DepthSource, Frame, FrameCamera, FrameStore, Image, ImageSource, Orientation,
};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{Click, MaskError, PreparedFrame, Prompt, Region, SegmentRequest, Segmenter};

mod fitting;

const SIZE: (u32, u32) = (160, 120);

/// A segmenter that only sets the clicked pixels.
struct Pixels;

impl PreparedFrame for Pixels {
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        _progress: &Progress,
    ) -> Result<Region, MaskError> {
        let mut region = request
            .previous
            .cloned()
            .unwrap_or_else(|| Region::empty(SIZE.0, SIZE.1));
        for click in &request.prompt.clicks {
            region.inside[click.pixel_in(SIZE.0, SIZE.1).unwrap()] = click.include;
        }
        Ok(region)
    }

    fn bytes(&self) -> usize {
        0
    }
}

impl Segmenter for Pixels {
    fn name(&self) -> &'static str {
        "pixels"
    }

    fn prepare(
        &self,
        _image: &Arc<Image>,
        _depth: Option<&Arc<DepthMap>>,
        _progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        Ok(Arc::new(Self))
    }
}

/// A segmenter that sets every pixel according to the last click.
struct Flood;

impl PreparedFrame for Flood {
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        _progress: &Progress,
    ) -> Result<Region, MaskError> {
        let include = request.prompt.clicks.last().unwrap().include;
        Ok(Region {
            inside: vec![include; (SIZE.0 * SIZE.1) as usize],
            ..Region::empty(SIZE.0, SIZE.1)
        })
    }

    fn bytes(&self) -> usize {
        0
    }
}

/// Returns the first hit of a ray and its depth.
///
/// 0 is nothing, 1 the table, 2 the left box, 3 the right box, 4 a wire.
fn seen(eye: Vec3, ray: Vec3) -> (u8, f32) {
    let boxes = [
        (2, Vec3::new(-0.42, -0.2, 1.0), Vec3::new(-0.16, 0.0, 1.25)),
        (3, Vec3::new(0.16, -0.2, 1.0), Vec3::new(0.42, 0.0, 1.25)),
        (
            4,
            Vec3::new(-0.004, -0.3, 1.0),
            Vec3::new(0.004, 0.0, 1.008),
        ),
    ];
    let table = if ray.y > 0.0 {
        -eye.y / ray.y
    } else {
        f32::INFINITY
    };
    let mut first = (
        1,
        if table * ray.z < 3.0 {
            table
        } else {
            f32::INFINITY
        },
    );
    for (id, low, high) in boxes {
        let (a, b) = ((low - eye) / ray, (high - eye) / ray);
        let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
        if near <= far && near > 0.0 && near < first.1 {
            first = (id, near);
        }
    }
    if first.1.is_finite() { first } else { (0, 0.0) }
}

/// Renders the scene from above the table; `aside` shifts the camera sideways.
fn view(aside: f64) -> (DepthView, Arc<Image>, Vec<u8>) {
    let camera = Camera::pinhole(SIZE.0, SIZE.1, [150.0, 150.0], [80.0, 60.0]);
    let turn = glam::DQuat::from_rotation_x(0.35);
    let centre = DVec3::new(aside, -0.55, 0.0);
    let pose = Pose {
        rotation: turn,
        translation: -(turn * centre),
    };
    let rays = rays_of(&camera);
    let back = turn.inverse().as_quat();
    let hits: Vec<(u8, f32)> = rays
        .iter()
        .map(|ray| seen(centre.as_vec3(), back * ray.extend(1.0)))
        .collect();
    let depth = DepthMap {
        width: SIZE.0,
        height: SIZE.1,
        depths: hits.iter().map(|hit| hit.1).collect(),
    };
    // Everything has one colour, so only geometry distinguishes objects.
    let image = Image {
        width: SIZE.0,
        height: SIZE.1,
        pixels: vec![[128, 128, 128]; hits.len()],
    };
    let posed = CalibratedView {
        camera,
        camera_from_world: pose,
    };
    let ids = hits.iter().map(|hit| hit.0).collect();
    (
        DepthView {
            posed,
            depth: Arc::new(depth),
            rays: Arc::new(rays),
        },
        Arc::new(image),
        ids,
    )
}

/// Writes a view to files.
fn recorded(folder: &Path, number: usize, aside: f64) -> Frame {
    let (view, shown, _) = view(aside);
    let [prepared, depth] = ["c", "d"].map(|kind| folder.join(format!("{kind}{number}.png")));
    let colors = shown.pixels.as_flattened().to_vec();
    image::RgbImage::from_raw(SIZE.0, SIZE.1, colors)
        .unwrap()
        .save(&prepared)
        .unwrap();
    let steps = view
        .depth
        .depths
        .iter()
        .map(|depth| (depth * 1e4).round() as u16)
        .collect();
    let steps =
        image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_raw(SIZE.0, SIZE.1, steps).unwrap();
    steps.save(&depth).unwrap();
    let orientation = Orientation::default();
    Frame {
        name: format!("c{number}.png"),
        width: SIZE.0,
        height: SIZE.1,
        image: ImageSource::File {
            path: prepared,
            orientation,
        },
        depth: Some(DepthSource::Sensor {
            path: depth,
            unit: 1e-4,
            orientation,
            camera: None,
        }),
        camera: Some(FrameCamera::given(
            view.posed.camera,
            Some(view.posed.camera_from_world),
        )),
    }
}

fn frame() -> (FrameBodies, Vec<u8>) {
    frame_over(Arc::new(Pixels))
}

fn frame_over(prepared: Arc<dyn PreparedFrame>) -> (FrameBodies, Vec<u8>) {
    let seen: Vec<_> = [0.0, -0.25, -0.12, 0.12, 0.25].map(view).into();
    let ids = seen[0].2.clone();
    let views: Vec<ColoredView> = seen
        .into_iter()
        .map(|(view, image, _)| ColoredView { view, image })
        .collect();
    let surfaces = Arc::new(SurfacePartitions::of(&views, &Progress::default()).unwrap());
    (
        FrameBodies::new(surfaces, &views, prepared, &Progress::default()).unwrap(),
        ids,
    )
}

fn region_of(ids: &[u8], id: u8) -> Region {
    Region {
        width: SIZE.0,
        height: SIZE.1,
        inside: ids.iter().map(|&of| of == id).collect(),
    }
}

/// Returns a click in the middle of the largest part of a region.
fn click(region: &Region, include: bool) -> Click {
    let (x, y) = ostra_masks::deepest_point(region).unwrap();
    Click {
        at_px: DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5),
        include,
    }
}

fn segment(
    frame: &dyn PreparedFrame,
    clicks: &[Click],
    previous: Option<&Region>,
    taken: Option<&Region>,
) -> Region {
    let prompt = Prompt {
        clicks: clicks.to_vec(),
        ..Prompt::default()
    };
    frame
        .segment(
            &SegmentRequest {
                prompt: &prompt,
                previous,
                taken,
            },
            &Progress::default(),
        )
        .unwrap()
}

#[test]
fn one_click_selects_a_box_without_the_table() {
    let (frame, ids) = frame();
    for id in [2, 3] {
        let truth = region_of(&ids, id);
        let found = segment(&frame, &[click(&truth, true)], None, None);
        assert!(
            found.iou(&truth) > 0.85,
            "thing {id}: {}",
            found.iou(&truth)
        );
    }
}

#[test]
fn unreadable_frames_are_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let asides = [0.0, -0.25, -0.12, 0.12, 0.25, 0.06, -0.18]
        .into_iter()
        .enumerate();
    let frames: Vec<Frame> = asides
        .map(|(number, aside)| recorded(folder.path(), number, aside))
        .collect();
    let (_, image, ids) = view(0.0);
    let truth = region_of(&ids, 2);
    let answer = || {
        let store = Arc::new(FrameStore::new(16 << 20));
        let segmenter = GeometrySegmenter::new(Arc::new(frames.clone()), store, Arc::new(Pixels));
        let prepared = segmenter
            .prepare_frame(&frames[0], &image, None, &Progress::default())
            .unwrap();
        segment(&*prepared, &[click(&truth, true)], None, None)
    };
    for name in ["c5.png", "d6.png"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    let found = answer();
    assert!(
        found.iou(&truth) > 0.8,
        "without two neighbours: {}",
        found.iou(&truth)
    );
    std::fs::write(folder.path().join("d0.png"), "").unwrap();
    assert_eq!(
        answer().area(),
        1,
        "without its own depth the image answers"
    );
}

#[test]
fn later_clicks_add_and_remove_objects() {
    let (frame, ids) = frame();
    let (left, right) = (region_of(&ids, 2), region_of(&ids, 3));
    let mut both = left.clone();
    both.unite(&right);
    let first = click(&left, true);
    let one = segment(&frame, &[first], None, None);
    let two = segment(&frame, &[first, click(&right, true)], Some(&one), None);
    assert!(two.iou(&both) > 0.85, "{}", two.iou(&both));
    let again = segment(
        &frame,
        &[first, click(&right, true), click(&right, false)],
        Some(&two),
        None,
    );
    assert!(again.iou(&left) > 0.8, "{}", again.iou(&left));
}

#[test]
fn other_parts_of_the_previous_mask_are_kept() {
    let (frame, ids) = frame();
    let (left, right) = (region_of(&ids, 2), region_of(&ids, 3));
    let mut before = segment(&frame, &[click(&left, true)], None, None);
    let corner = 5 * SIZE.0 as usize + 5;
    before.inside[corner] = true;
    let after = segment(
        &frame,
        &[click(&left, true), click(&right, true)],
        Some(&before),
        None,
    );
    assert!(after.inside[corner], "painted by hand");
    let taken = region_of(&ids, 2);
    let spared = segment(&frame, &[click(&right, true)], None, Some(&taken));
    assert!(
        spared
            .inside
            .iter()
            .zip(&taken.inside)
            .all(|(inside, taken)| !(inside & taken))
    );
}

#[test]
fn thin_objects_are_left_to_the_image_segmenter() {
    let (frame, ids) = frame();
    let wire = region_of(&ids, 4);
    let at = click(&wire, true);
    let found = segment(&frame, &[at], None, None);
    assert_eq!(found.area(), 1, "the image's own answer");
}

#[test]
fn every_click_is_satisfied() {
    let (frame, ids) = frame();
    let (left, table) = (region_of(&ids, 2), region_of(&ids, 1));
    let mut stray = click(&left, false);
    stray.at_px.x += 6.0;
    for clicks in [
        vec![click(&left, true), stray],
        vec![click(&left, true), click(&table, true), stray],
    ] {
        let found = segment(&frame, &clicks, None, None);
        let holds =
            |click: &Click| found.inside[click.pixel_in(SIZE.0, SIZE.1).unwrap()] == click.include;
        assert!(clicks.iter().all(holds), "{clicks:?}");
    }
}

#[test]
fn image_segmenter_changes_only_pixels_at_contradicted_clicks() {
    let ((bodies, ids), (flooded, _)) = (frame(), frame_over(Arc::new(Flood)));
    let (left, table) = (region_of(&ids, 2), region_of(&ids, 1));
    let mut stray = click(&left, true);
    stray.at_px.x += 6.0;
    let clicks = [
        click(&left, true),
        click(&table, true),
        click(&left, false),
        stray,
    ];
    let [own, answer] = [&bodies, &flooded].map(|frame| segment(frame, &clicks, None, None));
    let is_near = |at: usize| {
        let centre = DVec2::new(
            (at % SIZE.0 as usize) as f64 + 0.5,
            (at / SIZE.0 as usize) as f64 + 0.5,
        );
        clicks
            .iter()
            .any(|click| click.at_px.distance(centre) <= 3.0)
    };
    assert!((0..own.inside.len()).all(|at| own.inside[at] == answer.inside[at] || is_near(at)));
    assert!(own != answer, "the image had a say");
}
