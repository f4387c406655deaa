use glam::{DVec2, DVec3};

use super::*;

/// Returns every `step`-th labelled pixel (column, row) with its world point.
fn labelled_points(
    view: &SyntheticView,
    rendered: &RenderedView,
    step: usize,
) -> Vec<((u32, u32), DVec3)> {
    let width = view.camera.width;
    let labelled = (0..rendered.mask.ids.len()).filter(|&k| rendered.mask.ids[k] != LabelId::NONE);
    let point = |k: usize| {
        let (column, row) = (k as u32 % width, k as u32 / width);
        let ray = view
            .camera
            .unproject(DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5))
            .extend(1.0);
        let x_in_camera = f64::from(rendered.depth.depths[k]) * ray;
        (
            (column, row),
            view.camera_from_world.inverse().transform(x_in_camera),
        )
    };
    labelled.step_by(step).map(point).collect()
}

/// Returns a camera with 3 × 3 pixels whose central pixel is centred on a point.
fn aimed(view: &SyntheticView, x: DVec3) -> SyntheticView {
    let at_px = view
        .camera
        .project(view.camera_from_world.transform(x))
        .unwrap();
    let mut aimed = view.clone();
    (aimed.camera.width, aimed.camera.height) = (3, 3);
    aimed.camera.principal_px += DVec2::splat(1.5) - at_px;
    aimed
}

fn distance_to_triangle(x: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|&(p, q)| normal.dot((q - p).cross(x - p)) >= -1e-12);
    let to_segment = |p: DVec3, q: DVec3| {
        let share = ((x - p).dot(q - p) / (q - p).length_squared().max(1e-30)).clamp(0.0, 1.0);
        x.distance(p.lerp(q, share))
    };
    let edges = to_segment(a, b).min(to_segment(b, c)).min(to_segment(c, a));
    if inside {
        (x - a).dot(normal).abs().min(edges)
    } else {
        edges
    }
}

#[test]
fn rendered_depth_and_label_match_the_surface() {
    let scene = built(&small(3));
    let view = &scene.views[1];
    let rendered = scene.render(view);
    let points = labelled_points(view, &rendered, 37);
    assert!(points.len() > 50);
    for ((column, row), x) in points {
        let nearest = |label: Option<LabelId>| {
            let of_label =
                |&t: &usize| label.is_none_or(|label| scene.model.appearance(t).label == label);
            let corners =
                |t: usize| scene.model.triangles[t].map(|v| scene.model.positions[v as usize]);
            let all = (0..scene.model.triangles.len())
                .filter(of_label)
                .map(|t| distance_to_triangle(x, corners(t)));
            all.fold(f64::MAX, f64::min)
        };
        assert!(
            nearest(Some(rendered.mask.at(column, row))) < 1e-6,
            "at {column}, {row}"
        );
    }
}

#[test]
fn depth_agrees_between_two_views() {
    let scene = built(&small(5));
    let (from, to) = (&scene.views[1], &scene.views[2]);
    let rendered = scene.render(from);
    let points = labelled_points(from, &rendered, 61);
    let mut seen = 0;
    for &(_, x) in &points {
        let other = aimed(to, x);
        let depth = f64::from(scene.render_exact(&other).depth.at(1, 1));
        let expected = to.camera_from_world.transform(x).z;
        assert!(
            depth < expected + 1e-5,
            "the point lies in front of the surface: {depth} {expected}"
        );
        seen += usize::from((depth - expected).abs() < 1e-5);
    }
    assert!(2 * seen > points.len(), "{seen} of {} seen", points.len());
}

#[test]
fn labels_agree_between_views_away_from_borders() {
    let scene = built(&SceneOptions {
        views: 9,
        ..SceneOptions::default()
    });
    let (from, to) = (&scene.views[3], &scene.views[4]);
    let (first, second) = (scene.render(from), scene.render(to));
    let uniform = |mask: &ostra_masks::LabelMask, x: u32, y: u32| {
        let around = (0..9).map(|k| mask.at(x + k % 3 - 1, y + k / 3 - 1));
        around.into_iter().all(|id| id == mask.at(x, y))
    };
    let (mut compared, mut equal) = (0, 0);
    for ((column, row), x) in labelled_points(from, &first, 1) {
        let x_in_camera = to.camera_from_world.transform(x);
        let at_px = to.camera.project(x_in_camera).unwrap();
        let edge = DVec2::new(f64::from(to.camera.width), f64::from(to.camera.height)) - 2.0;
        if at_px.min_element() < 2.0
            || at_px.cmpge(edge).any()
            || column < 2
            || row < 2
            || column > 477
            || row > 637
        {
            continue;
        }
        let (u, v) = (at_px.x as u32, at_px.y as u32);
        let visible = (f64::from(second.depth.at(u, v)) - x_in_camera.z).abs() < 0.002;
        if visible && uniform(&first.mask, column, row) && uniform(&second.mask, u, v) {
            compared += 1;
            equal += usize::from(first.mask.at(column, row) == second.mask.at(u, v));
        }
    }
    assert!(compared > 500, "{compared}");
    assert!(
        f64::from(equal as u32) > 0.99 * f64::from(compared),
        "{equal} of {compared}"
    );
}

#[test]
fn visible_cloud_excludes_hidden_surfaces() {
    let scene = built(&small(2));
    let cloud = |min_views, surroundings_m| {
        let options = TruthOptions {
            spacing_m: 0.002,
            surroundings_m,
            min_views,
        };
        scene.cloud(&options, &Progress::default()).unwrap()
    };
    let (all, seen) = (cloud(0, None), cloud(2, None));
    let count = |cloud: &ostra_cloud::LabelledCloud, name: &str| {
        cloud
            .labels
            .iter()
            .filter(|&&id| class(&cloud.tree, id) == name)
            .count() as f64
    };
    // Half of each culm is inside sheaths, and a sixth faces away from every camera. Blades are
    // visible from both sides.
    assert!(count(&seen, "stem") < 0.55 * count(&all, "stem"));
    assert!(count(&seen, "leaf") > 0.75 * count(&all, "leaf"));
    for (x, normal) in seen.positions.iter().zip(&seen.normals) {
        let towards = |view: &SyntheticView| {
            (view.camera_from_world.centre().as_vec3() - x).dot(*normal) > 0.0
        };
        assert!(scene.views.iter().any(towards));
    }
    let with_wall = cloud(2, Some(0.02));
    assert!(
        with_wall
            .labels
            .iter()
            .filter(|&&id| id == LabelId::NONE)
            .count()
            > 1000
    );
}
