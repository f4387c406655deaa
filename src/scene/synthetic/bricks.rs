use glam::{DQuat, DVec3, Vec2, Vec3};

use super::bitmap::Bitmap;
use super::dice::Dice;
use super::material::Material;
use super::mesh::Mesh;
use super::noise::fractal_noise;
use super::part::Assembly;
use super::posters::add_surroundings;
use crate::masks::LabelId;
use crate::scene::measure::{Dimension, hull_volume};

/// Half lengths of a brick, metres.
const BRICK_HALF_M: DVec3 = DVec3::new(0.055, 0.0275, 0.019);
const JOINT_M: f64 = 0.004;
const COURSES: usize = 4;

/// A low wall of bricks with a vase, a ball and a box around it, before the same posters as the tiller.
pub(super) fn build_bricks(seed: u64) -> Assembly {
    let mut dice = Dice::new(seed, 11);
    let mut assembly = Assembly::default();
    let whole = assembly.label("still life", None);
    let classes = ["brick", "vase", "ball", "box"].map(|name| assembly.label(name, Some(whole)));
    add_courses(&mut assembly, classes[0], &mut dice);
    add_vase(&mut assembly, classes[1], &mut dice);
    add_ball(&mut assembly, classes[2], &mut dice);
    add_box(&mut assembly, classes[3], &mut dice);
    add_surroundings(&mut assembly, 0.0, &mut Dice::new(seed, 4));
    assembly
}

/// Bricks in stretcher bond, each a little askew.
fn add_courses(assembly: &mut Assembly, class: LabelId, dice: &mut Dice) {
    let pitch = 2.0 * BRICK_HALF_M.x + JOINT_M;
    let mut count = 0;
    for course in 0..COURSES {
        let bricks = if course.is_multiple_of(2) { 3 } else { 2 };
        for k in 0..bricks {
            count += 1;
            let id = assembly.label(&format!("brick {count}"), Some(class));
            let x = pitch * (f64::from(k) - 0.5 * (f64::from(bricks) - 1.0)) + dice.range(-0.001, 0.001);
            let z = BRICK_HALF_M.z + course as f64 * 2.0 * BRICK_HALF_M.z;
            let turn = DQuat::from_rotation_z(dice.range(-0.05, 0.05));
            let centre = DVec3::new(x, 0.03 + dice.range(-0.003, 0.003), z);
            let mesh = cuboid(centre, turn, BRICK_HALF_M);
            add_traits(assembly, id, &mesh, Some(BRICK_HALF_M));
            assembly.add(id, Material::Brick, dice.texture_seed(), mesh);
        }
    }
}

fn add_vase(assembly: &mut Assembly, id: LabelId, dice: &mut Dice) {
    let (height, belly, neck) = (dice.range(0.13, 0.16), dice.range(0.034, 0.042), dice.range(0.013, 0.018));
    let outline = |t: f64| {
        let bulge = (std::f64::consts::PI * (0.12 + 0.80 * t.powf(0.8))).sin();
        neck + (belly - neck) * bulge.powi(2) + 0.008 * ((t - 0.9) / 0.1).max(0.0)
    };
    let mut profile: Vec<(f64, f64)> = vec![(0.0, 0.0)];
    profile.extend((0..=32).map(|k| f64::from(k) / 32.0).map(|t| (outline(t), t * height)));
    profile.extend((0..=8).map(|k| 1.0 - f64::from(k) / 16.0).map(|t| (outline(t) - 0.002, t * height)));
    profile.push((0.0, 0.5 * height));
    let place = DVec3::new(-0.13 + dice.range(-0.02, 0.02), -0.06 + dice.range(-0.02, 0.02), 0.0);
    let mesh = Mesh::lathe(place, &profile, 56);
    let ground = Vec3::new(dice.range(0.1, 0.3) as f32, dice.range(0.3, 0.5) as f32, dice.range(0.5, 0.75) as f32);
    add_traits(assembly, id, &mesh, None);
    assembly.add(id, Material::Glaze { ground }, dice.texture_seed(), mesh);
}

fn add_ball(assembly: &mut Assembly, id: LabelId, dice: &mut Dice) {
    let radius = dice.range(0.028, 0.034);
    let centre = DVec3::new(0.10 + dice.range(-0.03, 0.03), -0.08 + dice.range(-0.02, 0.02), radius);
    let (rows, columns) = (36, 56);
    let mesh = Mesh::patch((rows, columns), true, |r, c| {
        let latitude = std::f64::consts::PI * (r as f64 / rows as f64 - 0.5);
        let angle = std::f64::consts::TAU * c as f64 / columns as f64;
        let x = DVec3::new(latitude.cos() * angle.cos(), latitude.cos() * angle.sin(), latitude.sin());
        (centre + radius * x, Vec2::new((angle * radius) as f32, (latitude * radius) as f32))
    });
    let ground = Vec3::new(dice.range(0.7, 0.85) as f32, dice.range(0.2, 0.5) as f32, dice.range(0.1, 0.25) as f32);
    add_traits(assembly, id, &mesh, Some(DVec3::splat(radius)));
    assembly.add(id, Material::Glaze { ground }, dice.texture_seed(), mesh);
}

/// A printed box on top of the bricks.
fn add_box(assembly: &mut Assembly, id: LabelId, dice: &mut Dice) {
    let half = DVec3::new(dice.range(0.032, 0.042), dice.range(0.018, 0.025), dice.range(0.040, 0.052));
    let top = COURSES as f64 * 2.0 * BRICK_HALF_M.z;
    let turn = DQuat::from_rotation_z(dice.range(-0.5, 0.5));
    let mesh = cuboid(DVec3::new(dice.range(-0.04, 0.04), 0.03, top + half.z), turn, half);
    let (seed, hue) = (dice.texture_seed(), dice.range(0.0, 0.4) as f32);
    let card = Bitmap::painted(2.0 * Vec2::new(half.x as f32, half.z as f32), |at| {
        let stripe = ((at.x + at.y) / 13.0).fract() < 0.5;
        let ink = if stripe { Vec3::new(0.85, 0.80 - hue, 0.30) } else { Vec3::new(0.25, 0.28, 0.55 + hue) };
        ink * (1.0 + 0.25 * fractal_noise(at / 4.0, 4, seed))
    });
    add_traits(assembly, id, &mesh, Some(half));
    assembly.add(id, Material::Picture { bitmap: assembly.bitmaps.len() }, seed, mesh);
    assembly.bitmaps.push(card);
}

/// A box with six flat faces.
fn cuboid(centre: DVec3, turn: DQuat, half: DVec3) -> Mesh {
    let axes = [turn * DVec3::X * half.x, turn * DVec3::Y * half.y, turn * DVec3::Z * half.z];
    let mut mesh = Mesh::default();
    for k in 0..3 {
        let (out, u, v) = (axes[k], axes[(k + 1) % 3], axes[(k + 2) % 3]);
        mesh.append(Mesh::quad(centre + out - u - v, 2.0 * u, 2.0 * v));
        mesh.append(Mesh::quad(centre - out - u - v, 2.0 * v, 2.0 * u));
    }
    mesh
}

/// Hull volume, and the three sizes where the half axes are known.
fn add_traits(assembly: &mut Assembly, id: LabelId, mesh: &Mesh, half: Option<DVec3>) {
    let volume = (hull_volume(&mesh.positions), Dimension::Volume);
    assembly.record(id, "hull_volume", volume, "volume of the convex hull of the whole surface");
    let mut sizes = half.map_or([0.0; 3], |half| (2.0 * half).to_array());
    sizes.sort_by(|a, b| b.total_cmp(a));
    for (name, size) in ["size_long", "size_middle", "size_short"].into_iter().zip(sizes).filter(|_| half.is_some()) {
        let definition = "extent along one of the body's own axes, longest first";
        assembly.record(id, name, (size, Dimension::Length), definition);
    }
}
