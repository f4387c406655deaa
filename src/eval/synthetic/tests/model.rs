use glam::{DVec3, Vec3};

use super::super::bricks::build_bricks;
use super::super::tiller::build_tiller;
use super::*;
use crate::synthetic::model::{Assembly, ScenePart};

fn parts<'a>(assembly: &'a Assembly, ending: &str) -> Vec<&'a ScenePart> {
    let named = |part: &&ScenePart| {
        assembly
            .tree
            .get(part.label)
            .is_some_and(|label| label.name.ends_with(ending))
    };
    assembly.parts.iter().filter(named).collect()
}

fn organ_points<'a>(assembly: &'a Assembly) -> impl Iterator<Item = DVec3> + 'a {
    let organs = assembly
        .parts
        .iter()
        .filter(|part| part.label != LabelId::NONE);
    organs.flat_map(|part| part.mesh.positions.iter().copied())
}

/// Returns the lengths of the rows of a patch with `columns` cells per row.
fn row_lengths(part: &ScenePart, columns: usize) -> Vec<f64> {
    let rows = part.mesh.positions.chunks(columns + 1);
    rows.map(|row| row.windows(2).map(|pair| pair[0].distance(pair[1])).sum())
        .collect()
}

#[test]
fn plant_has_the_documented_dimensions() {
    for seed in 1..=6 {
        let assembly = build_tiller(seed);
        let (low, high) =
            organ_points(&assembly).fold((f64::MAX, 0.0_f64), |(l, h), x| (l.min(x.z), h.max(x.z)));
        assert!((high - 0.6).abs() < 1e-4 && low > -1e-3, "{low} {high}");
        let stems: Vec<&ScenePart> = ["stem 1", "stem 2", "stem 3"]
            .iter()
            .flat_map(|name| parts(&assembly, name))
            .collect();
        assert_eq!(stems.len(), 3);
        for stem in stems {
            // Rows have 24 corners and the seam; the last two rows are the cap.
            let rows: Vec<&[DVec3]> = stem.mesh.positions.chunks(25).collect();
            for row in &rows[..rows.len() - 2] {
                let diameter = row[0].distance(row[12]);
                assert!((0.004..=0.006).contains(&diameter), "{diameter}");
            }
        }
        let blades = parts(&assembly, "blade");
        assert_eq!(blades.len(), 8);
        for blade in blades {
            let widest = row_lengths(blade, 10).into_iter().fold(0.0, f64::max);
            assert!((0.008..=0.015).contains(&widest), "{widest}");
        }
    }
}

#[test]
fn sheaths_wrap_around_their_culm() {
    let assembly = build_tiller(4);
    let stems: Vec<&ScenePart> = ["stem 1", "stem 2", "stem 3"]
        .iter()
        .flat_map(|name| parts(&assembly, name))
        .collect();
    let sheaths = parts(&assembly, "sheath");
    assert_eq!(sheaths.len(), 8);
    for sheath in sheaths {
        for row in sheath.mesh.positions.chunks(31).skip(2) {
            let centre = row[..30].iter().sum::<DVec3>() / 30.0;
            let near = stems
                .iter()
                .flat_map(|stem| &stem.mesh.positions)
                .map(|x| x.distance(centre));
            assert!(near.fold(f64::MAX, f64::min) < 0.0035, "no culm inside");
            let turn: f64 = row
                .windows(2)
                .map(|p| (p[0] - centre).angle_between(p[1] - centre))
                .sum();
            assert!(turn > std::f64::consts::TAU, "{turn}");
            assert!(row.iter().all(|x| x.distance(centre) < 0.006));
        }
    }
}

/// A grain as a spheroid; the first and last vertices of its mesh are its ends.
struct Spheroid {
    centre: DVec3,
    axis: DVec3,
}

const HALF: [f64; 2] = [0.0035, 0.0015];

impl Spheroid {
    fn of(grain: &ScenePart) -> Self {
        let points = &grain.mesh.positions;
        let (tail, head) = (points[0], points[points.len() - 1]);
        Self {
            centre: 0.5 * (tail + head),
            axis: (head - tail).normalize(),
        }
    }

    /// Returns the point of the solid spheroid that is nearest to `x`.
    ///
    /// Along and across the axis it is `half² offset / (half² + t)`, with `t` found by bisection.
    fn nearest(&self, x: DVec3) -> DVec3 {
        let offset = x - self.centre;
        let along = offset.dot(self.axis);
        let across = offset - along * self.axis;
        let lengths = [along, across.length()];
        let outside = |t: f64| {
            let shares = lengths
                .iter()
                .zip(HALF)
                .map(|(length, half)| (half * length / (half * half + t)).powi(2));
            shares.sum::<f64>() > 1.0
        };
        if !outside(0.0) {
            return x;
        }
        let (mut low, mut high) = (0.0, HALF[0] * (offset.length() + HALF[0]));
        for _ in 0..60 {
            let t = 0.5 * (low + high);
            if outside(t) { low = t } else { high = t }
        }
        let scale = |half: f64| half * half / (half * half + low);
        self.centre + scale(HALF[0]) * along * self.axis + scale(HALF[1]) * across
    }

    /// Returns the distance between two convex bodies by alternating projection.
    ///
    /// Source: Cheney, Goldstein, "Proximity maps for convex sets", 1959.
    fn distance(&self, other: &Self) -> f64 {
        let mut x = 0.5 * (self.centre + other.centre);
        for _ in 0..400 {
            x = self.nearest(other.nearest(x));
        }
        x.distance(other.nearest(x))
    }
}

#[test]
fn spheroid_distance_matches_known_gaps() {
    let at = |centre: DVec3, axis: DVec3| Spheroid { centre, axis };
    let gap = |a: &Spheroid, b: &Spheroid| a.distance(b);
    assert!(
        (gap(&at(DVec3::ZERO, DVec3::Z), &at(0.009 * DVec3::Z, DVec3::Z)) - 0.002).abs() < 1e-6
    );
    assert!(
        (gap(&at(DVec3::ZERO, DVec3::Z), &at(0.006 * DVec3::X, DVec3::Y)) - 0.003).abs() < 1e-6
    );
    assert!(gap(&at(DVec3::ZERO, DVec3::Z), &at(0.0025 * DVec3::X, DVec3::Y)) < 1e-5);
}

#[test]
fn grains_keep_the_minimum_gap() {
    for seed in 1..=6 {
        let assembly = build_tiller(seed);
        let grains = parts(&assembly, "panicle grains");
        assert!(grains.len() >= 60, "{}", grains.len());
        let spheroids: Vec<Spheroid> = grains.iter().map(|grain| Spheroid::of(grain)).collect();
        for (grain, spheroid) in grains.iter().zip(&spheroids) {
            // All vertices are on the spheroid, so the surface is inside it.
            for x in &grain.mesh.positions {
                let along = (*x - spheroid.centre).dot(spheroid.axis) / HALF[0];
                let across = (*x - spheroid.centre)
                    .reject_from_normalized(spheroid.axis)
                    .length()
                    / HALF[1];
                assert!((along.hypot(across) - 1.0).abs() < 1e-6, "{along} {across}");
            }
        }
        for (k, spheroid) in spheroids.iter().enumerate() {
            for other in spheroids[..k]
                .iter()
                .filter(|other| other.centre.distance(spheroid.centre) < 0.0085)
            {
                let gap = spheroid.distance(other);
                assert!(gap >= 0.001, "seed {seed}: {gap}");
            }
        }
    }
}

#[test]
fn plant_fills_the_height_of_every_view() {
    for seed in 1..=3 {
        let scene = built(&SceneOptions {
            views: 5,
            seed,
            ..SceneOptions::default()
        });
        for view in scene.views() {
            let mask = scene.render(view).mask;
            let has_label =
                |&row: &u32| (0..mask.width).any(|column| mask.at(column, row) != LabelId::NONE);
            let rows: Vec<u32> = (0..mask.height).filter(has_label).collect();
            let span = rows[rows.len() - 1] - rows[0];
            assert!(span > mask.height * 80 / 100, "{span}");
            assert!(rows[0] > 0, "the plant is cut off at the top");
        }
    }
}

#[test]
fn path_goes_along_its_rows_to_and_fro() {
    let scene = built(&SceneOptions {
        views: 6,
        rows: 2,
        ..small(1)
    });
    let centres: Vec<_> = scene
        .views()
        .iter()
        .map(|view| view.camera_from_world.centre())
        .collect();
    assert!(centres[0].x < centres[1].x && centres[1].x < centres[2].x);
    assert!(centres[3].x > centres[4].x && centres[4].x > centres[5].x);
    // The next row begins above the end of the row before.
    assert!((centres[3].x - centres[2].x).abs() < 0.01);
    assert!(centres[3].z > centres[2].z + 0.01);
    assert!(centres.iter().all(|centre| {
        let middle = glam::DVec3::new(0.0, 0.0, 0.303);
        (centre.distance(middle) - scene.options().distance_m).abs() < 1e-9
    }));
}

#[test]
fn rows_of_cameras_of_their_own_all_go_the_same_way() {
    let scene = built(&SceneOptions {
        views: 6,
        rows: 2,
        row_step_deg: 25.0,
        path: ViewPath::CameraPerRow,
        ..small(1)
    });
    let names: Vec<&str> = scene.views().iter().map(|view| &*view.name).collect();
    assert_eq!(names, ["a000", "a001", "a002", "b000", "b001", "b002"]);
    let middle = glam::DVec3::new(0.0, 0.0, 0.303);
    let away = |view: usize| scene.views()[view].camera_from_world.centre() - middle;
    for along in 0..3 {
        let [below, above] = [away(along), away(along + 3)];
        let [azimuth, other] = [below, above].map(|away| away.y.atan2(away.x));
        assert!((azimuth - other).abs() < 1e-9, "{azimuth} and {other}");
        let pitch = |away: glam::DVec3| (away.z / away.length()).asin().to_degrees();
        assert!((pitch(above) - pitch(below) - 25.0).abs() < 1e-9);
    }
}

/// Converts an sRGB colour to CIE 1976 L*a*b* (D65).
fn lab(srgb: Vec3) -> Vec3 {
    let linear = srgb.map(|v| {
        if v <= 0.04045 {
            v / 12.92
        } else {
            ((v + 0.055) / 1.055).powf(2.4)
        }
    });
    let xyz = Vec3::new(
        linear.dot(Vec3::new(0.4124, 0.3576, 0.1805)) / 0.950_47,
        linear.dot(Vec3::new(0.2126, 0.7152, 0.0722)),
        linear.dot(Vec3::new(0.0193, 0.1192, 0.9505)) / 1.088_83,
    );
    let f = xyz.map(|v| {
        if v > 0.008_856 {
            v.cbrt()
        } else {
            7.787 * v + 16.0 / 116.0
        }
    });
    Vec3::new(116.0 * f.y - 16.0, 500.0 * (f.x - f.y), 200.0 * (f.y - f.z))
}

#[test]
fn leaf_and_stem_have_similar_colours() {
    for seed in 1..=4 {
        let scene = built(&small(seed));
        let mut sums = std::collections::BTreeMap::<String, (Vec3, f32)>::new();
        for view in scene.views() {
            let rendered = scene.render(view);
            for (pixel, &id) in rendered.image.pixels.iter().zip(&rendered.mask.ids) {
                let sum = sums.entry(class(scene.tree(), id)).or_default();
                *sum = (
                    sum.0 + Vec3::from(pixel.map(f32::from)) / 255.0,
                    sum.1 + 1.0,
                );
            }
        }
        let mean = |name: &str| lab(sums[name].0 / sums[name].1);
        let difference = mean("leaf").distance(mean("stem"));
        assert!(difference < 12.0, "seed {seed}: ΔE {difference}");
        assert!(mean("panicle").distance(mean("leaf")) > 5.0);
    }
}

#[test]
fn scene_is_determined_by_the_seed() {
    let seen = |seed| {
        let scene = built(&small(seed));
        let cloud = scene.cloud(
            &TruthOptions {
                spacing_m: 0.003,
                ..TruthOptions::default()
            },
            &Progress::default(),
        );
        (
            scene.render(&scene.views[0]),
            scene.traits().to_vec(),
            cloud.unwrap(),
        )
    };
    let (first, again, other) = (seen(1), seen(1), seen(2));
    assert!(first == again);
    assert_ne!(first.0.mask, other.0.mask);
    assert_ne!(first.0.image, other.0.image);
    assert_ne!(first.1, other.1);
}

#[test]
fn label_trees_have_the_documented_classes() {
    let classes = |scene| {
        let scene = built(&SceneOptions { scene, ..small(1) });
        let at_class = scene
            .tree()
            .iter()
            .filter(|label| scene.tree().depth(label.id) == Scene::CLASS_LEVEL);
        at_class.map(|label| label.name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(classes(SceneKind::Tiller), ["stem", "leaf", "panicle"]);
    assert_eq!(classes(SceneKind::Bricks), ["car", "wheel", "figure"]);
}

#[test]
fn every_brick_label_is_visible_in_two_views() {
    let scene = built(&SceneOptions {
        scene: SceneKind::Bricks,
        ..small(7)
    });
    let (tree, mut seen) = (
        scene.tree(),
        std::collections::BTreeMap::<LabelId, usize>::new(),
    );
    for view in scene.views() {
        let rendered = scene.render(view);
        let shown: std::collections::BTreeSet<LabelId> = rendered
            .mask
            .ids
            .iter()
            .flat_map(|&id| tree.path(id))
            .collect();
        shown
            .into_iter()
            .for_each(|id| *seen.entry(id).or_default() += 1);
        assert!(
            rendered.depth.depths.iter().all(|&depth| depth > 0.0),
            "there is a surface behind every pixel"
        );
    }
    for label in tree.iter() {
        assert!(
            seen.get(&label.id).is_some_and(|&views| views >= 2),
            "{} is hidden",
            label.name
        );
    }
    let wheel = tree.by_name("wheel").unwrap().id;
    assert_eq!(tree.children(Some(wheel)).count(), 6);
    assert_eq!(
        tree.iter().map(|label| tree.depth(label.id)).max(),
        Some(4),
        "class, instance and part"
    );
}

#[test]
fn wheels_rest_on_the_table_and_are_separate() {
    let assembly = build_bricks(3);
    let wheels: Vec<&ScenePart> = (1..=6)
        .flat_map(|k| parts(&assembly, &format!("wheel {k}")))
        .collect();
    assert_eq!(wheels.len(), 6);
    for (k, wheel) in wheels.iter().enumerate() {
        let lowest = wheel
            .mesh
            .positions
            .iter()
            .map(|x| x.z)
            .fold(f64::MAX, f64::min);
        assert!((0.0..1e-3).contains(&(lowest + 1e-9)), "{lowest}");
        for other in &wheels[..k] {
            let gaps = wheel
                .mesh
                .positions
                .iter()
                .flat_map(|a| other.mesh.positions.iter().map(|b| a.distance(*b)));
            assert!(gaps.fold(f64::MAX, f64::min) > 0.02);
        }
    }
}
