use std::collections::{BTreeMap, BTreeSet};

use glam::{Vec2, Vec3};

use super::LabelledMesh;
use crate::LabelledCloud;
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// Returns a grid of `cells`² squares over the unit square, raised by `lift`.
///
/// Vertices are labelled by `label`, and the mesh is cut at the borders.
fn sheet(cells: u32, lift: impl Fn(Vec2) -> f32, label: impl Fn(Vec2) -> u16) -> LabelledMesh {
    let places: Vec<Vec2> = (0..=cells)
        .flat_map(|y| (0..=cells).map(move |x| Vec2::new(x as f32, y as f32) / cells as f32))
        .collect();
    let positions = places
        .iter()
        .map(|&place| place.extend(lift(place)))
        .collect();
    let mut vertices = LabelledCloud::from_positions(positions);
    vertices.labels = places.iter().map(|&place| LabelId(label(place))).collect();
    vertices.colors = places
        .iter()
        .map(|place| [(place.x * 255.0) as u8, (place.y * 255.0) as u8, 7])
        .collect();
    vertices.confidence = vec![0.75; vertices.len()];
    let mut triangles = Vec::new();
    for y in 0..cells {
        for x in 0..cells {
            let [a, b] = [y * (cells + 1) + x, (y + 1) * (cells + 1) + x];
            triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    LabelledMesh {
        vertices,
        triangles,
    }
    .split_at_labels()
}

/// Returns a closed ball of radius 1 whose upper half has label 2 and the rest label 1.
fn ball() -> LabelledMesh {
    const AROUND: u32 = 96;
    const UP: u32 = 48;
    let angle = |at: u32, of: u32, turn: f32| at as f32 / of as f32 * turn;
    let mut positions = vec![-Vec3::Z, Vec3::Z];
    for ring in 1..UP {
        let (height, out) =
            (angle(ring, UP, std::f32::consts::PI) - std::f32::consts::FRAC_PI_2).sin_cos();
        positions.extend((0..AROUND).map(|at| {
            let (sin, cos) = angle(at, AROUND, std::f32::consts::TAU).sin_cos();
            Vec3::new(out * cos, out * sin, height)
        }));
    }
    let at = |ring: u32, step: u32| match ring {
        0 => 0,
        UP => 1,
        _ => 2 + (ring - 1) * AROUND + step % AROUND,
    };
    let mut triangles = Vec::new();
    for ring in 0..UP {
        for step in 0..AROUND {
            let [a, b, c, d] = [
                at(ring, step),
                at(ring, step + 1),
                at(ring + 1, step + 1),
                at(ring + 1, step),
            ];
            triangles.extend(
                [[a, b, c], [a, c, d]]
                    .into_iter()
                    .filter(|[a, b, c]| a != b && b != c && c != a),
            );
        }
    }
    let mut vertices = LabelledCloud::from_positions(positions);
    vertices.labels = vertices
        .positions
        .iter()
        .map(|at| LabelId(1 + u16::from(at.z > 0.01)))
        .collect();
    LabelledMesh {
        vertices,
        triangles,
    }
    .split_at_labels()
}

fn simplified(mesh: &LabelledMesh, share: f64) -> LabelledMesh {
    mesh.simplify(share, &Progress::default()).unwrap()
}

/// Counts the triangles at each edge; vertices are identified by their position.
fn edge_uses(mesh: &LabelledMesh) -> BTreeMap<[[u32; 3]; 2], usize> {
    let mut uses = BTreeMap::new();
    for &[a, b, c] in &mesh.triangles {
        for ends in [[a, b], [b, c], [c, a]] {
            let mut ends = ends.map(|end| {
                mesh.vertices.positions[end as usize]
                    .to_array()
                    .map(|x| (x + 0.0).to_bits())
            });
            ends.sort_unstable();
            *uses.entry(ends).or_default() += 1;
        }
    }
    uses
}

fn area(mesh: &LabelledMesh) -> f32 {
    let cross = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|at| mesh.vertices.positions[at as usize]);
        (b - a).cross(c - a).length() / 2.0
    };
    mesh.triangles.iter().map(cross).sum()
}

#[test]
fn simplified_ball_stays_closed_with_both_labels() {
    let mesh = ball();
    let small = simplified(&mesh, 0.1);
    let target = mesh.triangles.len().div_ceil(10);
    assert!(
        (target - 1..=target).contains(&small.triangles.len()),
        "{} of {target}",
        small.triangles.len()
    );
    assert!(
        edge_uses(&small).values().all(|&uses| uses == 2),
        "closed, across the border of the labels too"
    );
    let label = |at: u32| small.vertices.labels[at as usize];
    assert!(
        small
            .triangles
            .iter()
            .all(|&[a, b, c]| label(a) == label(b) && label(b) == label(c))
    );
    for &[a, b, c] in &small.triangles {
        let [a, b, c] = [a, b, c].map(|at| small.vertices.positions[at as usize]);
        let middle = (a + b + c) / 3.0;
        assert!(
            (middle.length() - 1.0).abs() < 0.02,
            "{middle} lies {} from the middle",
            middle.length()
        );
        assert!(
            (b - a).cross(c - a).dot(middle) > 0.0,
            "no triangle is turned"
        );
    }
    let worst = small
        .vertices
        .positions
        .iter()
        .map(|at| (at.length() - 1.0).abs())
        .fold(0.0, f32::max);
    assert!(worst < 0.01, "{worst}");
    let halves = small.by_label();
    let height = |id: u16| {
        halves[&LabelId(id)]
            .vertices
            .positions
            .iter()
            .map(|at| at.z)
    };
    assert!(
        height(2).all(|z| z > 0.0) && height(1).all(|z| z < 0.07),
        "the border has kept its course"
    );
    assert!(
        small
            .vertices
            .normals
            .iter()
            .zip(&small.vertices.positions)
            .all(|(normal, at)| normal.dot(*at) > 0.95)
    );
}

#[test]
fn simplified_sheet_keeps_its_outline_and_label_borders() {
    let label = |at: Vec2| 1 + u16::from(at.x > 0.4) + 2 * u16::from(at.y > 0.7);
    let mesh = sheet(40, |_| 0.5, label);
    let small = simplified(&mesh, 0.02);
    assert!(
        small.triangles.len() <= mesh.triangles.len() / 50 + 1,
        "{}",
        small.triangles.len()
    );
    assert!((area(&small) - 1.0).abs() < 1e-5, "{}", area(&small));
    assert!(
        small
            .vertices
            .positions
            .iter()
            .all(|at| (at.z - 0.5).abs() < 1e-6)
    );
    let (before, after) = (mesh.by_label(), small.by_label());
    assert_eq!(
        before.keys().collect::<Vec<_>>(),
        after.keys().collect::<Vec<_>>()
    );
    for (id, part) in &before {
        assert!(
            (area(part) - area(&after[id])).abs() < 0.002,
            "{id:?}: {} {}",
            area(part),
            area(&after[id])
        );
    }
    for corner in [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)] {
        assert!(
            small.vertices.positions.contains(&(corner + 0.5 * Vec3::Z)),
            "{corner}"
        );
    }
}

#[test]
fn colors_follow_the_positions_of_merged_vertices() {
    let small = simplified(
        &sheet(
            32,
            |at| (at.x * 6.0).sin() * 0.2,
            |at| 1 + u16::from(at.y > 0.5),
        ),
        0.2,
    );
    for (at, color) in small.vertices.positions.iter().zip(&small.vertices.colors) {
        let [red, green] = [at.x, at.y].map(|along| along * 255.0);
        assert!(
            (f32::from(color[0]) - red).abs() < 12.0 && (f32::from(color[1]) - green).abs() < 12.0,
            "{at} {color:?}"
        );
        assert_eq!(color[2], 7);
    }
    assert!(
        small
            .vertices
            .confidence
            .iter()
            .all(|&confidence| (confidence - 0.75).abs() < 1e-6)
    );
}

#[test]
fn small_labels_do_not_vanish() {
    let speck = |at: Vec2| {
        if at.distance(Vec2::splat(0.5)) < 0.02 {
            9
        } else {
            1
        }
    };
    let small = simplified(&sheet(30, |_| 0.0, speck), 0.02);
    let labels: BTreeSet<u16> = small.vertices.labels.iter().map(|label| label.0).collect();
    assert_eq!(labels, [1, 9].into());
    assert!((area(&small) - 1.0).abs() < 1e-4);
}

#[test]
fn simplification_is_deterministic_and_full_share_is_identity() {
    let mesh = sheet(20, |at| at.x * at.y, |at| 1 + u16::from(at.x > at.y));
    assert!(simplified(&mesh, 0.3) == simplified(&mesh, 0.3));
    assert!(simplified(&mesh, 1.0) == mesh);
    for share in [0.0, -0.1, 1.1, f64::NAN] {
        assert!(
            mesh.simplify(share, &Progress::default())
                .unwrap_err()
                .to_string()
                .contains("above 0"),
            "{share}"
        );
    }
    let stopped = Progress::default();
    stopped.stop();
    assert!(sheet(60, |_| 0.0, |_| 1).simplify(0.1, &stopped).is_err());
}
