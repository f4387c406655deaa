use glam::{DVec3, Vec2};

use super::dice::Dice;
use super::material::Material;
use super::mesh::Mesh;
use super::noise::fractal_noise;
use super::part::Assembly;
use ostra_masks::LabelId;

/// Height of the pot below the soil's surface, metres.
pub(super) const POT_HEIGHT_M: f64 = 0.10;

/// A clay pot about the vertical axis, filled with soil up to z = 0.
pub(super) fn add_pot(assembly: &mut Assembly, dice: &mut Dice) {
    let wide = dice.range(0.058, 0.064);
    let profile = [
        (0.0, -POT_HEIGHT_M),
        (0.72 * wide, -POT_HEIGHT_M),
        (0.93 * wide, -0.022),
        (wide + 0.003, -0.021),
        (wide + 0.004, 0.004),
        (wide + 0.002, 0.006),
        (wide - 0.002, 0.006),
        (wide - 0.003, 0.004),
        (wide - 0.004, -0.006),
    ];
    let pot = Mesh::lathe(DVec3::ZERO, &profile, 64);
    assembly.add(LabelId::NONE, Material::Clay, dice.texture_seed(), pot);
    let seed = dice.texture_seed();
    assembly.add(
        LabelId::NONE,
        Material::Soil,
        seed,
        soil(wide - 0.0035, seed),
    );
}

/// Soil that rises up to 1.5 mm in crumbs.
fn soil(radius_m: f64, seed: u32) -> Mesh {
    let (rows, columns) = (30, 72);
    Mesh::patch((rows, columns), true, |r, c| {
        let angle = std::f64::consts::TAU * c as f64 / columns as f64;
        let radius = radius_m * (1.0 - r as f64 / rows as f64);
        let at = Vec2::new((radius * angle.cos()) as f32, (radius * angle.sin()) as f32);
        let height = 0.0008 * (1.0 + f64::from(fractal_noise(at * 160.0, 3, seed)));
        (at.as_dvec2().extend(height), at)
    })
}
