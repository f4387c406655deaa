//! Default voxel size and depth tolerance.

use super::*;

#[test]
fn default_voxel_size_is_the_pixel_footprint() {
    let mut scene = Scene::new(3);
    let voxel = |scene: &Scene| scene.fused(&FuseOptions::default()).report.voxel;
    // Most pixels see the wall, about 3 away, at a focal length of 80 pixels.
    assert!((0.03..0.045).contains(&voxel(&scene)), "{}", voxel(&scene));
    // The ball is 1.7 to 2 away.
    for mask in &mut scene.masks {
        let ids = mask
            .as_ref()
            .unwrap()
            .ids
            .iter()
            .map(|&id| if id == BALL { BALL } else { LabelId::NONE })
            .collect();
        *mask = Some(Arc::new(LabelMask {
            width: WIDTH,
            height: HEIGHT,
            ids,
        }));
    }
    assert!((0.021..0.026).contains(&voxel(&scene)), "{}", voxel(&scene));
}

#[test]
fn default_tolerance_follows_the_depth_noise() {
    let mut scene = Scene::new(5);
    let exact = scene.fused(&options()).report.depth_tolerance;
    for (view, depth) in scene.depths.iter_mut().enumerate() {
        // Each frame is off by up to 4 % of the depth in either direction.
        let off = 1.0 + 0.01 * (view as f32 - 2.0) * 2.0;
        let mut map = (**depth.as_ref().unwrap()).clone();
        map.depths.iter_mut().for_each(|depth| *depth *= off);
        *depth = Some(Arc::new(map));
    }
    let rough = scene.fused(&options()).report.depth_tolerance;
    assert!(exact < 0.004 && rough >= 0.015, "{exact} {rough}");
}

/// Depths are off by up to one voxel in either direction, differently in each frame.
#[test]
fn noisy_layers_of_a_surface_are_merged() {
    let exact = Scene::new(24);
    let mut noisy = exact.clone();
    for (view, depth) in noisy.depths.iter_mut().enumerate() {
        let mut map = (**depth.as_ref().unwrap()).clone();
        for (at, depth) in map.depths.iter_mut().enumerate() {
            let step = (at * 7919 + view * 104_729) % 100;
            *depth += 0.03 * (step as f32 / 50.0 - 1.0);
        }
        *depth = Some(Arc::new(map));
    }
    let noisy = noisy.fused(&FuseOptions::default());
    assert!(
        noisy.report.chosen.unwrap().views >= 10.0,
        "{:?}",
        noisy.report
    );
    let exact = exact.fused(&FuseOptions {
        voxel: Some(noisy.report.voxel),
        ..FuseOptions::default()
    });
    let wall = |fused: &Fused| {
        (0..fused.cloud.len())
            .filter(|&point| !is_ball(&fused.cloud, point))
            .count()
    };
    assert!(
        noisy.report.dropped.layers * 4 > wall(&exact),
        "{:?}",
        noisy.report.dropped
    );
    assert!(
        wall(&noisy) * 2 < wall(&exact) * 5,
        "{} points of noise, {} without",
        wall(&noisy),
        wall(&exact)
    );
    let off: f32 = noisy
        .cloud
        .positions
        .iter()
        .filter(|at| at.length() > 0.5)
        .map(|at| (at.z - 1.0).abs())
        .sum();
    assert!(
        off / (wall(&noisy) as f32) < 0.02,
        "{}",
        off / wall(&noisy) as f32
    );
}
