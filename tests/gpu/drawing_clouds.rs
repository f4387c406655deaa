//! GPU tests of point blocks: culling, coarse images, disc sizes from the local spacing.

use std::sync::Arc;

use glam::Vec3;
use ostra_cloud::LabelledCloud;
use ostra_frames::Image;
use ostra_view::{
    Axes, Bounds, Clip, Orbit, PointsOver, Scene3d, SceneModel, SceneStyle, draw_cloud,
};

use crate::drawing::{View, alike, by_label, drawn, read_back, scene, sphere, step};

/// Returns the number of pixels that are not background.
fn covered<const N: usize>(pixels: &[[u8; N]], style: &SceneStyle) -> usize {
    pixels
        .iter()
        .filter(|pixel| pixel[..3] != style.background)
        .count()
}

fn points_out_of_view_are_culled_and_no_others() {
    let cloud = Arc::new(sphere(1_000_000));
    let mut view = View::new();
    view.set_model(SceneModel::Cloud(Arc::clone(&cloud)));
    let whole = Orbit::framing(
        &Bounds {
            min: Vec3::NEG_ONE,
            max: Vec3::ONE,
        },
        Vec3::new(0.2, 0.3, 1.0),
        Vec3::NEG_Y,
    );
    let axes = Axes::new(Vec3::NEG_Y, Vec3::Z);
    let corner = Clip::inside(
        &axes,
        &axes
            .bounds([Vec3::splat(0.3), Vec3::ONE].into_iter())
            .unwrap(),
    );
    for (what, closer, turned, clip) in [
        ("over the surface", 0.23, 0.4, Clip::default()),
        ("from within", 0.05, 2.0, Clip::default()),
        ("a corner", 1.0, 0.0, corner),
    ] {
        let mut orbit = whole;
        orbit.distance *= closer;
        orbit.turn(turned);
        let style = SceneStyle {
            edl_strength: 0.0,
            clip,
            ..by_label()
        };
        let camera = orbit.camera(256, 192);
        let (gpu, _) = drawn(&mut view, &scene(camera, &style));
        let cpu = draw_cloud(&cloud, &camera, &style).image;
        let same = alike(&gpu, &cpu.pixels, 1);
        assert!(same >= 985, "{what}: {same} of 1000 pixels agree");
        assert!(covered(&cpu.pixels, &style) > 300, "{what}");
        let (count, all) = view.drawn();
        assert!(
            count > 0 && count * 10 < all * 9,
            "{what}: {count} of {all} points are drawn"
        );
    }
}

fn image_has_no_holes_from_the_coarsest_level_on() {
    let cloud = Arc::new(sphere(1_500_000));
    let mut orbit = Orbit::framing(
        &Bounds {
            min: Vec3::NEG_ONE,
            max: Vec3::ONE,
        },
        Vec3::Z,
        Vec3::NEG_Y,
    );
    let style = SceneStyle {
        edl_strength: 0.0,
        point_px: 0.05,
        ..by_label()
    };
    let mut view = View::new();
    view.set_model(SceneModel::Cloud(Arc::clone(&cloud)));
    assert!(
        !view.draw(&scene(orbit.camera(256, 256), &style)),
        "points are arranged first"
    );
    drawn(&mut view, &scene(orbit.camera(256, 256), &style));
    orbit.turn(0.7);
    let turned = scene(orbit.camera(256, 256), &style);
    let cpu = draw_cloud(&cloud, &turned.camera, &style).image;
    let all = covered(&cpu.pixels, &style);
    let (mut calls, mut whole) = (0, false);
    while !whole {
        whole = step(&mut view, &turned);
        calls += 1;
        let gpu = read_back(&view, 256, 256);
        let both = gpu
            .iter()
            .zip(&cpu.pixels)
            .filter(|(g, c)| g[..3] != style.background && **c != style.background);
        let both = both.count();
        assert!(
            both * 1000 >= all * 990,
            "call {calls}: {both} of {all} pixels are covered"
        );
        let beyond = covered(&gpu, &style) - both;
        assert!(
            beyond * 100 <= all * if whole { 1 } else { 5 },
            "call {calls}: {beyond} of {all} pixels too many"
        );
    }
    assert!(
        calls > 2 && view.drawn() == (cloud.len(), cloud.len()),
        "{calls}"
    );
}

fn lone_points_are_equal_on_gpu_and_cpu_and_shade_nothing() {
    let surface = sphere(200_000);
    let mut with_lone = surface.clone();
    let lone = 40;
    for index in 0..lone {
        let (s, c) = (index as f32 * 0.9).sin_cos();
        let reach = 0.02 * index as f32;
        let at = Vec3::new(s * reach, c * reach, -1.6 - 0.05 * index as f32);
        with_lone.append(&LabelledCloud::from_positions(vec![at]));
    }
    let (min, max) = (Vec3::splat(-1.2), Vec3::splat(1.2));
    let orbit = Orbit::framing(&Bounds { min, max }, Vec3::Z, Vec3::NEG_Y);
    let camera = orbit.camera(256, 256);
    let style = SceneStyle {
        edl_strength: 2.0,
        ..by_label()
    };
    let [alone, cpu] = [&surface, &with_lone].map(|cloud| draw_cloud(cloud, &camera, &style).image);
    let different = (alone.pixels.iter().zip(&cpu.pixels)).filter(|(a, b)| a != b);
    let different = different.count();
    assert!(
        different >= lone / 2 && different <= lone * 14,
        "{different} pixels for {lone} points: discs without a rim"
    );
    let mut view = View::new();
    view.set_model(SceneModel::Cloud(Arc::new(with_lone)));
    let (gpu, _) = drawn(&mut view, &scene(camera, &style));
    let same = alike(&gpu, &cpu.pixels, 1);
    assert!(same >= 985, "{same} of 1000 pixels agree");
}

fn points_over_the_model_come_and_go() {
    let (min, max) = (Vec3::NEG_ONE, Vec3::ONE);
    let camera = Orbit::framing(&Bounds { min, max }, Vec3::Z, Vec3::NEG_Y).camera(128, 128);
    let style = SceneStyle {
        point_px: 3.0,
        ..SceneStyle::default()
    };
    let mut view = View::new();
    view.set_model(SceneModel::Cloud(Arc::new(sphere(20_000))));
    let (before, _) = drawn(&mut view, &scene(camera, &style));
    let mut over = LabelledCloud::from_positions(vec![Vec3::new(0.3, 0.2, -1.5), Vec3::Z * 5.0]);
    over.colors = vec![[1, 250, 3]; 2];
    let with_over = Scene3d {
        over: Some(PointsOver(Arc::new(over.clone()))),
        ..scene(camera, &style)
    };
    let (during, _) = drawn(&mut view, &with_over);
    let green = |pixels: &[[u8; 4]]| pixels.iter().filter(|pixel| pixel[1] > 200).count();
    let (px, _) = camera.project(over.positions[0]).unwrap();
    assert_eq!(
        during[px.y as usize * 128 + px.x as usize][..3],
        [1, 250, 3]
    );
    assert!(
        (20..50).contains(&green(&during)),
        "{} for one disc",
        green(&during)
    );
    let (after, _) = drawn(&mut view, &scene(camera, &style));
    assert_eq!((green(&before), green(&after)), (0, 0));
}

/// Returns a wall of width 2 with two densities of points.
///
/// The left half has 300 × 300 points and a round hole of radius 0.05 around (-0.5, 0); the right
/// half has 60 × 60 points.
fn wall() -> LabelledCloud {
    let half = |side: usize, left: f32| {
        (0..side * side).map(move |i| {
            let wobble = |seed: f32| ((i as f32 * seed).sin() * 43_758.547).fract() * 0.4;
            let at = |n: usize, seed: f32| (n as f32 + 0.5 + wobble(seed)) / side as f32;
            Vec3::new(left + at(i % side, 12.9), at(i / side, 78.2) - 0.5, 0.0)
        })
    };
    let dense = half(300, -1.0).filter(|x| x.distance(Vec3::NEG_X * 0.5) > 0.05);
    LabelledCloud::from_positions(dense.chain(half(60, 0.0)).collect())
}

fn dense_and_sparse_parts_have_no_holes_and_no_oversized_discs() {
    let cloud = Arc::new(wall());
    let orbit = Orbit::framing(
        &Bounds {
            min: Vec3::NEG_ONE,
            max: Vec3::ONE,
        },
        Vec3::Z,
        Vec3::NEG_Y,
    );
    let camera = Orbit {
        orthographic: true,
        ..orbit
    }
    .camera(1024, 1024);
    let style = SceneStyle {
        edl_strength: 0.0,
        point_px: 0.05,
        ..SceneStyle::default()
    };
    let cpu = draw_cloud(&cloud, &camera, &style).image;
    let gpu = {
        let mut view = View::new();
        view.set_model(SceneModel::Cloud(Arc::clone(&cloud)));
        let pixels = drawn(&mut view, &scene(camera, &style)).0;
        Image {
            width: 1024,
            height: 1024,
            pixels: pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
        }
    };
    for image in [cpu, gpu] {
        // Returns how many of a thousand pixels around a position show something.
        let share = |x: f32, half: f32| {
            let [from, to] =
                [-half, half].map(|off| camera.project(Vec3::new(x + off, off, 0.0)).unwrap().0);
            let rows = from.y as usize..to.y as usize;
            let pixels = rows
                .flat_map(|y| &image.pixels[y * 1024 + from.x as usize..y * 1024 + to.x as usize]);
            let shown = pixels
                .clone()
                .filter(|pixel| **pixel != style.background)
                .count();
            shown * 1000 / pixels.count()
        };
        assert!(
            share(0.5, 0.4) >= 985,
            "the sparse half is closed: {}",
            share(0.5, 0.4)
        );
        assert!(
            share(-0.2, 0.12) >= 990,
            "the dense half is closed: {}",
            share(-0.2, 0.12)
        );
        assert!(
            share(-0.5, 0.03) <= 10,
            "the hole is open: {}",
            share(-0.5, 0.03)
        );
    }
}

fn old_image_stays_until_the_new_cloud_is_arranged() {
    let camera = Orbit::framing(
        &Bounds {
            min: Vec3::NEG_ONE,
            max: Vec3::ONE,
        },
        Vec3::Z,
        Vec3::NEG_Y,
    )
    .camera(256, 192);
    let style = by_label();
    let mut view = View::new();
    view.set_model(SceneModel::Cloud(Arc::new(sphere(30_000))));
    let (before, _) = drawn(&mut view, &scene(camera, &style));
    for points in [900_000, 800_000] {
        view.set_model(SceneModel::Cloud(Arc::new(sphere(points))));
        view.draw(&scene(camera, &style));
        let now = read_back(&view, 256, 192);
        assert!(
            covered(&now, &style) * 10 >= covered(&before, &style) * 9,
            "no blank image between"
        );
    }
    view.set_model(SceneModel::Cloud(Arc::default()));
    let (nothing, _) = drawn(&mut view, &scene(camera, &style));
    assert_eq!(covered(&nothing, &style), 0);
}

crate::tests! {
    points_out_of_view_are_culled_and_no_others,
    image_has_no_holes_from_the_coarsest_level_on,
    dense_and_sparse_parts_have_no_holes_and_no_oversized_discs,
    lone_points_are_equal_on_gpu_and_cpu_and_shade_nothing,
    points_over_the_model_come_and_go,
    old_image_stays_until_the_new_cloud_is_arranged
}
