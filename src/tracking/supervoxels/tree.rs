use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rustc_hash::FxHashMap;

use super::segmentation::{BoundaryWeights, Supervoxels};

/// Minimum relative size of a neighbour across a clear border to be another object.
const LEAST_SHARE: f32 = 0.5;

/// A hierarchy of supervoxels, joined two at a time.
///
/// The weakest border is removed first, and strengths are averaged along each border (agglomerative
/// clustering by average linkage).
pub struct SupervoxelTree {
    /// Parent of each body; a root is its own parent.
    parents: Vec<u32>,
    children: Vec<Option<[u32; 2]>>,
    /// Mean strength of the border removed within each body; 0 for supervoxels.
    strengths: Vec<f32>,
    /// Number of voxels.
    sizes: Vec<u32>,
}

/// Border of two bodies: the sum of strength times length, and the length.
#[derive(Clone, Copy, Default)]
struct BorderStrength {
    strength: f32,
    length: f32,
}

/// Two bodies that may be joined next; the weakest border compares greatest.
struct Join(f32, [u32; 2]);

impl Ord for Join {
    fn cmp(&self, other: &Self) -> Ordering {
        other.0.total_cmp(&self.0).then(other.1.cmp(&self.1))
    }
}

impl PartialOrd for Join {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Join {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Join {}

/// The current roots with their borders.
struct Joining {
    borders: Vec<FxHashMap<u32, BorderStrength>>,
    open: BinaryHeap<Join>,
}

impl SupervoxelTree {
    pub fn of(parts: &Supervoxels, judgement: BoundaryWeights) -> Self {
        let count = parts.len();
        let mut joining = Joining {
            borders: vec![FxHashMap::default(); count],
            open: BinaryHeap::new(),
        };
        for border in &parts.borders {
            let strength = judgement.strength(border);
            joining.add(
                [border.a, border.b],
                BorderStrength {
                    strength: strength * border.length,
                    length: border.length,
                },
            );
        }
        let mut tree = Self {
            parents: (0..count as u32).collect(),
            children: vec![None; count],
            strengths: vec![0.0; count],
            sizes: parts.sizes.clone(),
        };
        while let Some(Join(strength, bodies)) = joining.open.pop() {
            if bodies
                .iter()
                .all(|&body| tree.parents[body as usize] == body)
            {
                let joined = tree.join(bodies, strength);
                joining.join(bodies, joined);
            }
        }
        tree
    }

    fn join(&mut self, bodies: [u32; 2], strength: f32) -> u32 {
        let joined = self.parents.len() as u32;
        bodies
            .iter()
            .for_each(|&body| self.parents[body as usize] = joined);
        self.parents.push(joined);
        self.children.push(Some(bodies));
        self.strengths.push(strength);
        self.sizes
            .push(bodies.iter().map(|&body| self.sizes[body as usize]).sum());
        joined
    }

    /// Returns the supervoxels of the object that one belongs to.
    ///
    /// This is the largest body around it before it joins another of similar size over a border of
    /// `least_strength`, or becomes part of a `closed` body.
    pub fn thing(&self, part: u32, least_strength: f32, closed: &[bool]) -> Vec<u32> {
        let mut body = part;
        loop {
            let parent = self.parents[body as usize];
            let adjacent = self.sizes[parent as usize] - self.sizes[body as usize];
            let is_like = adjacent as f32 >= LEAST_SHARE * self.sizes[body as usize] as f32;
            let is_other = self.strengths[parent as usize] >= least_strength && is_like;
            if parent == body || closed[parent as usize] || is_other {
                return self.parts(body);
            }
            body = parent;
        }
    }

    /// Returns which bodies contain any of the supervoxels.
    pub fn around(&self, parts: &[u32]) -> Vec<bool> {
        let mut around = vec![false; self.parents.len()];
        for &part in parts {
            let mut body = part as usize;
            while !std::mem::replace(&mut around[body], true) {
                body = self.parents[body] as usize;
            }
        }
        around
    }

    fn parts(&self, body: u32) -> Vec<u32> {
        let (mut open, mut parts) = (vec![body], Vec::new());
        while let Some(body) = open.pop() {
            match self.children[body as usize] {
                Some(children) => open.extend(children),
                None => parts.push(body),
            }
        }
        parts
    }

    pub fn bytes(&self) -> usize {
        self.parents.len() * (3 * size_of::<u32>() + size_of::<Option<[u32; 2]>>())
    }
}

impl Joining {
    fn add(&mut self, [a, b]: [u32; 2], between: BorderStrength) {
        self.borders[a as usize].insert(b, between);
        self.borders[b as usize].insert(a, between);
        self.open
            .push(Join(between.strength / between.length, [a, b]));
    }

    /// Moves the borders of two bodies to `joined`, which is the next index.
    fn join(&mut self, bodies: [u32; 2], joined: u32) {
        let mut around: FxHashMap<u32, BorderStrength> = FxHashMap::default();
        for body in bodies {
            for (other, between) in std::mem::take(&mut self.borders[body as usize]) {
                if !bodies.contains(&other) {
                    self.borders[other as usize].remove(&body);
                    let all = around.entry(other).or_default();
                    all.strength += between.strength;
                    all.length += between.length;
                }
            }
        }
        self.borders.push(FxHashMap::default());
        for (other, between) in around {
            self.add([other, joined], between);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::supervoxels::segmentation::SupervoxelBorder;

    #[test]
    fn object_ends_where_it_would_join_another_one() {
        // Four in a row; the two on each side are similar, and all are joined in the end.
        let border = |a, color| SupervoxelBorder {
            a,
            b: a + 1,
            length: 1.0,
            bend_deg: 0.0,
            color,
        };
        let parts = Supervoxels {
            of_voxel: vec![0, 1, 2, 3],
            places: (0..4).map(|x| Vec3::X * x as f32).collect(),
            sizes: vec![1; 4],
            borders: vec![border(0, 1.0), border(1, 9.0), border(2, 2.0)],
        };
        let tree = SupervoxelTree::of(
            &parts,
            BoundaryWeights {
                groove_deg: 30.0,
                color: 80.0,
            },
        );
        let thing = |least: f32, apart: &[u32]| {
            let mut thing = tree.thing(0, least, &tree.around(apart));
            thing.sort_unstable();
            thing
        };
        assert_eq!(thing(0.8, &[]), [0, 1, 2, 3]);
        assert_eq!(
            thing(0.8, &[3]),
            [0, 1],
            "what 3 is in stays away, and with it what hangs together with 3"
        );
        assert_eq!(thing(0.8, &[1]), [0]);
        assert_eq!(
            thing(0.05, &[]),
            [0, 1],
            "the border in the middle is clear enough"
        );
    }
}
