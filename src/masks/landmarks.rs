use glam::DVec2;

use super::{Connectivity, Region, components, squared_depth_in};

/// Points that stand for a region as clicks would: the deepest point of each of its `most` largest parts, largest
/// first, in pixels.
#[must_use]
pub fn landmarks(region: &Region, most: usize) -> Vec<DVec2> {
    let parts = components(region, Connectivity::Eight);
    let depths = squared_depth_in(region);
    // Per part its deepest pixel so far; of equally deep ones the first.
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
    use super::*;

    #[test]
    fn each_part_is_stood_for_by_its_deepest_point_largest_part_first() {
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
