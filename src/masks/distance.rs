use glam::DVec2;
use rayon::prelude::*;

use crate::{Connectivity, Region, components};

/// Returns the squared distance (px²) from each pixel to the nearest pixel of `region`.
///
/// Distances are Euclidean, between pixel centres, row by row. They are 0 inside, and `u32::MAX`
/// everywhere when the region is empty. The result is exact (Felzenszwalb, Huttenlocher, "Distance
/// transforms of sampled functions", Theory of Computing, 2012).
#[must_use]
pub fn squared_distance_to(region: &Region) -> Vec<u32> {
    let width = region.width as usize;
    let mut columns = column_distances(region);
    columns
        .par_chunks_mut(width.max(1))
        .for_each_init(Envelope::default, Envelope::transform);
    columns
}

/// Returns the squared depth (px²) of each pixel inside `region`, row by row.
///
/// The depth is the distance to the nearest outside pixel; everything beyond the frame's edge is
/// outside. Pixels outside the region have depth 0.
#[must_use]
pub fn squared_depth_in(region: &Region) -> Vec<u32> {
    let (width, height) = (region.width as usize, region.height as usize);
    let mut depths = squared_distance_to(&region.inverted());
    for (y, row) in depths.chunks_exact_mut(width.max(1)).enumerate() {
        let to_row = (y + 1).min(height - y) as u32;
        for (x, depth) in row.iter_mut().enumerate() {
            let to_edge = to_row.min((x + 1).min(width - x) as u32);
            *depth = (*depth).min(to_edge.saturating_mul(to_edge));
        }
    }
    depths
}

/// Returns the pixel (column, row) deepest inside a region, where a person would click.
///
/// Among equally deep pixels, the one nearest to their mean is returned. The frame's edge counts as
/// the region's edge. Returns `None` when the region is empty.
#[must_use]
pub fn deepest_point(region: &Region) -> Option<(u32, u32)> {
    let depths = squared_depth_in(region);
    let deepest = depths.iter().copied().max().filter(|&depth| depth > 0)?;
    let width = region.width as usize;
    let tied: Vec<(u64, u64)> = (0..depths.len())
        .filter(|&at| depths[at] == deepest)
        .map(|at| ((at % width) as u64, (at / width) as u64))
        .collect();
    let count = tied.len() as f64;
    let mean_x = tied.iter().map(|point| point.0).sum::<u64>() as f64 / count;
    let mean_y = tied.iter().map(|point| point.1).sum::<u64>() as f64 / count;
    let off = |&(x, y): &(u64, u64)| (x as f64 - mean_x).powi(2) + (y as f64 - mean_y).powi(2);
    tied.iter()
        .min_by(|a, b| off(a).total_cmp(&off(b)))
        .map(|&(x, y)| (x as u32, y as u32))
}

impl Region {
    /// Returns the region grown by a disk.
    ///
    /// It holds all pixels whose centre is at most `radius_px` from the centre of an inside pixel.
    #[must_use]
    pub fn dilated(&self, radius_px: f64) -> Self {
        if self.is_empty() {
            return self.clone();
        }
        let reach = squared_reach(radius_px);
        let inside = squared_distance_to(self)
            .into_iter()
            .map(|distance| f64::from(distance) <= reach)
            .collect();
        Self {
            width: self.width,
            height: self.height,
            inside,
        }
    }

    /// Returns the region shrunk by a disk.
    ///
    /// It holds all pixels whose centre is farther than `radius_px` from every outside pixel. The
    /// frame's edge does not shrink the region.
    #[must_use]
    pub fn eroded(&self, radius_px: f64) -> Self {
        self.inverted().dilated(radius_px).inverted()
    }
}

/// Returns slightly more than the squared radius.
///
/// The margin keeps pixels at exactly the radius, for example at √2.
fn squared_reach(radius_px: f64) -> f64 {
    radius_px.max(0.0).powi(2) * (1.0 + 1e-12)
}

/// Returns squared distances along columns only.
fn column_distances(region: &Region) -> Vec<u32> {
    let (width, height) = (region.width as usize, region.height as usize);
    let mut distances = vec![u32::MAX; region.inside.len()];
    let mut since = vec![u32::MAX; width];
    let mut sweep = |row: usize, since: &mut [u32]| {
        let pixels = row * width..(row + 1) * width;
        let pixels = distances[pixels.clone()]
            .iter_mut()
            .zip(&region.inside[pixels]);
        for ((distance, &inside), since) in pixels.zip(since) {
            *since = if inside { 0 } else { since.saturating_add(1) };
            *distance = (*distance).min(since.saturating_mul(*since));
        }
    };
    (0..height).for_each(|row| sweep(row, &mut since));
    since.fill(u32::MAX);
    (0..height).rev().for_each(|row| sweep(row, &mut since));
    distances
}

/// Lower envelope of the parabolas of one row, reused between rows to avoid allocations.
#[derive(Default)]
struct Envelope {
    /// Column and height of each parabola, from left to right.
    parabolas: Vec<(f64, f64)>,
    /// Column from which each parabola is the lowest.
    starts: Vec<f64>,
}

impl Envelope {
    /// Replaces each `row[x]` with the minimum of `row[q] + (x − q)²` over all q.
    fn transform(&mut self, row: &mut [u32]) {
        self.parabolas.clear();
        self.starts.clear();
        for (column, &height) in row.iter().enumerate() {
            if height != u32::MAX {
                self.add(column as f64, f64::from(height));
            }
        }
        if self.parabolas.is_empty() {
            return;
        }
        let mut lowest = 0;
        for (x, value) in row.iter_mut().enumerate() {
            let x = x as f64;
            while self.starts.get(lowest + 1).is_some_and(|&start| start <= x) {
                lowest += 1;
            }
            let (column, height) = self.parabolas[lowest];
            *value = ((x - column).powi(2) + height).min(f64::from(u32::MAX)) as u32;
        }
    }

    fn add(&mut self, column: f64, height: f64) {
        while let (Some(&(other, other_height)), Some(&start)) =
            (self.parabolas.last(), self.starts.last())
        {
            let crossing = ((height + column * column) - (other_height + other * other))
                / (2.0 * (column - other));
            if crossing > start {
                self.parabolas.push((column, height));
                self.starts.push(crossing);
                return;
            }
            self.parabolas.pop();
            self.starts.pop();
        }
        self.parabolas.push((column, height));
        self.starts.push(f64::NEG_INFINITY);
    }
}

/// Returns representative points of a region, as clicks would be placed.
///
/// They are the deepest points of its `most` largest components, in pixels, largest component
/// first.
#[must_use]
pub fn landmarks(region: &Region, most: usize) -> Vec<DVec2> {
    let parts = components(region, Connectivity::Eight);
    let depths = squared_depth_in(region);
    // Deepest pixel of each component so far; the first one among equally deep pixels.
    let mut deepest: Vec<(u32, usize)> = vec![(0, 0); parts.areas.len()];
    for (at, (&part, &depth)) in parts
        .labels
        .iter()
        .zip(&depths)
        .enumerate()
        .filter(|(_, (part, _))| **part > 0)
    {
        let slot = &mut deepest[part as usize - 1];
        if depth > slot.0 {
            *slot = (depth, at);
        }
    }
    let mut order: Vec<usize> = (0..parts.areas.len()).collect();
    order.sort_by_key(|&part| std::cmp::Reverse(parts.areas[part]));
    let width = region.width as usize;
    let centre = |at: usize| DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
    order
        .into_iter()
        .take(most)
        .map(|part| centre(deepest[part].1))
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn regions() -> impl Strategy<Value = Region> {
        (1u32..15, 1u32..15, 1u32..12).prop_flat_map(|(width, height, rare)| {
            prop::collection::vec(0..rare, (width * height) as usize).prop_map(move |draws| {
                Region {
                    width,
                    height,
                    inside: draws.iter().map(|&draw| draw == 0).collect(),
                }
            })
        })
    }

    fn by_search(region: &Region, x: u32, y: u32) -> u32 {
        let all = (0..region.height).flat_map(|v| (0..region.width).map(move |u| (u, v)));
        all.filter(|&(u, v)| region.at(u, v))
            .map(|(u, v)| u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2))
            .min()
            .unwrap_or(u32::MAX)
    }

    proptest! {
        #[test]
        fn distances_match_brute_force(region in regions()) {
            let distances = squared_distance_to(&region);
            for y in 0..region.height {
                for x in 0..region.width {
                    prop_assert_eq!(distances[(y * region.width + x) as usize], by_search(&region, x, y));
                }
            }
        }

        #[test]
        fn dilation_and_erosion_match_brute_force(region in regions(), radius in 0.0f64..5.0) {
            let (grown, shrunk) = (region.dilated(radius), region.eroded(radius));
            let outside = region.inverted();
            for y in 0..region.height {
                for x in 0..region.width {
                    prop_assert_eq!(grown.at(x, y), f64::from(by_search(&region, x, y)) <= radius * radius);
                    prop_assert_eq!(shrunk.at(x, y), f64::from(by_search(&outside, x, y)) > radius * radius);
                }
            }
        }

        #[test]
        fn deepest_point_is_inside_with_maximum_depth(region in regions()) {
            let depths = squared_depth_in(&region);
            match deepest_point(&region) {
                None => prop_assert!(region.is_empty()),
                Some((x, y)) => {
                    prop_assert!(region.at(x, y));
                    prop_assert_eq!(depths[(y * region.width + x) as usize], *depths.iter().max().unwrap());
                }
            }
        }
    }

    #[test]
    fn dilation_by_root_two_reaches_the_diagonal() {
        let mut dot = Region::empty(5, 5);
        dot.inside[12] = true;
        assert_eq!(dot.dilated(2f64.sqrt()).area(), 9);
        assert_eq!(dot.dilated(1.0).area(), 5);
        assert_eq!(dot.dilated(1.0).eroded(1.0), dot);
    }

    #[test]
    fn deepest_point_of_a_bar_is_its_middle() {
        let mut bar = Region::empty(40, 9);
        for y in 3..6 {
            bar.inside[y * 40 + 4..y * 40 + 35].fill(true);
        }
        assert_eq!(deepest_point(&bar), Some((19, 4)));
        assert_eq!(deepest_point(&Region::empty(3, 3)), None);
        let full = Region::empty(41, 9).inverted();
        assert_eq!(deepest_point(&full), Some((20, 4)));
    }

    #[test]
    fn landmarks_are_deepest_points_largest_component_first() {
        let rows = [
            "......###",
            "#.....###",
            "......###",
            "###......",
            "#####....",
            "###......",
            ".........",
        ];
        let inside = rows
            .iter()
            .flat_map(|row| row.bytes().map(|byte| byte == b'#'))
            .collect();
        let region = Region {
            width: 9,
            height: 7,
            inside,
        };
        assert_eq!(
            landmarks(&region, 2),
            [DVec2::new(1.5, 4.5), DVec2::new(7.5, 1.5)]
        );
        assert_eq!(landmarks(&region, 9).len(), 3);
        assert!(landmarks(&Region::empty(4, 4), 3).is_empty());
    }
}
