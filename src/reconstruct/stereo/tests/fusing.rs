use std::collections::BTreeMap;

use glam::{DVec2, DVec3, Vec3};

use super::wall::{SIZE, camera, frame, grey, pose, seen};
use crate::stereo::{
    DenseCloud, DepthEstimate, DepthStore, FusionOptions, FusionRequest, InMemoryDepthStore, Stage,
    StereoError, fuse_depths,
};
use ostra_core::job::Progress;
use ostra_frames::FrameStore;

/// Returns the wall as a view sees it.
fn exact(index: usize) -> DepthEstimate {
    let mut estimate = DepthEstimate::empty(camera());
    let normal = (pose(index).rotation * DVec3::new(0.4, -0.3, -1.0).normalize()).as_vec3();
    for at in 0..estimate.depths.len() {
        let at_px = DVec2::new(
            (at % SIZE.0 as usize) as f64 + 0.5,
            (at / SIZE.0 as usize) as f64 + 0.5,
        );
        estimate.depths[at] = seen(&pose(index), at_px).1 as f32;
        estimate.normals[at] = (127.0 * normal).round().to_array().map(|value| value as i8);
        estimate.confidence[at] = 255;
    }
    estimate
}

fn fused(change: impl Fn(usize, &mut DepthEstimate)) -> DenseCloud {
    fused_without(&[], change).unwrap().0
}

/// Returns the cloud if the images of some views are damaged, and the line that names these.
fn fused_without(
    damaged: &[usize],
    change: impl Fn(usize, &mut DepthEstimate),
) -> Result<(DenseCloud, Option<String>), StereoError> {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<_> = (0..2)
        .map(|index| frame(folder.path(), index, &grey(&pose(index))))
        .collect();
    for &index in damaged {
        std::fs::write(frames[index].image.path(), "").unwrap();
    }
    let depths = InMemoryDepthStore::default();
    for index in 0..2 {
        let mut estimate = exact(index);
        change(index, &mut estimate);
        depths.save(index, Stage::Complete, estimate).unwrap();
    }
    let neighbours = BTreeMap::from([(0, vec![1]), (1, vec![0])]);
    let store = FrameStore::new(1 << 20);
    let request = FusionRequest {
        frames: &frames,
        neighbours: &neighbours,
        max_side: 160,
    };
    fuse_depths(
        &request,
        &store,
        &depths,
        &FusionOptions::default(),
        &Progress::default(),
    )
}

fn off_the_wall(position: &Vec3) -> f32 {
    ((position.z - 3.0 - 0.4 * position.x + 0.3 * position.y) / 1.118).abs()
}

#[test]
fn two_views_of_a_wall_fuse_to_one_wall() {
    let cloud = fused(|_, _| ());
    assert!(cloud.len() > 10_000, "{}", cloud.len());
    assert!(
        cloud
            .positions
            .iter()
            .all(|position| off_the_wall(position) < 3e-3)
    );
    assert!((0..cloud.len()).all(|point| cloud.contributors(point).len() == 2));
    let mut pixels: Vec<(u32, u32)> = cloud
        .contributors
        .iter()
        .map(|c| (c.view, c.pixel))
        .collect();
    pixels.sort_unstable();
    pixels.dedup();
    assert_eq!(
        pixels.len(),
        cloud.contributors.len(),
        "a pixel was used twice"
    );
}

#[test]
fn conflicting_depths_create_no_point() {
    let cloud = fused(|index, estimate| {
        if index == 1 {
            estimate.depths.iter_mut().for_each(|depth| *depth *= 1.05);
        }
    });
    assert!(cloud.is_empty(), "{}", cloud.len());
}

#[test]
fn unreadable_view_creates_no_points_and_is_named() {
    let (cloud, warning) = fused_without(&[0], |_, _| ()).unwrap();
    assert!(
        warning
            .as_ref()
            .is_some_and(|line| line.contains("1 frame cannot be read") && line.contains("0.png")),
        "{warning:?}"
    );
    assert!(cloud.len() > 5000, "{}", cloud.len());
    assert!((0..cloud.len()).all(|point| cloud.contributors(point)[0].view == 1));
    let error = fused_without(&[0, 1], |_, _| ()).unwrap_err().to_string();
    assert!(error.contains("0.png"), "{error}");
}
