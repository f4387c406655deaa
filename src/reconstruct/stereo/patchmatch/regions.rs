use super::field::Color;

/// Pixels of a region at most.
const MOST: usize = 11;

/// Eight regions around a pixel, four V-shaped near ones and four far strips, all on the other colour of the
/// checkerboard (Q. Xu and W. Tao, *Multi-Scale Geometric Consistency Guided Multi-View Stereo*, CVPR 2019).
#[derive(Debug, Clone)]
pub struct Regions {
    regions: [Vec<Place>; 8],
    width: usize,
    height: usize,
    /// Columns and rows that a region reaches at most.
    reach: usize,
}

/// A pixel of a region.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Offset in columns and rows.
    offset: (i32, i32),
    /// The same among the pixels of a colour, from even and from odd columns.
    steps: [isize; 2],
}

impl Regions {
    /// The regions around pixels of a picture.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        let near: Vec<(i32, i32)> = vec![(0, 1), (1, 2), (-1, 2), (2, 3), (-2, 3), (3, 4), (-3, 4)];
        let far: Vec<(i32, i32)> = (0..MOST as i32).map(|step| (0, 3 + 2 * step)).collect();
        let half = width.div_ceil(2) as isize;
        let place = |(dx, dy): (i32, i32)| {
            let step = |odd: isize| dy as isize * half + (dx as isize + odd).div_euclid(2);
            Place {
                offset: (dx, dy),
                steps: [step(0), step(1)],
            }
        };
        let turned = |offsets: &[(i32, i32)], quarter: usize| {
            let turn = |&(x, y): &(i32, i32)| [(x, y), (y, x), (x, -y), (-y, x)][quarter];
            offsets.iter().map(turn).map(place).collect::<Vec<_>>()
        };
        let regions =
            std::array::from_fn(|region| turned(if region < 4 { &near } else { &far }, region % 4));
        Self {
            regions,
            width,
            height,
            reach: 2 * MOST + 1,
        }
    }

    /// The pixel of least cost in each region, as its offset and its place among the pixels of its colour.
    #[inline(always)]
    pub fn best(&self, other: &Color, x: usize, y: usize) -> [Option<(i32, i32, usize)>; 8] {
        let (reach, width, height) = (self.reach, self.width, self.height);
        let is_far_in = x >= reach && y >= reach && x + reach < width && y + reach < height;
        let from = y * width.div_ceil(2) + x / 2;
        std::array::from_fn(|region| {
            let (mut best, mut least) = (0, f32::INFINITY);
            for (
                number,
                &Place {
                    offset: (dx, dy),
                    steps,
                },
            ) in self.regions[region].iter().enumerate()
            {
                let (column, row) = (x as i32 + dx, y as i32 + dy);
                let is_within =
                    || column >= 0 && row >= 0 && column < width as i32 && row < height as i32;
                if !is_far_in && !is_within() {
                    continue;
                }
                // Without a branch, which could not be foreseen.
                let cost = other.costs[from.wrapping_add_signed(steps[x % 2])];
                best = if cost < least { number } else { best };
                least = least.min(cost);
            }
            let Place {
                offset: (dx, dy),
                steps,
            } = self.regions[region][best];
            (least < f32::INFINITY).then(|| (dx, dy, from.wrapping_add_signed(steps[x % 2])))
        })
    }
}
