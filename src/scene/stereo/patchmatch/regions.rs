use super::field::Color;

/// Pixels of a region at most.
const MOST: usize = 11;

/// Offsets of eight regions around a pixel, four V-shaped near ones and four far strips, all on the other colour of the
/// checkerboard (Q. Xu and W. Tao, *Multi-Scale Geometric Consistency Guided Multi-View Stereo*, CVPR 2019).
#[derive(Debug, Clone)]
pub struct Regions {
    offsets: [Vec<(i32, i32)>; 8],
    /// Columns and rows that a region reaches at most.
    reach: usize,
}

impl Default for Regions {
    fn default() -> Self {
        let near: Vec<(i32, i32)> = vec![(0, 1), (1, 2), (-1, 2), (2, 3), (-2, 3), (3, 4), (-3, 4)];
        let far: Vec<(i32, i32)> = (0..MOST as i32).map(|step| (0, 3 + 2 * step)).collect();
        let turned = |offsets: &[(i32, i32)], quarter: usize| {
            let turn = |&(x, y): &(i32, i32)| [(x, y), (y, x), (x, -y), (-y, x)][quarter];
            offsets.iter().map(turn).collect::<Vec<_>>()
        };
        let offsets = std::array::from_fn(|region| turned(if region < 4 { &near } else { &far }, region % 4));
        Self { offsets, reach: 2 * MOST + 1 }
    }
}

impl Regions {
    /// The pixel of least cost in each region, as its offset and its place among the pixels of its colour.
    #[inline(always)]
    pub fn best(
        &self,
        other: &Color,
        (width, height): (usize, usize),
        x: usize,
        y: usize,
    ) -> [Option<(i32, i32, usize)>; 8] {
        let reach = self.reach;
        let is_far_in = x >= reach && y >= reach && x + reach < width && y + reach < height;
        let half = width.div_ceil(2);
        std::array::from_fn(|region| {
            let mut best = None;
            let mut least = f32::INFINITY;
            for &(dx, dy) in &self.offsets[region] {
                let (column, row) = (x as i32 + dx, y as i32 + dy);
                let is_within = || column >= 0 && row >= 0 && column < width as i32 && row < height as i32;
                if !is_far_in && !is_within() {
                    continue;
                }
                let at = row as usize * half + column as usize / 2;
                if other.costs[at] < least {
                    least = other.costs[at];
                    best = Some((dx, dy, at));
                }
            }
            best
        })
    }
}
