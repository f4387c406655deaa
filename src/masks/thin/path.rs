use std::collections::BinaryHeap;

use glam::{DVec2, Vec3A};

use super::ridge::{Crop, Ridge, RidgeFilter};
use crate::frontier::Reached;
use ostra_frames::Image;

/// Minimum and maximum margin around two points in which their path is searched, pixels.
///
/// Between these, the margin is a quarter of the points' distance.
const ROOM_PX: (f64, f64) = (24.0, 200.0);

/// Maximum distance by which a click is moved to a line, pixels.
const SNAP_PX: isize = 6;

/// Penalty of a line per squared pixel of its distance from the click.
///
/// For the line that was clicked, and for a line nearby that may have been meant.
const FAR_COSTS: [f32; 2] = [0.1, 0.02];

/// Minimum contrast of the clicked line, relative to the strongest line nearby.
///
/// A clicked line that is weaker gives way to the strongest one.
const OWN_SHARE: f32 = 0.4;

/// Cost per pixel of length.
const LENGTH_COST: f32 = 0.06;

/// Maximum cost of a colour that differs from that of the two points.
const COLOR_COST: f32 = 0.6;

/// Colour difference (ΔE) that costs half of it.
const COLOR_HALF: f32 = 14.0;

/// Weights of the Lab channels.
///
/// Lightness counts less than hue, because a stem turns towards and away from the light.
const SHADING: Vec3A = Vec3A::new(0.5, 1.0, 1.0);

/// Minimum and maximum contrast (ΔE) that costs a quarter.
///
/// Between these, it is half of the contrast at the points themselves.
const CONTRAST_HALF: (f32, f32) = (1.5, 12.0);

/// One pixel of a path.
#[derive(Debug, Clone, Copy)]
pub(super) struct PathPixel {
    /// Centre in the image, pixels.
    pub at_px: DVec2,
    /// Ridge at this pixel.
    pub ridge: Ridge,
}

/// Returns the cheapest path between two positions of the image, both ends included.
///
/// The path follows pixels that are thin and coloured like the ends. Minimal paths: Cohen and
/// Kimmel, "Global minimum for active contour models: a minimal path approach", IJCV 1997; from
/// pixel to pixel by Dijkstra's algorithm as in Mortensen and Barrett, "Intelligent scissors for
/// image composition", SIGGRAPH 1995.
pub(super) fn path_between(
    image: &Image,
    filter: &RidgeFilter,
    from_px: DVec2,
    to_px: DVec2,
) -> Vec<PathPixel> {
    let crop = crop_around(image, from_px, to_px);
    let mut search = PathSearch::new(&crop, filter);
    let ends = [search.snapped(from_px), search.snapped(to_px)];
    search.learn(ends);
    search.run(ends);
    search.way_to(ends[1])
}

fn crop_around(image: &Image, a: DVec2, b: DVec2) -> Crop {
    let room = (a.distance(b) / 4.0).clamp(ROOM_PX.0, ROOM_PX.1);
    let size = DVec2::new(f64::from(image.width), f64::from(image.height));
    let from = (a.min(b) - room).max(DVec2::ZERO);
    let to = (a.max(b) + room).min(size);
    Crop::cut(
        image,
        [from.x as usize, from.y as usize],
        [to.x.ceil() as usize, to.y.ceil() as usize],
    )
}

/// A* search over the pixels of a crop.
///
/// Hart, Nilsson and Raphael, "A formal basis for the heuristic determination of minimum cost
/// paths", IEEE Transactions on Systems Science and Cybernetics, 1968. The cost of a pixel is
/// computed when it is first reached, so that only the surroundings of the line are filtered.
struct PathSearch<'a> {
    crop: &'a Crop,
    filter: &'a RidgeFilter,
    ridges: Vec<Option<Ridge>>,
    distance: Vec<f32>,
    before: Vec<u32>,
    /// Position and colour of both ends.
    ends: [(DVec2, Vec3A); 2],
    contrast_half: f32,
    /// Minimum cost of a pixel: that of the better end.
    ///
    /// The higher it is, the straighter the search goes.
    least: f32,
}

impl<'a> PathSearch<'a> {
    fn new(crop: &'a Crop, filter: &'a RidgeFilter) -> Self {
        let count = crop.width * crop.height;
        Self {
            crop,
            filter,
            ridges: vec![None; count],
            distance: vec![f32::INFINITY; count],
            before: vec![u32::MAX; count],
            ends: [(DVec2::ZERO, Vec3A::ZERO); 2],
            contrast_half: CONTRAST_HALF.0,
            least: LENGTH_COST,
        }
    }

    /// Returns the pixel of the line that a position means.
    ///
    /// This is the line under the position or, if that is weak compared with a line nearby, the
    /// stronger line.
    fn snapped(&mut self, at_px: DVec2) -> usize {
        let pixel = |at: f64, origin: usize, count: usize| {
            (at as usize).clamp(origin, origin + count - 1) - origin
        };
        let x = pixel(at_px.x, self.crop.origin[0], self.crop.width) as isize;
        let y = pixel(at_px.y, self.crop.origin[1], self.crop.height) as isize;
        let [own, strongest] = FAR_COSTS.map(|far_cost| self.strongest_near(x, y, far_cost));
        let stays = self.ridge(own).contrast >= OWN_SHARE * self.ridge(strongest).contrast;
        if stays { own } else { strongest }
    }

    /// Returns the pixel of the strongest line near a pixel, where lines farther away count less.
    fn strongest_near(&mut self, x: isize, y: isize, far_cost: f32) -> usize {
        let near = (-SNAP_PX..=SNAP_PX).flat_map(|dy| (-SNAP_PX..=SNAP_PX).map(move |dx| (dx, dy)));
        let inside: Vec<(usize, f32)> = near
            .filter_map(|(dx, dy)| {
                Some((
                    self.place(x + dx, y + dy)?,
                    1.0 + far_cost * (dx * dx + dy * dy) as f32,
                ))
            })
            .collect();
        let worth = inside
            .iter()
            .map(|&(at, far)| (self.ridge(at).contrast / far, at));
        worth
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(0, |(_, at)| at)
    }

    fn place(&self, x: isize, y: isize) -> Option<usize> {
        let inside =
            x >= 0 && y >= 0 && x < self.crop.width as isize && y < self.crop.height as isize;
        inside.then(|| y as usize * self.crop.width + x as usize)
    }

    fn ridge(&mut self, at: usize) -> Ridge {
        let (x, y) = (
            (at % self.crop.width) as isize,
            (at / self.crop.width) as isize,
        );
        *self.ridges[at].get_or_insert_with(|| self.filter.at(self.crop, x, y))
    }

    fn middle(&self, at: usize) -> DVec2 {
        DVec2::new(
            (at % self.crop.width) as f64 + 0.5,
            (at / self.crop.width) as f64 + 0.5,
        )
    }

    fn color(&self, at: usize) -> Vec3A {
        self.crop.mean(
            (at % self.crop.width) as isize,
            (at / self.crop.width) as isize,
            0,
        )
    }

    /// Sets the expected contrast and colours from the two ends of the line.
    fn learn(&mut self, ends: [usize; 2]) {
        let weaker = ends
            .map(|end| self.ridge(end).contrast)
            .into_iter()
            .fold(f32::INFINITY, f32::min);
        self.contrast_half = (weaker / 2.0).clamp(CONTRAST_HALF.0, CONTRAST_HALF.1);
        self.ends = ends.map(|end| (self.middle(end), self.color(end)));
        self.least = ends
            .map(|end| self.cost(end))
            .into_iter()
            .fold(f32::INFINITY, f32::min);
    }

    fn cost(&mut self, at: usize) -> f32 {
        let ridge = self.ridge(at);
        let missing = self.contrast_half / (ridge.contrast + self.contrast_half);
        let off = ((self.color(at) - self.expected(at)) * SHADING).length_squared();
        let cost =
            LENGTH_COST + missing * missing + COLOR_COST * off / (off + COLOR_HALF * COLOR_HALF);
        cost.max(self.least)
    }

    /// Returns the colour interpolated between both ends at a pixel's position along the line.
    fn expected(&self, at: usize) -> Vec3A {
        let [(from, first), (to, last)] = self.ends;
        let along = (self.middle(at) - from).dot(to - from) / (to - from).length_squared().max(1.0);
        first.lerp(last, along.clamp(0.0, 1.0) as f32)
    }

    fn run(&mut self, [from, to]: [usize; 2]) {
        let mut open = BinaryHeap::from([Reached {
            cost: self.left(from, to),
            at: from as u32,
        }]);
        self.distance[from] = 0.0;
        while let Some(Reached { cost, at }) = open.pop() {
            let at = at as usize;
            if at == to {
                return;
            }
            let distance = self.distance[at];
            if cost > distance + self.left(at, to) {
                continue;
            }
            let here = self.cost(at);
            let (x, y) = (
                (at % self.crop.width) as isize,
                (at / self.crop.width) as isize,
            );
            for (dx, dy) in (-1..2).flat_map(|dy| (-1..2).map(move |dx| (dx, dy))) {
                let Some(next) = self.place(x + dx, y + dy) else {
                    continue;
                };
                let length = if dx * dy == 0 {
                    1.0
                } else {
                    std::f32::consts::SQRT_2
                };
                if self.distance[next] <= distance + length * here / 2.0 {
                    continue;
                }
                let there = distance + length * (here + self.cost(next)) / 2.0;
                if there < self.distance[next] {
                    self.distance[next] = there;
                    self.before[next] = at as u32;
                    open.push(Reached {
                        cost: there + self.left(next, to),
                        at: next as u32,
                    });
                }
            }
        }
    }

    /// Returns a lower bound of the cost from a pixel to the goal.
    fn left(&self, at: usize, to: usize) -> f32 {
        self.middle(at).distance(self.middle(to)) as f32 * self.least
    }

    fn way_to(&mut self, end: usize) -> Vec<PathPixel> {
        let mut way = vec![end];
        while let Some(&before) = way
            .last()
            .and_then(|&at| self.before.get(at))
            .filter(|&&at| at != u32::MAX)
        {
            way.push(before as usize);
        }
        let origin = DVec2::new(self.crop.origin[0] as f64, self.crop.origin[1] as f64);
        way.into_iter()
            .rev()
            .map(|at| PathPixel {
                at_px: origin + self.middle(at),
                ridge: self.ridge(at),
            })
            .collect()
    }
}
