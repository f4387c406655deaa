use std::collections::{BTreeMap, BTreeSet};

use glam::{DQuat, DVec3, IVec3, Vec3};

use super::dice::Dice;
use super::material::Material;
use super::mesh::Mesh;
use super::part::Assembly;
use ostra_cloud::measure::{Dimension, hull_volume};
use ostra_masks::LabelId;

/// Distance of studs, metres.
pub(super) const PITCH_M: f64 = 0.016;
/// Height of a brick, metres.
pub(super) const RISE_M: f64 = 0.0192;
const STUD_RADIUS_M: f64 = 0.0047;
const STUD_HEIGHT_M: f64 = 0.0030;
/// Studs along a brick.
const BRICK_STUDS: i32 = 2;

/// A toy of bricks in a grid of studs: x across, y away, z up.
pub(super) struct Toy {
    /// Corner of cell 0, 0, 0 in the world.
    origin: DVec3,
    turn: DQuat,
    bricks: Vec<Brick>,
}

/// A cuboid of cells from `low` up to, not including, `high`.
struct Brick {
    label: LabelId,
    color: Vec3,
    low: IVec3,
    high: IVec3,
}

impl Toy {
    /// Stands on `place` with the middle of `studs` (across, away), turned about the vertical.
    pub(super) fn new(place: DVec3, turn: DQuat, studs: (i32, i32)) -> Self {
        let half = DVec3::new(f64::from(studs.0), f64::from(studs.1), 0.0) * 0.5 * PITCH_M;
        Self {
            origin: place - turn * half,
            turn,
            bricks: Vec::new(),
        }
    }

    /// Fills cells from `low` up to, not including, `high` with bricks in stretcher bond. sRGB.
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

    /// Adds all bricks, with studs where nothing stands on them, and what each label measures.
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

    /// Six flat faces.
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

/// Records the volume of the hull of a label's surfaces.
pub(super) fn record_volume(assembly: &mut Assembly, id: LabelId, meshes: &[Mesh]) {
    let all: Vec<DVec3> = meshes
        .iter()
        .flat_map(|mesh| mesh.positions.iter().copied())
        .collect();
    let volume = (hull_volume(&all), Dimension::Volume);
    assembly.record(
        id,
        "hull_volume",
        volume,
        "volume of the convex hull of the whole surface",
    );
}
