use glam::{DVec3, IVec3, Vec3};
use rustc_hash::FxHashMap;

/// Points in cubic cells as wide as the radius within which neighbours are looked for.
pub(super) struct Cells<'a> {
    points: &'a [Vec3],
    radius: f64,
    cells: FxHashMap<IVec3, Vec<u32>>,
}

impl<'a> Cells<'a> {
    /// Points that are not finite are nobody's neighbours.
    pub(super) fn new(points: &'a [Vec3], radius: f64) -> Self {
        let mut cells: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
        for (k, x) in points.iter().enumerate().filter(|(_, x)| x.is_finite()) {
            cells.entry(cell_of(*x, radius)).or_default().push(k as u32);
        }
        Self {
            points,
            radius,
            cells,
        }
    }

    /// The other points at most the radius away from the `of`-th.
    pub(super) fn neighbours(&self, of: usize) -> impl Iterator<Item = usize> + '_ {
        let x = self.points[of];
        let centre = cell_of(x, self.radius);
        let squared = self.radius * self.radius;
        (0..27)
            .map(move |k| centre + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1))
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .map(|&k| k as usize)
            .filter(move |&k| k != of && f64::from(self.points[k].distance_squared(x)) <= squared)
    }
}

fn cell_of(x: Vec3, side: f64) -> IVec3 {
    let cell: DVec3 = (x.as_dvec3() / side).floor();
    cell.as_ivec3()
}
