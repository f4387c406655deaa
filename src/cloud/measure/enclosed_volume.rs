//! Volume of a body from the voxels that its surface encloses.

use glam::{DVec3, IVec3};

/// Edge length of a voxel in spacings, large enough that a surface has few holes.
const EDGE: f64 = 3.0;
/// Number of voxels above which the edge length is increased.
const MOST_VOXELS: f64 = 3e7;
/// Gaps up to twice this number of voxels do not open a body.
const GAP: i32 = 2;
/// Minimum number of enclosed voxels of a solid, as a share of those that hold points.
///
/// Pockets between the layers of an open surface stay below it. A sphere of 3 voxels radius has
/// 0.3.
const LEAST_ENCLOSED: f64 = 0.1;

/// Computes the volume of a body from the voxels of its surface.
///
/// Enclosed voxels count fully, voxels that hold points count half. `spacing` is that of the
/// points; if it is 0, the volume is 0. Through a single gap of one voxel, nothing is enclosed.
pub(super) fn voxel_volume(points: &[DVec3], spacing: f64) -> f64 {
    let Some(mut voxels) = VoxelStates::new(points, spacing, 1) else {
        return 0.0;
    };
    voxels.flood();
    let count = |state| voxels.count(state) as f64;
    (count(VoxelState::Enclosed) + 0.5 * count(VoxelState::Occupied)) * voxels.edge.powi(3)
}

/// Computes the volume of the solid that a surface encloses.
///
/// Gaps up to 4 voxels (12 spacings) are closed. A voxel that holds points counts as far as it lies
/// behind them. Returns `None` if the surface is open, or so small or thin that its voxels enclose
/// nothing.
pub(super) fn solid_volume(points: &[DVec3], spacing: f64) -> Option<f64> {
    let mut voxels = VoxelStates::new(points, spacing, GAP + 1)?;
    voxels.spread(VoxelState::Occupied, VoxelState::Near, GAP);
    voxels.flood();
    voxels.spread(VoxelState::Outside, VoxelState::Outside, GAP);
    voxels.enclose_near();
    let enclosed = voxels.count(VoxelState::Enclosed) as f64;
    let least = LEAST_ENCLOSED * voxels.count(VoxelState::Occupied) as f64;
    (enclosed > least).then(|| (enclosed + voxels.inside_occupied(points)) * voxels.edge.powi(3))
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum VoxelState {
    /// Not reached from outside.
    Enclosed,
    /// Holds points.
    Occupied,
    /// Near the surface; not yet known on which side.
    Near,
    Outside,
}

struct VoxelStates {
    /// World position of the lowest corner.
    low: DVec3,
    edge: f64,
    counts: IVec3,
    states: Vec<VoxelState>,
}

impl VoxelStates {
    /// Creates a grid around the points, with `margin` layers of empty voxels on every side.
    ///
    /// Returns `None` without points or spacing.
    fn new(points: &[DVec3], spacing: f64, margin: i32) -> Option<Self> {
        if spacing <= 0.0 || points.is_empty() {
            return None;
        }
        let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let counts = |edge: f64| ((high - low) / edge).floor() + f64::from(2 * margin + 1);
        let mut edge = EDGE * spacing;
        while counts(edge).element_product() > MOST_VOXELS {
            edge *= 1.2;
        }
        let counts = counts(edge).as_ivec3();
        let mut voxels = Self {
            low: low - f64::from(margin) * edge,
            edge,
            counts,
            states: vec![VoxelState::Enclosed; counts.as_usizevec3().element_product()],
        };
        for &x in points {
            let index = voxels.index(voxels.voxel_of(x));
            voxels.states[index] = VoxelState::Occupied;
        }
        Some(voxels)
    }

    fn voxel_of(&self, x: DVec3) -> IVec3 {
        let at = ((x - self.low) / self.edge).floor().as_ivec3();
        at.clamp(IVec3::ZERO, self.counts - 1)
    }

    fn index(&self, at: IVec3) -> usize {
        let (at, counts) = (at.as_usizevec3(), self.counts.as_usizevec3());
        (at.z * counts.y + at.y) * counts.x + at.x
    }

    fn place(&self, index: usize) -> IVec3 {
        let counts = self.counts.as_usizevec3();
        let [x, y, z] = [
            index % counts.x,
            index / counts.x % counts.y,
            index / (counts.x * counts.y),
        ];
        IVec3::new(x as i32, y as i32, z as i32)
    }

    fn count(&self, state: VoxelState) -> usize {
        self.states.iter().filter(|&&other| other == state).count()
    }

    /// Returns the voxels that share a face with a voxel.
    fn adjacent(&self, at: IVec3) -> impl Iterator<Item = IVec3> + use<> {
        let counts = self.counts;
        [IVec3::X, IVec3::Y, IVec3::Z]
            .into_iter()
            .flat_map(move |step| [at - step, at + step])
            .filter(move |at| at.cmpge(IVec3::ZERO).all() && at.cmplt(counts).all())
    }

    /// Marks the voxels that can be reached from the outermost layer through faces.
    fn flood(&mut self) {
        let mut open = vec![IVec3::ZERO];
        while let Some(at) = open.pop() {
            let index = self.index(at);
            if self.states[index] != VoxelState::Enclosed {
                continue;
            }
            self.states[index] = VoxelState::Outside;
            open.extend(self.adjacent(at));
        }
    }

    /// Marks the free voxels within `steps` faces of those with the state `from`.
    fn spread(&mut self, from: VoxelState, mark: VoxelState, steps: i32) {
        let is_free = |state: VoxelState| {
            matches!(state, VoxelState::Enclosed | VoxelState::Near) && state != mark
        };
        let has_free = |&index: &usize| {
            let mut adjacent = self.adjacent(self.place(index));
            adjacent.any(|at| is_free(self.states[self.index(at)]))
        };
        let mut front: Vec<usize> = (0..self.states.len())
            .filter(|&index| self.states[index] == from)
            .filter(has_free)
            .collect();
        for _ in 0..steps {
            let mut next = Vec::new();
            for index in front {
                for at in self.adjacent(self.place(index)) {
                    let index = self.index(at);
                    if is_free(self.states[index]) {
                        self.states[index] = mark;
                        next.push(index);
                    }
                }
            }
            front = next;
        }
    }

    /// Counts the voxels near the surface that nothing reached from outside as enclosed.
    fn enclose_near(&mut self) {
        for state in &mut self.states {
            if *state == VoxelState::Near {
                *state = VoxelState::Enclosed;
            }
        }
    }

    /// Returns the part of the voxels with points that lies behind these points, in voxels.
    ///
    /// It depends on where the points are between the two sides. This keeps the error small where
    /// a flat side runs along a layer of voxels.
    fn inside_occupied(&self, points: &[DVec3]) -> f64 {
        let mut held: Vec<(usize, DVec3)> = points
            .iter()
            .map(|&x| {
                let at = self.voxel_of(x);
                let middle = at.as_dvec3() + 0.5;
                (self.index(at), (x - self.low) / self.edge - middle)
            })
            .collect();
        held.sort_by_key(|&(index, _)| index);
        let inside = |held: &[(usize, DVec3)]| {
            let mean = held.iter().map(|&(_, x)| x).sum::<DVec3>() / held.len() as f64;
            let outward = self.outward(self.place(held[0].0));
            (0.5 + mean.dot(outward)).clamp(0.0, 1.0)
        };
        held.chunk_by(|a, b| a.0 == b.0).map(inside).sum()
    }

    /// Returns the unit direction from the enclosed to the outside neighbours of a voxel, or 0.
    fn outward(&self, at: IVec3) -> DVec3 {
        let mut sum = DVec3::ZERO;
        for k in 0..27 {
            let step = IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
            let sign = match self.states[self.index(at + step)] {
                VoxelState::Outside => 1.0,
                VoxelState::Enclosed => -1.0,
                VoxelState::Occupied | VoxelState::Near => 0.0,
            };
            sum += sign * step.as_dvec3().normalize_or_zero();
        }
        sum.normalize_or_zero()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::point_sets::{median_spacing, thinned};
    use super::*;

    fn sphere(count: u32) -> Vec<DVec3> {
        (0..count)
            .map(|k| {
                let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(count);
                let (sin, cos) = (2.399_963 * f64::from(k)).sin_cos();
                (1.0 - z * z).sqrt() * DVec3::new(cos, sin, 0.0) + z * DVec3::Z + 5.0
            })
            .collect()
    }

    /// Returns points in a golden-ratio pattern on a sheet of `size`, placed by `place`.
    fn sheet(size: [f64; 2], density: f64, place: impl Fn(f64, f64) -> DVec3) -> Vec<DVec3> {
        let count = (size[0] * size[1] * density).round() as u32;
        (0..count)
            .map(|k| {
                // Martin Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
                let share = |ratio: f64| (0.5 + ratio * f64::from(k)).fract();
                place(
                    size[0] * share(0.754_877_666_2),
                    size[1] * share(0.569_840_291),
                )
            })
            .collect()
    }

    fn turned(points: Vec<DVec3>) -> Vec<DVec3> {
        let turn = glam::DMat3::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1);
        points.into_iter().map(|x| turn * x + 3.0).collect()
    }

    /// Returns points on the six sides of a box.
    fn cuboid(size: DVec3, density: f64) -> Vec<DVec3> {
        let mut points = Vec::new();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in [0.0, size[axis]] {
                points.extend(sheet([size[u], size[v]], density, |a, b| {
                    let mut x = DVec3::ZERO;
                    (x[u], x[v], x[axis]) = (a, b, side);
                    x
                }));
            }
        }
        points
    }

    /// Returns points on the mantle and both ends of a cylinder.
    fn cylinder(radius: f64, height: f64, density: f64) -> Vec<DVec3> {
        let around = |angle: f64| DVec3::new(angle.cos(), angle.sin(), 0.0);
        let mut points = sheet([2.0 * PI * radius, height], density, |u, z| {
            radius * around(u / radius) + z * DVec3::Z
        });
        for z in [0.0, height] {
            let side = 2.0 * radius;
            let end = sheet([side, side], density, |u, v| {
                DVec3::new(u - radius, v - radius, z)
            });
            let is_in = |x: &DVec3| x.truncate().length() <= radius;
            points.extend(end.into_iter().filter(is_in));
        }
        points
    }

    /// Returns the solid volume of points as they are measured.
    fn volume(points: &[DVec3]) -> Option<f64> {
        let points = thinned(points, median_spacing(points));
        solid_volume(&points, median_spacing(&points))
    }

    #[test]
    fn closed_surface_is_filled_and_open_surface_is_not() {
        let (sphere, count) = (sphere(20_000), 20_000.0_f64);
        let spacing = (4.0 * PI / count).sqrt();
        let exact = 4.0 / 3.0 * PI;
        let closed = voxel_volume(&sphere, spacing);
        assert!((closed / exact - 1.0).abs() < 0.03, "{closed}");
        let bowl: Vec<DVec3> = sphere.into_iter().filter(|x| x.z < 5.5).collect();
        assert!(voxel_volume(&bowl, spacing) < 0.3 * exact);
    }

    /// The accuracy that the reference states for about 1000, 4000 and 16 000 points.
    #[test]
    fn solids_are_as_large_as_they_are_at_three_resolutions() {
        let size = DVec3::new(2.0, 1.5, 1.0);
        let area = |size: DVec3| 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        for (count, tolerance) in [(1000.0, 0.03), (4000.0, 0.02), (16_000.0, 0.01)] {
            let rod = count / (2.0 * PI * 0.5 * (2.0 + 0.5));
            let solids = [
                ("sphere", sphere(count as u32), 4.0 / 3.0 * PI),
                ("box", cuboid(size, count / area(size)), 3.0),
                ("turned box", turned(cuboid(size, count / area(size))), 3.0),
                ("cylinder", cylinder(0.5, 2.0, rod), 0.5 * PI),
                ("turned cylinder", turned(cylinder(0.5, 2.0, rod)), 0.5 * PI),
            ];
            for (name, points, exact) in solids {
                let found = volume(&points).unwrap_or_else(|| panic!("{name} of {count} is open"));
                let off = found / exact - 1.0;
                assert!(off.abs() < tolerance, "{name} of {count} points: {off:+.3}");
            }
        }
    }

    #[test]
    fn small_gap_is_closed_and_missing_side_leaves_no_volume() {
        let sphere = sphere(20_000);
        let top = DVec3::new(5.0, 5.0, 6.0);
        let punched: Vec<DVec3> = sphere
            .iter()
            .copied()
            .filter(|x| x.distance(top) > 0.12)
            .collect();
        let off = volume(&punched).unwrap() / (4.0 / 3.0 * PI) - 1.0;
        assert!(off.abs() < 0.02, "{off:+.3}");
        let bowl: Vec<DVec3> = sphere.iter().copied().filter(|x| x.z < 5.5).collect();
        assert_eq!(volume(&bowl), None);
        let leaf = sheet([2.0, 1.0], 5000.0, |u, v| DVec3::new(u, v, 0.2 * u * u));
        assert_eq!(volume(&leaf), None);
    }

    #[test]
    fn distant_points_do_not_exhaust_memory() {
        let points = [
            DVec3::ZERO,
            DVec3::X * 1e-6,
            DVec3::new(1e6, 1e6, 1e6),
            DVec3::NEG_X * 1e9,
        ];
        assert!(voxel_volume(&points, 1e-6).is_finite());
        assert_eq!(voxel_volume(&points, 0.0), 0.0);
        assert_eq!(solid_volume(&points, 1e-6), None);
        assert_eq!(solid_volume(&[], 1.0), None);
    }
}
