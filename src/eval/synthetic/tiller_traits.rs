use super::culm::Culm;
use super::mesh::Mesh;
use super::part::Assembly;
use super::tiller::{Leaf, Shoot};
use ostra_cloud::measure::Dimension::{Angle, Area, Count, Length, Volume};
use ostra_cloud::measure::hull_volume;
use ostra_masks::LabelId;

/// Insertion angles are taken over the first 30 mm of the blade.
const INSERTION_REACH_M: f64 = 0.03;

pub(super) fn add_stem_traits(assembly: &mut Assembly, id: LabelId, culm: &Culm) {
    let length = culm.curve.length_m();
    assembly.record(
        id,
        "length",
        (length, Length),
        "length of the culm's axis from the soil to its upper end",
    );
    assembly.record(
        id,
        "diameter",
        (culm.median_diameter_m(), Length),
        "median diameter along the culm's axis",
    );
}

/// `ids` and `areas_m2` are those of blade and sheath.
pub(super) fn add_leaf_traits(
    assembly: &mut Assembly,
    (id, ids): (LabelId, [LabelId; 2]),
    (shoot, leaf): (&Shoot, &Leaf),
    areas_m2: [f64; 2],
) {
    let [length, sheath_length] = [leaf.plan.length_m, leaf.sheath.length_m()];
    let whole = length + sheath_length;
    assembly.record(
        id,
        "length",
        (whole, Length),
        "length along sheath and midrib from node to tip",
    );
    let whole = areas_m2[0] + areas_m2[1];
    assembly.record(
        id,
        "area",
        (whole, Area),
        "one-sided area of blade and sheath, the sheath's overlap counted once",
    );
    let [blade, sheath] = ids;
    let width = leaf.blade.mean_width_m();
    assembly.record(
        blade,
        "length",
        (length, Length),
        "length along the midrib from collar to tip",
    );
    assembly.record(
        blade,
        "area",
        (areas_m2[0], Area),
        "one-sided area of the blade",
    );
    assembly.record(
        blade,
        "width",
        (width, Length),
        "width across the midrib, mean over the length",
    );
    assembly.record(
        blade,
        "width_max",
        (leaf.plan.width_m, Length),
        "width across the midrib at the widest place",
    );
    let axis = shoot.culm.curve.at(leaf.sheath.to_m).tangent;
    let insertion = leaf.blade.insertion_deg(axis, INSERTION_REACH_M);
    let definition =
        "angle between the culm's axis at the collar and the chord of the midrib's first 30 mm";
    assembly.record(blade, "insertion_angle", (insertion, Angle), definition);
    let definition = "length along the culm from node to collar, on the blade's side";
    assembly.record(sheath, "length", (sheath_length, Length), definition);
    assembly.record(
        sheath,
        "area",
        (areas_m2[1], Area),
        "one-sided area of the sheath, its overlap counted once",
    );
}

/// `surface`: everything of the panicle.
pub(super) fn add_panicle_traits(
    assembly: &mut Assembly,
    id: LabelId,
    grains: (LabelId, usize),
    surface: &Mesh,
) {
    let volume = hull_volume(&surface.positions);
    let definition = "volume of the convex hull of rachis, branches and grains";
    assembly.record_whole(id, "hull_volume", (volume, Volume), definition);
    assembly.record_whole(
        grains.0,
        "instances",
        (grains.1 as f64, Count),
        "number of grains",
    );
}
