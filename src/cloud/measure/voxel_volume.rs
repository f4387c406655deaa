use glam::{DVec3, IVec3};

/// Edge of a voxel in spacings: large enough that a surface has no holes.
const EDGE: f64 = 3.0;
/// More voxels than this are made larger.
const MOST_VOXELS: f64 = 3e7;

/// Volume of a body by the voxels of its surface: those that it encloses count whole, those that hold points half.
/// `spacing` is that of the points; 0 gives 0.
pub(super) fn voxel_volume(points: &[DVec3], spacing: f64) -> f64 {
    if spacing <= 0.0 || points.is_empty() {
        return 0.0;
    }
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let size = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) - low;
    // With a layer of empty voxels around.
    let counts = |edge: f64| (size / edge).floor() + 3.0;
    let mut edge = EDGE * spacing;
    while counts(edge).element_product() > MOST_VOXELS {
        edge *= 1.2;
    }
    let mut voxels = Voxels::new(counts(edge).as_ivec3());
    for &x in points {
        voxels.occupy(((x - low) / edge).floor().as_ivec3() + IVec3::ONE);
    }
    voxels.flood();
    let count = |state| {
        voxels
            .states
            .iter()
            .filter(|&&other| other == state)
            .count() as f64
    };
    (count(State::Enclosed) + 0.5 * count(State::Occupied)) * edge.powi(3)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum State {
    /// What the flood has not reached.
    Enclosed,
    Occupied,
    Outside,
}

struct Voxels {
    counts: IVec3,
    states: Vec<State>,
}

impl Voxels {
    fn new(counts: IVec3) -> Self {
        Self {
            counts,
            states: vec![State::Enclosed; counts.as_usizevec3().element_product()],
        }
    }

    fn index(&self, at: IVec3) -> usize {
        let (at, counts) = (at.as_usizevec3(), self.counts.as_usizevec3());
        (at.z * counts.y + at.y) * counts.x + at.x
    }

    fn occupy(&mut self, at: IVec3) {
        let index = self.index(at.min(self.counts - 1));
        self.states[index] = State::Occupied;
    }

    /// Marks what can be reached from the outermost layer through the voxels' faces.
    fn flood(&mut self) {
        let mut open = vec![IVec3::ZERO];
        while let Some(at) = open.pop() {
            let index = self.index(at);
            if self.states[index] != State::Enclosed {
                continue;
            }
            self.states[index] = State::Outside;
            let beside = [IVec3::X, IVec3::Y, IVec3::Z]
                .into_iter()
                .flat_map(|step| [at - step, at + step]);
            open.extend(
                beside.filter(|at| at.cmpge(IVec3::ZERO).all() && at.cmplt(self.counts).all()),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_body_is_filled_and_an_open_one_is_not() {
        let count = 20_000;
        let sphere: Vec<DVec3> = (0..count)
            .map(|k| {
                let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(count);
                let (sin, cos) = (2.399_963 * f64::from(k)).sin_cos();
                (1.0 - z * z).sqrt() * DVec3::new(cos, sin, 0.0) + z * DVec3::Z + 5.0
            })
            .collect();
        let spacing = (4.0 * std::f64::consts::PI / f64::from(count)).sqrt();
        let exact = 4.0 / 3.0 * std::f64::consts::PI;
        let closed = voxel_volume(&sphere, spacing);
        assert!((closed / exact - 1.0).abs() < 0.03, "{closed}");
        let bowl: Vec<DVec3> = sphere.into_iter().filter(|x| x.z < 5.5).collect();
        assert!(voxel_volume(&bowl, spacing) < 0.3 * exact);
    }

    #[test]
    fn far_points_take_no_endless_memory() {
        let points = [
            DVec3::ZERO,
            DVec3::X * 1e-6,
            DVec3::new(1e6, 1e6, 1e6),
            DVec3::NEG_X * 1e9,
        ];
        assert!(voxel_volume(&points, 1e-6).is_finite());
        assert_eq!(voxel_volume(&points, 0.0), 0.0);
    }
}
