use glam::{DVec3, Vec2};

use super::culm::{Blade, BladePlan, Culm, Sheath};
use super::material::Material;
use super::mesh::{Bend, Curve, Mesh};
use super::model::Assembly;
use super::noise::{Dice, fractal_noise};
use super::panicle::Panicle;
use super::posters::add_surroundings;
use ostra_cloud::measure::Dimension::{Angle, Area, Count, Length, Volume};
use ostra_cloud::measure::hull_volume;
use ostra_masks::LabelId;

/// Height of the plant above the soil, in metres.
const PLANT_HEIGHT_M: f64 = 0.6;
/// Number of leaves on each culm; eight in total.
const LEAVES: [usize; 3] = [3, 3, 2];

/// Builds a rice tiller in a pot in front of a wall of posters.
pub(super) fn build_tiller(seed: u64) -> Assembly {
    let mut assembly = Assembly::default();
    let rice = assembly.label("rice", None);
    let [stem, leaf, panicle] =
        ["stem", "leaf", "panicle"].map(|name| assembly.label(name, Some(rice)));
    let plant = full_height_plant(seed);
    let mut textures = Dice::new(seed, 2);
    for (k, shoot) in plant.shoots.iter().enumerate() {
        let id = assembly.label(&format!("stem {}", k + 1), Some(stem));
        let nodes_m = shoot.culm.nodes_m.iter().map(|&node| node as f32).collect();
        assembly.add(
            id,
            Material::Culm { nodes_m },
            textures.texture_seed(),
            shoot.culm.mesh(),
        );
        add_stem_traits(&mut assembly, id, &shoot.culm);
    }
    let leaves = plant
        .shoots
        .iter()
        .flat_map(|shoot| shoot.leaves.iter().map(move |grown| (shoot, grown)));
    for (k, (shoot, grown)) in leaves.enumerate() {
        let id = assembly.label(&format!("leaf {}", k + 1), Some(leaf));
        let [blade, sheath] = ["blade", "sheath"]
            .map(|part| assembly.label(&format!("leaf {} {part}", k + 1), Some(id)));
        let meshes = [grown.blade.mesh(), grown.sheath.mesh(&shoot.culm)];
        let areas_m2 = [meshes[0].area_m2(), meshes[1].area_m2() * Sheath::VISIBLE];
        let labels = LeafLabels {
            leaf: id,
            blade,
            sheath,
        };
        add_leaf_traits(&mut assembly, &labels, shoot, grown, areas_m2);
        let materials = [
            Material::Blade {
                length_m: grown.plan.length_m as f32,
            },
            Material::Sheath,
        ];
        for ((id, mesh), material) in [blade, sheath].into_iter().zip(meshes).zip(materials) {
            assembly.add(id, material, textures.texture_seed(), mesh);
        }
    }
    add_panicle(&mut assembly, panicle, &plant.panicle, &mut textures);
    add_pot(&mut assembly, &mut Dice::new(seed, 3));
    add_surroundings(&mut assembly, -POT_HEIGHT_M, &mut Dice::new(seed, 4));
    assembly
}

fn add_panicle(assembly: &mut Assembly, id: LabelId, panicle: &Panicle, textures: &mut Dice) {
    let [rachis, grains] =
        ["panicle rachis", "panicle grains"].map(|name| assembly.label(name, Some(id)));
    let axes = panicle.axes_mesh();
    let mut all = axes.clone();
    assembly.add(rachis, Material::Rachis, textures.texture_seed(), axes);
    for grain in &panicle.grains {
        let mesh = Panicle::grain_mesh(grain);
        all.append(mesh.clone());
        assembly.add(grains, Material::Grain, textures.texture_seed(), mesh);
    }
    add_panicle_traits(assembly, id, grains, panicle.grains.len(), &all);
}

/// A culm with its leaves.
struct Shoot {
    pub(super) culm: Culm,
    pub(super) leaves: Vec<Leaf>,
}

/// A blade and its sheath.
struct Leaf {
    pub(super) plan: BladePlan,
    pub(super) sheath: Sheath,
    pub(super) blade: Blade,
}

struct Plant {
    shoots: Vec<Shoot>,
    panicle: Panicle,
}

/// Builds a plant whose top is at [`PLANT_HEIGHT_M`] by scaling the length of its culms.
fn full_height_plant(seed: u64) -> Plant {
    let mut stretch = 1.0;
    let mut plant = Plant::grow(seed, stretch);
    for _ in 0..12 {
        let missing = PLANT_HEIGHT_M - plant.top_m();
        if missing.abs() < 1e-5 {
            break;
        }
        stretch *= 1.0 + missing / PLANT_HEIGHT_M;
        plant = Plant::grow(seed, stretch);
    }
    plant
}

impl Plant {
    fn grow(seed: u64, stretch: f64) -> Self {
        let mut dice = Dice::new(seed, 1);
        let turn = dice.range(0.0, std::f64::consts::TAU);
        let shoots: Vec<Shoot> = (0..3)
            .map(|k| Shoot::grow(k, turn, stretch, &mut dice))
            .collect();
        let main = &shoots[0].culm;
        let neck = main.curve.end();
        let azimuth = turn + dice.range(-0.6, 0.6);
        let panicle = Panicle::grow(neck, main.radius(neck.at_m), azimuth, &mut dice);
        Self { shoots, panicle }
    }

    fn top_m(&self) -> f64 {
        let top = |mesh: &Mesh| mesh.positions.iter().map(|x| x.z).fold(0.0, f64::max);
        let leaves = self
            .shoots
            .iter()
            .flat_map(|shoot| &shoot.leaves)
            .map(|leaf| top(&leaf.blade.mesh()));
        let grains = self
            .panicle
            .grains
            .iter()
            .map(|grain| top(&Panicle::grain_mesh(grain)));
        leaves
            .chain(grains)
            .chain([top(&self.panicle.axes_mesh())])
            .fold(0.0, f64::max)
    }
}

impl Shoot {
    /// Creates the `k`-th shoot; the first is the tallest and has the panicle.
    fn grow(k: usize, turn: f64, stretch: f64, dice: &mut Dice) -> Self {
        let azimuth = turn + std::f64::consts::TAU * k as f64 / 3.0 + dice.range(-0.25, 0.25);
        let outward = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let leaning = |degrees: f64| (DVec3::Z + degrees.to_radians().tan() * outward).normalize();
        let (from, to) = (
            leaning(dice.range(4.0, 8.0)),
            leaning(dice.range(-2.0, 2.0)),
        );
        let length = stretch
            * if k == 0 {
                dice.range(0.43, 0.45)
            } else {
                dice.range(0.29, 0.35)
            };
        let side = from.cross(DVec3::Y).normalize();
        let curve = Curve::turning(
            outward * dice.range(0.012, 0.016),
            Bend {
                from,
                to,
                power: 1.0,
            },
            length,
            side,
        );
        let count = LEAVES[k];
        // The main culm is bare above its last leaf, the others only a little.
        let pitch = if k == 0 {
            0.87 * length / count as f64
        } else {
            0.86 * length / (count as f64 - 0.42)
        };
        let nodes_m: Vec<f64> = (0..count)
            .map(|i| 0.08 * length + pitch * (i as f64 + dice.range(-0.05, 0.05)))
            .collect();
        let culm = Culm::new(curve, nodes_m, dice);
        let leaves = (0..count)
            .map(|i| Leaf::grow(&culm, i, pitch, azimuth, dice))
            .collect();
        Self { culm, leaves }
    }
}

impl Leaf {
    /// Creates the `i`-th leaf of a culm; leaves alternate left and right of its outward direction.
    fn grow(culm: &Culm, i: usize, pitch: f64, outward_azimuth: f64, dice: &mut Dice) -> Self {
        let turn = if i.is_multiple_of(2) { 0.75 } else { -0.75 };
        let azimuth = outward_azimuth + turn + dice.range(-0.3, 0.3);
        let from_m = culm.nodes_m[i];
        let to_m = from_m + pitch * dice.range(0.50, 0.58);
        let collar = culm.curve.at(to_m);
        let level = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let sheath = Sheath {
            from_m,
            to_m,
            angle: level.dot(collar.up).atan2(level.dot(collar.side)),
        };
        let plan = BladePlan::draw(dice.range(0.19, 0.25), dice);
        Self {
            plan,
            sheath,
            blade: Blade::grow(plan, &sheath, culm),
        }
    }
}

/// Length of the blade over which the insertion angle is measured (30 mm), in metres.
const INSERTION_REACH_M: f64 = 0.03;

fn add_stem_traits(assembly: &mut Assembly, id: LabelId, culm: &Culm) {
    let length = culm.curve.length_m();
    assembly.record(
        id,
        "length",
        length,
        Length,
        "length of the culm's axis from the soil to its upper end",
    );
    assembly.record(
        id,
        "diameter",
        culm.median_diameter_m(),
        Length,
        "median diameter along the culm's axis",
    );
}

/// The labels of a leaf and its parts.
struct LeafLabels {
    leaf: LabelId,
    blade: LabelId,
    sheath: LabelId,
}

/// Adds the traits of a leaf; `areas_m2` are those of blade and sheath.
fn add_leaf_traits(
    assembly: &mut Assembly,
    labels: &LeafLabels,
    shoot: &Shoot,
    leaf: &Leaf,
    areas_m2: [f64; 2],
) {
    let LeafLabels {
        leaf: id,
        blade,
        sheath,
    } = *labels;
    let [length, sheath_length] = [leaf.plan.length_m, leaf.sheath.length_m()];
    let whole = length + sheath_length;
    assembly.record(
        id,
        "length",
        whole,
        Length,
        "length along sheath and midrib from node to tip",
    );
    let whole = areas_m2[0] + areas_m2[1];
    assembly.record(
        id,
        "area",
        whole,
        Area,
        "one-sided area of blade and sheath, the sheath's overlap counted once",
    );
    let width = leaf.blade.mean_width_m();
    assembly.record(
        blade,
        "length",
        length,
        Length,
        "length along the midrib from collar to tip",
    );
    assembly.record(
        blade,
        "area",
        areas_m2[0],
        Area,
        "one-sided area of the blade",
    );
    assembly.record(
        blade,
        "width",
        width,
        Length,
        "width across the midrib, mean over the length",
    );
    assembly.record(
        blade,
        "width_max",
        leaf.plan.width_m,
        Length,
        "width across the midrib at the widest place",
    );
    let axis = shoot.culm.curve.at(leaf.sheath.to_m).tangent;
    let insertion = leaf.blade.insertion_deg(axis, INSERTION_REACH_M);
    let definition =
        "angle between the culm's axis at the collar and the chord of the midrib's first 30 mm";
    assembly.record(blade, "insertion_angle", insertion, Angle, definition);
    let definition = "length along the culm from node to collar, on the blade's side";
    assembly.record(sheath, "length", sheath_length, Length, definition);
    assembly.record(
        sheath,
        "area",
        areas_m2[1],
        Area,
        "one-sided area of the sheath, its overlap counted once",
    );
}

/// Adds the traits of the panicle; `surface` is its complete mesh.
fn add_panicle_traits(
    assembly: &mut Assembly,
    id: LabelId,
    grains: LabelId,
    count: usize,
    surface: &Mesh,
) {
    let volume = hull_volume(&surface.positions);
    let definition = "volume of the convex hull of rachis, branches and grains";
    assembly.record_whole(id, "hull_volume", volume, Volume, definition);
    assembly.record_whole(grains, "instances", count as f64, Count, "number of grains");
}

/// Height of the pot below the soil surface, in metres.
const POT_HEIGHT_M: f64 = 0.10;

/// Adds a clay pot around the vertical axis, filled with soil up to z = 0.
fn add_pot(assembly: &mut Assembly, dice: &mut Dice) {
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

/// Creates a soil surface with crumbs up to 1.5 mm high.
fn soil(radius_m: f64, seed: u32) -> Mesh {
    let (rows, columns) = (30, 72);
    Mesh::patch(rows, columns, true, |r, c| {
        let angle = std::f64::consts::TAU * c as f64 / columns as f64;
        let radius = radius_m * (1.0 - r as f64 / rows as f64);
        let at = Vec2::new((radius * angle.cos()) as f32, (radius * angle.sin()) as f32);
        let height = 0.0008 * (1.0 + f64::from(fractal_noise(at * 160.0, 3, seed)));
        (at.as_dvec2().extend(height), at)
    })
}
