use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec2;

use super::wall::{BORDER, SIZE, camera, frame, paint, painted, pose, seen_by, sparse};
use crate::stereo::{
    DepthStore, FusionOptions, FusionRequest, InMemoryDepthStore, Stage, StereoEngine,
    StereoOptions, StereoRequest, estimate_depths, fuse_depths, raster_camera, raster_image,
};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameCamera, FrameStore};
use ostra_geometry::{Camera, Distortion};

/// Returns a lens that moves its content in the corners by about 10 pixels.
fn lens(k: f64) -> Camera {
    Camera {
        distortion: Distortion::Radial { k: [k, 0.1 * k] },
        ..camera()
    }
}

/// Returns three images of the wall, rendered through one lens and described by another.
fn frames(folder: &Path, made_by: &Camera, reported: Camera) -> Vec<Frame> {
    let of_view = |view: usize| {
        let frame = frame(
            folder,
            view,
            &painted(made_by, &pose(view), |_, x| paint(x)),
        );
        Frame {
            camera: Some(FrameCamera::given(reported, Some(pose(view)))),
            ..frame
        }
    };
    (0..3).map(of_view).collect()
}

fn depths(frames: &[Frame], store: &FrameStore) -> InMemoryDepthStore {
    let (depths, sparse) = (InMemoryDepthStore::default(), sparse(&[0, 1, 2]));
    let request = StereoRequest {
        frames,
        views: &[0, 1, 2],
        sparse: &sparse,
        mask: &|_, _| None,
        engine: &StereoEngine::Cpu,
    };
    let options = StereoOptions {
        max_side: SIZE.0,
        ..StereoOptions::default()
    };
    estimate_depths(&request, store, &depths, &options, &Progress::default()).unwrap();
    depths
}

/// Returns the share of the first view's pixels, away from the borders, whose depth is right to half a hundredth.
fn share_right(depths: &InMemoryDepthStore) -> f64 {
    let estimate = depths.load(0, Stage::Complete).unwrap().unwrap();
    let (width, height) = (estimate.width(), estimate.height());
    let (mut right, mut all) = (0, 0);
    for (x, y) in
        (BORDER..height - BORDER).flat_map(|y| (BORDER..width - BORDER).map(move |x| (x, y)))
    {
        let (_, truth) = seen_by(
            &estimate.camera,
            &pose(0),
            DVec2::new(x as f64 + 0.5, y as f64 + 0.5),
        );
        all += 1;
        right +=
            usize::from((f64::from(estimate.depths[y * width + x]) / truth - 1.0).abs() < 0.005);
    }
    f64::from(right as u32) / f64::from(all)
}

#[test]
fn depth_is_right_through_a_lens_with_distortion() {
    for k in [-0.3, 0.3] {
        let (folder, store) = (tempfile::tempdir().unwrap(), FrameStore::new(1 << 20));
        let frames = frames(folder.path(), &lens(k), lens(k));
        let depths = depths(&frames, &store);
        let estimate = depths.load(0, Stage::Complete).unwrap().unwrap();
        assert_eq!(estimate.camera, raster_camera(&lens(k), SIZE.0));
        assert_eq!(estimate.camera.distortion, Distortion::None);
        let right = share_right(&depths);
        assert!(right > 0.9, "{k}: {right}");
        // Points lie on the wall, and where the pixels of the original images see it.
        let neighbours = BTreeMap::from([(0, vec![1, 2]), (1, vec![0, 2]), (2, vec![0, 1])]);
        let (options, progress) = (FusionOptions::default(), Progress::default());
        let request = FusionRequest {
            frames: &frames,
            neighbours: &neighbours,
            max_side: SIZE.0,
        };
        let (cloud, _) = fuse_depths(&request, &store, &depths, &options, &progress).unwrap();
        let is_near = |point: usize| {
            cloud.contributors(point).iter().all(|&by| {
                let Some((x, y)) = cloud.frame_pixel(by) else {
                    return true;
                };
                let view = pose(cloud.views[by.view as usize].frame);
                let (place, _) = seen_by(
                    &lens(k),
                    &view,
                    DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5),
                );
                (place - cloud.positions[point].as_dvec3()).length() < 0.05
            })
        };
        let near = (0..cloud.len()).filter(|&point| is_near(point)).count();
        assert!(
            cloud.len() > 5000 && near * 100 >= cloud.len() * 98,
            "{k}: {near} of {}",
            cloud.len()
        );
    }
}

/// The same images, taken for those of a lens without distortion: the test above would fail.
#[test]
fn ignored_distortion_makes_depth_wrong() {
    let (folder, store) = (tempfile::tempdir().unwrap(), FrameStore::new(1 << 20));
    let right = share_right(&depths(
        &frames(folder.path(), &lens(-0.3), camera()),
        &store,
    ));
    assert!(right < 0.6, "{right}");
}

#[test]
fn lens_without_distortion_changes_no_pixel() {
    let (folder, store) = (tempfile::tempdir().unwrap(), FrameStore::new(1 << 20));
    let frames = frames(folder.path(), &camera(), camera());
    let taken = store.image(&frames[0]).unwrap();
    for max_side in [SIZE.0, 4 * SIZE.0] {
        assert_eq!(
            raster_camera(&camera(), max_side),
            camera(),
            "never enlarged"
        );
        assert_eq!(
            raster_image(&frames[0], &camera(), &store, max_side).unwrap(),
            *taken
        );
    }
    let half = raster_camera(&camera(), SIZE.0 / 2);
    assert_eq!((half.width, half.height), (SIZE.0 / 2, SIZE.1 / 2));
    assert_eq!(
        (half.focal_px, half.principal_px),
        (0.5 * camera().focal_px, 0.5 * camera().principal_px)
    );
    let small = raster_image(&frames[0], &camera(), &store, SIZE.0 / 2).unwrap();
    let mean = |x: u32, y: u32| {
        let four =
            [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| taken.at(2 * x + dx, 2 * y + dy)[0]);
        (four.iter().map(|&value| u32::from(value)).sum::<u32>() + 2) / 4
    };
    for (x, y) in [(0, 0), (13, 40), (79, 59)] {
        assert_eq!(u32::from(small.at(x, y)[0]), mean(x, y), "{x} {y}");
    }
}
