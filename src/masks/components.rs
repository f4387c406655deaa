use super::Region;
use ostra_core::union_find::DisjointSets;

/// Neighbourhood that joins pixels into one component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Connectivity {
    /// The left, right, upper and lower neighbours.
    Four,
    /// The four direct and the four diagonal neighbours.
    Eight,
}

/// Connected components of a region.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Components {
    /// Label of each pixel, row by row.
    ///
    /// 0 is outside the region; `n` is the component `areas[n - 1]`.
    pub labels: Vec<u32>,
    /// Number of pixels of each component, in the order of the components' first pixels.
    pub areas: Vec<usize>,
}

/// A run of inside pixels in one row, `start..end`.
struct Span {
    row: u32,
    start: u32,
    end: u32,
}

/// Finds the connected components of a region.
///
/// The method unites overlapping row runs instead of pixels (Wu, Otoo, Suzuki, "Optimizing two-pass
/// connected-component labeling algorithms", Pattern Analysis and Applications, 2009).
#[must_use]
pub fn components(region: &Region, connectivity: Connectivity) -> Components {
    let spans = spans(region);
    let mut sets = DisjointSets::new(spans.len());
    join_neighbours(&spans, &mut sets, connectivity);
    let mut labels = vec![0; region.inside.len()];
    let mut areas: Vec<usize> = Vec::new();
    let mut label_of_root = vec![0u32; spans.len()];
    for (at, span) in spans.iter().enumerate() {
        let root = sets.root(at as u32) as usize;
        if label_of_root[root] == 0 {
            areas.push(0);
            label_of_root[root] = areas.len() as u32;
        }
        let label = label_of_root[root];
        let row = span.row as usize * region.width as usize;
        labels[row + span.start as usize..row + span.end as usize].fill(label);
        areas[label as usize - 1] += (span.end - span.start) as usize;
    }
    Components { labels, areas }
}

impl Region {
    /// Fills every hole of at most `max_area` pixels.
    ///
    /// A hole is a 4-connected component of outside pixels that does not reach the frame's edge.
    pub fn fill_holes(&mut self, max_area: usize) {
        let (width, height) = (self.width as usize, self.height as usize);
        if width == 0 || height == 0 {
            return;
        }
        let outside = components(&self.inverted(), Connectivity::Four);
        let mut open = vec![false; outside.areas.len() + 1];
        for x in 0..width {
            open[outside.labels[x] as usize] = true;
            open[outside.labels[(height - 1) * width + x] as usize] = true;
        }
        for y in 0..height {
            open[outside.labels[y * width] as usize] = true;
            open[outside.labels[y * width + width - 1] as usize] = true;
        }
        let fill = |label: u32| {
            label > 0 && !open[label as usize] && outside.areas[label as usize - 1] <= max_area
        };
        for (inside, &label) in self.inside.iter_mut().zip(&outside.labels) {
            *inside |= fill(label);
        }
    }

    /// Removes every 8-connected component of fewer than `min_area` pixels.
    pub fn remove_islands(&mut self, min_area: usize) {
        self.keep_components(|area, _| area >= min_area);
    }

    /// Keeps only the largest 8-connected component.
    ///
    /// Among components of equal size, the one whose first pixel comes first is kept.
    pub fn keep_largest(&mut self) {
        self.keep_components(|area, areas| Some(area) == areas.iter().max().copied());
        let found = components(self, Connectivity::Eight);
        for (inside, &label) in self.inside.iter_mut().zip(&found.labels) {
            *inside = label == 1;
        }
    }

    /// Keeps only the 8-connected components that share a pixel with `other`.
    ///
    /// Both regions must have the same size.
    pub fn keep_touching(&mut self, other: &Self) {
        let found = components(self, Connectivity::Eight);
        let mut touches = vec![false; found.areas.len() + 1];
        for (&label, _) in found
            .labels
            .iter()
            .zip(&other.inside)
            .filter(|(_, inside)| **inside)
        {
            touches[label as usize] = label > 0;
        }
        for (inside, &label) in self.inside.iter_mut().zip(&found.labels) {
            *inside = touches[label as usize];
        }
    }

    fn keep_components(&mut self, keep: impl Fn(usize, &[usize]) -> bool) {
        let found = components(self, Connectivity::Eight);
        let kept: Vec<bool> = found
            .areas
            .iter()
            .map(|&area| keep(area, &found.areas))
            .collect();
        for (inside, &label) in self.inside.iter_mut().zip(&found.labels) {
            *inside = label > 0 && kept[label as usize - 1];
        }
    }
}

fn spans(region: &Region) -> Vec<Span> {
    let mut spans = Vec::new();
    for (row, pixels) in region
        .inside
        .chunks_exact(region.width.max(1) as usize)
        .enumerate()
    {
        let mut start = 0;
        for run in pixels.chunk_by(|a, b| a == b) {
            let end = start + run.len() as u32;
            if run[0] {
                spans.push(Span {
                    row: row as u32,
                    start,
                    end,
                });
            }
            start = end;
        }
    }
    spans
}

/// Unites touching spans of neighbouring rows in one pass over the spans.
fn join_neighbours(spans: &[Span], sets: &mut DisjointSets, connectivity: Connectivity) {
    let reach = u32::from(connectivity == Connectivity::Eight);
    let mut above = 0;
    for (at, span) in spans.iter().enumerate() {
        while spans[above].row + 1 < span.row
            || (spans[above].row + 1 == span.row && spans[above].end + reach <= span.start)
        {
            above += 1;
        }
        let touching = spans[above..at]
            .iter()
            .take_while(|upper| upper.row < span.row && upper.start < span.end + reach);
        for (offset, _) in touching.enumerate() {
            sets.unite((above + offset) as u32, at as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn region(rows: &[&str]) -> Region {
        let inside = rows
            .iter()
            .flat_map(|row| row.bytes().map(|byte| byte == b'#'))
            .collect();
        Region {
            width: rows[0].len() as u32,
            height: rows.len() as u32,
            inside,
        }
    }

    #[test]
    fn diagonal_pixels_join_only_with_eight_connectivity() {
        let diagonal = region(&["#..", ".#.", "..#"]);
        assert_eq!(components(&diagonal, Connectivity::Eight).areas, [3]);
        assert_eq!(components(&diagonal, Connectivity::Four).areas, [1, 1, 1]);
    }

    #[test]
    fn small_holes_are_filled_and_small_islands_removed() {
        let mut ring = region(&["#####..", "#...#.#", "#.#.#..", "#...#..", "#####.."]);
        ring.remove_islands(2);
        assert_eq!(ring.area(), 16);
        let mut small = ring.clone();
        small.fill_holes(8);
        assert_eq!(small, ring, "the hole has nine pixels");
        ring.fill_holes(9);
        assert_eq!(
            ring,
            region(&["#####..", "#####..", "#####..", "#####..", "#####.."])
        );
    }

    #[test]
    fn gap_open_to_the_frame_edge_is_not_filled() {
        let mut bay = region(&["###", "#.#", "#.#"]);
        bay.fill_holes(100);
        assert_eq!(bay.area(), 7);
    }

    #[test]
    fn keep_largest_keeps_the_first_of_equal_components() {
        let mut two = region(&["##.#", "...#", "#..."]);
        two.keep_largest();
        assert_eq!(two, region(&["##..", "....", "...."]));
    }

    #[test]
    fn keep_touching_keeps_whole_components() {
        let mut three = region(&["##.#", "...#", "#..."]);
        three.keep_touching(&region(&["..##", "..#.", "...."]));
        assert_eq!(three, region(&["...#", "...#", "...."]));
    }

    /// Finds components by flood fill, as a reference.
    fn flooded(region: &Region, connectivity: Connectivity) -> Components {
        let (width, height) = (i64::from(region.width), i64::from(region.height));
        let mut found = Components {
            labels: vec![0; region.inside.len()],
            areas: Vec::new(),
        };
        for seed in 0..region.inside.len() {
            if !region.inside[seed] || found.labels[seed] != 0 {
                continue;
            }
            found.areas.push(0);
            let label = found.areas.len() as u32;
            found.labels[seed] = label;
            let mut open = vec![seed as i64];
            while let Some(at) = open.pop() {
                found.areas[label as usize - 1] += 1;
                for (dx, dy) in (-1..2).flat_map(|dy| (-1..2).map(move |dx| (dx, dy))) {
                    let (x, y) = (at % width + dx, at / width + dy);
                    let reached = connectivity == Connectivity::Eight || dx * dy == 0;
                    if !reached || x < 0 || y < 0 || x >= width || y >= height {
                        continue;
                    }
                    let next = (y * width + x) as usize;
                    if region.inside[next] && found.labels[next] == 0 {
                        found.labels[next] = label;
                        open.push(next as i64);
                    }
                }
            }
        }
        found
    }

    proptest! {
        #[test]
        fn components_agree_with_flood_fill(
            (width, inside) in (1u32..17).prop_flat_map(|width| (Just(width), prop::collection::vec(any::<bool>(), (width * 11) as usize))),
        ) {
            let region = Region { width, height: 11, inside };
            for connectivity in [Connectivity::Four, Connectivity::Eight] {
                prop_assert_eq!(components(&region, connectivity), flooded(&region, connectivity));
            }
        }
    }
}
