use std::collections::{BTreeMap, BTreeSet};

use glam::{DQuat, DVec3, IVec2, IVec3, Vec3};

use super::material::Material;
use super::mesh::Mesh;
use super::model::Assembly;
use super::noise::Dice;
use super::posters::add_surroundings;
use ostra_cloud::measure::{Dimension, hull_volume};
use ostra_masks::LabelId;

const WHEEL_RADIUS_M: f64 = 0.022;
const WHEEL_HALF_WIDTH_M: f64 = 0.008;
/// Height of the car's lowest bricks above the table, in metres.
const CLEARANCE_M: f64 = 0.014;

/// Studs of the car: across and along.
const CAR_STUDS: IVec2 = IVec2::new(4, 10);
/// Studs of the bonnet and of the boot, along the car.
const BONNET_STUDS: i32 = 3;

/// Builds a car and a figure of stacked bricks on a table.
///
/// Four wheels are flush with the car's sides, and two lie apart. The posters behind are those of
/// the tiller scene. The car faces the cameras, so that each of its wheels is visible to some of
/// them.
pub(super) fn build_bricks(seed: u64) -> Assembly {
    let mut dice = Dice::new(seed, 11);
    let mut assembly = Assembly::default();
    let whole = assembly.label("toys", None);
    let [car, wheel, figure] =
        ["car", "wheel", "figure"].map(|name| assembly.label(name, Some(whole)));
    add_car(&mut assembly, car, wheel, &mut dice);
    add_loose_wheels(&mut assembly, wheel, &mut dice);
    add_figure(&mut assembly, figure, &mut dice);
    add_surroundings(&mut assembly, 0.0, &mut Dice::new(seed, 4));
    assembly
}

/// Adds chassis, bonnet, cabin and boot, and a wheel at each corner.
fn add_car(assembly: &mut Assembly, class: LabelId, wheel: LabelId, dice: &mut Dice) {
    let turn = DQuat::from_rotation_z(dice.range(-0.12, 0.12));
    let place = DVec3::new(
        -0.045 + dice.range(-0.006, 0.006),
        dice.range(-0.01, 0.01),
        CLEARANCE_M,
    );
    let [across, along] = CAR_STUDS.to_array();
    let mut toy = Toy::new(place, turn, CAR_STUDS);
    let instance = assembly.label("car 1", Some(class));
    let cabin_end = along - BONNET_STUDS;
    for (name, color, low, high) in [
        ("chassis", [0.78, 0.10, 0.09], [0, 0, 0], [across, along, 1]),
        (
            "bonnet",
            [0.92, 0.72, 0.10],
            [0, 0, 1],
            [across, BONNET_STUDS, 2],
        ),
        (
            "cabin",
            [0.16, 0.36, 0.76],
            [0, BONNET_STUDS, 1],
            [across, cabin_end, 4],
        ),
        (
            "boot",
            [0.30, 0.64, 0.22],
            [0, cabin_end, 1],
            [across, along, 2],
        ),
    ] {
        let id = assembly.label(&format!("car 1 {name}"), Some(instance));
        toy.stack(id, Vec3::from(color), IVec3::from(low), IVec3::from(high));
    }
    toy.build(assembly, dice);
    let side = 0.5 * f64::from(across) * PITCH_M + WHEEL_HALF_WIDTH_M;
    let axle = (0.5 * f64::from(along) - 1.75) * PITCH_M;
    let corners = [(-side, -axle), (side, -axle), (-side, axle), (side, axle)];
    for (k, (x, y)) in corners.into_iter().enumerate() {
        let above_table = WHEEL_RADIUS_M - CLEARANCE_M;
        let part = Wheel {
            number: k + 1,
            centre: place + turn * DVec3::new(x, y, above_table),
            axis: turn * DVec3::X,
        };
        add_wheel(assembly, wheel, &part, dice);
    }
}

/// Adds two wheels that lie flat in front of the toys.
fn add_loose_wheels(assembly: &mut Assembly, class: LabelId, dice: &mut Dice) {
    for (number, x, y) in [(5, -0.145, -0.075), (6, 0.060, -0.115)] {
        let jitter = DVec3::new(dice.range(-0.006, 0.006), dice.range(-0.006, 0.006), 0.0);
        let part = Wheel {
            number,
            centre: DVec3::new(x, y, WHEEL_HALF_WIDTH_M) + jitter,
            axis: DVec3::Z,
        };
        add_wheel(assembly, class, &part, dice);
    }
}

/// A wheel of the car, mounted or loose.
struct Wheel {
    number: usize,
    centre: DVec3,
    /// Unit vector along the axle.
    axis: DVec3,
}

fn add_wheel(assembly: &mut Assembly, class: LabelId, wheel: &Wheel, dice: &mut Dice) {
    let Wheel {
        number,
        centre,
        axis,
    } = *wheel;
    let id = assembly.label(&format!("wheel {number}"), Some(class));
    let mesh = Mesh::cylinder(centre, axis, WHEEL_RADIUS_M, WHEEL_HALF_WIDTH_M, 48);
    record_volume(assembly, id, std::slice::from_ref(&mesh));
    assembly.add(id, Material::Rubber, dice.texture_seed(), mesh);
}

/// Adds legs, torso, arms at the sides and a head.
fn add_figure(assembly: &mut Assembly, class: LabelId, dice: &mut Dice) {
    let turn = DQuat::from_rotation_z(dice.range(-0.15, 0.15));
    let place = DVec3::new(
        0.115 + dice.range(-0.006, 0.006),
        0.045 + dice.range(-0.01, 0.01),
        0.0,
    );
    let mut toy = Toy::new(place, turn, IVec2::new(4, 2));
    let instance = assembly.label("figure 1", Some(class));
    for (name, color, low, high) in [
        ("legs", [0.14, 0.24, 0.62], [1, 0, 0], [3, 2, 3]),
        ("torso", [0.86, 0.36, 0.07], [1, 0, 3], [3, 2, 6]),
        ("right arm", [0.12, 0.52, 0.50], [0, 0, 3], [1, 2, 6]),
        ("left arm", [0.62, 0.16, 0.50], [3, 0, 3], [4, 2, 6]),
        ("head", [0.94, 0.78, 0.24], [1, 0, 6], [3, 2, 8]),
    ] {
        let id = assembly.label(&format!("figure 1 {name}"), Some(instance));
        toy.stack(id, Vec3::from(color), IVec3::from(low), IVec3::from(high));
    }
    toy.build(assembly, dice);
}

/// Distance between studs, in metres.
const PITCH_M: f64 = 0.016;
/// Height of a brick, in metres.
const RISE_M: f64 = 0.0192;
const STUD_RADIUS_M: f64 = 0.0047;
const STUD_HEIGHT_M: f64 = 0.0030;
/// Number of studs along a brick.
const BRICK_STUDS: i32 = 2;

/// A toy of bricks in a grid of studs: x across, y away, z up.
struct Toy {
    /// World position of the corner of cell (0, 0, 0).
    origin: DVec3,
    turn: DQuat,
    bricks: Vec<Brick>,
}

/// A cuboid of cells from `low` (inclusive) to `high` (exclusive).
struct Brick {
    label: LabelId,
    color: Vec3,
    low: IVec3,
    high: IVec3,
}

impl Toy {
    /// Creates a toy whose footprint of `studs` (across, away) is centred on `place`.
    ///
    /// `turn` is a rotation about the vertical.
    pub(super) fn new(place: DVec3, turn: DQuat, studs: IVec2) -> Self {
        let half = DVec3::new(f64::from(studs.x), f64::from(studs.y), 0.0) * 0.5 * PITCH_M;
        Self {
            origin: place - turn * half,
            turn,
            bricks: Vec::new(),
        }
    }

    /// Fills the cells from `low` (inclusive) to `high` (exclusive) with bricks in stretcher bond.
    ///
    /// `color` is sRGB.
    pub(super) fn stack(&mut self, label: LabelId, color: Vec3, low: IVec3, high: IVec3) {
        for z in low.z..high.z {
            let mut y = low.y;
            while y < high.y {
                let first = y == low.y && (high.y - low.y) > BRICK_STUDS && z.rem_euclid(2) == 1;
                let next = (y + if first { BRICK_STUDS / 2 } else { BRICK_STUDS }).min(high.y);
                self.bricks.push(Brick {
                    label,
                    color,
                    low: low.with_y(y).with_z(z),
                    high: high.with_y(next).with_z(z + 1),
                });
                y = next;
            }
        }
    }

    /// Adds all bricks and the exact traits of each label.
    ///
    /// Bricks have studs on cells that no other brick covers.
    pub(super) fn build(self, assembly: &mut Assembly, dice: &mut Dice) {
        let filled: BTreeSet<[i32; 3]> = self
            .bricks
            .iter()
            .flat_map(Brick::cells)
            .map(|cell| cell.to_array())
            .collect();
        let mut meshes: BTreeMap<LabelId, Vec<Mesh>> = BTreeMap::new();
        for brick in &self.bricks {
            let mut mesh = self.cuboid(brick);
            for cell in brick
                .cells()
                .filter(|cell| !filled.contains(&(*cell + IVec3::Z).to_array()))
            {
                mesh.append(self.stud(cell));
            }
            meshes.entry(brick.label).or_default().push(mesh.clone());
            assembly.add(
                brick.label,
                Material::Plastic { color: brick.color },
                dice.texture_seed(),
                mesh,
            );
        }
        for (label, meshes) in meshes {
            record_volume(assembly, label, &meshes);
        }
    }

    fn place(&self, cell: DVec3) -> DVec3 {
        self.origin + self.turn * (cell * DVec3::new(PITCH_M, PITCH_M, RISE_M))
    }

    /// Returns the six flat faces of a brick.
    fn cuboid(&self, brick: &Brick) -> Mesh {
        let (low, high) = (
            self.place(brick.low.as_dvec3()),
            self.place(brick.high.as_dvec3()),
        );
        let size = (brick.high - brick.low).as_dvec3() * DVec3::new(PITCH_M, PITCH_M, RISE_M);
        let axes = [
            self.turn * DVec3::X * size.x,
            self.turn * DVec3::Y * size.y,
            DVec3::Z * size.z,
        ];
        let mut mesh = Mesh::default();
        for k in 0..3 {
            let (u, v) = (axes[(k + 1) % 3], axes[(k + 2) % 3]);
            mesh.append(Mesh::quad(high, -u, -v));
            mesh.append(Mesh::quad(low, v, u));
        }
        mesh
    }

    fn stud(&self, cell: IVec3) -> Mesh {
        let foot = self.place(cell.as_dvec3() + DVec3::new(0.5, 0.5, 1.0));
        Mesh::cylinder(foot, DVec3::Z, STUD_RADIUS_M, STUD_HEIGHT_M, 20)
    }
}

impl Brick {
    fn cells(&self) -> impl Iterator<Item = IVec3> {
        let (low, high) = (self.low, self.high);
        (low.z..high.z).flat_map(move |z| {
            (low.y..high.y).flat_map(move |y| (low.x..high.x).map(move |x| IVec3::new(x, y, z)))
        })
    }
}

/// Records the convex hull volume of a label's surfaces.
fn record_volume(assembly: &mut Assembly, id: LabelId, meshes: &[Mesh]) {
    let all: Vec<DVec3> = meshes
        .iter()
        .flat_map(|mesh| mesh.positions.iter().copied())
        .collect();
    let volume = hull_volume(&all);
    assembly.record(
        id,
        "hull_volume",
        volume,
        Dimension::Volume,
        "volume of the convex hull of the whole surface",
    );
}
