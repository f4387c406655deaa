use super::extract::Raw;

/// A small piece of which some place was seen so well, as a sum of frames' weights, is no noise: as by one frame from
/// straight above.
const WELL_SEEN: f32 = 1.0;
/// The same as a share of how well the larger pieces were seen, in the median: with many frames noise is seen often, too.
const AS_WELL: f32 = 0.5;

impl Raw {
    /// For each triangle, whether the connected piece that it belongs to has at least `least` of them or, if that counts, was
    /// seen well.
    pub(super) fn in_true_pieces(&self, least: usize, keep_well_seen: bool) -> Vec<bool> {
        let mut parent: Vec<u32> = (0..self.positions.len() as u32).collect();
        for &[a, b, c] in &self.triangles {
            join(&mut parent, a, b);
            join(&mut parent, b, c);
        }
        let roots: Vec<usize> = (0..parent.len() as u32)
            .map(|vertex| root(&mut parent, vertex) as usize)
            .collect();
        let (mut sizes, mut best) = (vec![0usize; roots.len()], vec![0f32; roots.len()]);
        self.triangles
            .iter()
            .for_each(|triangle| sizes[roots[triangle[0] as usize]] += 1);
        roots
            .iter()
            .zip(&self.weights)
            .for_each(|(&root, &weight)| best[root] = best[root].max(weight));
        let of_large = roots
            .iter()
            .zip(&self.weights)
            .filter(|&(&root, _)| sizes[root] >= least);
        let enough = WELL_SEEN.max(AS_WELL * median(of_large.map(|(_, &weight)| weight).collect()));
        let is_true = |triangle: &[u32; 3]| {
            let root = roots[triangle[0] as usize];
            sizes[root] >= least || keep_well_seen && best[root] >= enough
        };
        self.triangles.iter().map(is_true).collect()
    }
}

fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() {
        0.0
    } else {
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    }
}

fn root(parent: &mut [u32], mut at: u32) -> u32 {
    while parent[at as usize] != at {
        parent[at as usize] = parent[parent[at as usize] as usize];
        at = parent[at as usize];
    }
    at
}

fn join(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parent, a), root(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Strips of so many triangles, each seen with one weight.
    fn strips(strips: &[(u32, f32)]) -> Raw {
        let mut raw = Raw::default();
        for &(triangles, weight) in strips {
            let first = raw.weights.len() as u32;
            raw.triangles
                .extend((first..first + triangles).map(|at| [at, at + 1, at + 2]));
            raw.weights.extend((0..triangles + 2).map(|_| weight));
        }
        raw.positions = vec![glam::Vec3::ZERO; raw.weights.len()];
        raw
    }

    fn kept(raw: &Raw) -> Vec<bool> {
        let all = raw.in_true_pieces(10, true);
        let firsts = (0..all.len())
            .filter(|&at| at == 0 || raw.triangles[at][0] != raw.triangles[at - 1][0] + 1);
        firsts.map(|at| all[at]).collect()
    }

    #[test]
    fn a_small_piece_stays_where_it_was_seen_well() {
        let raw = strips(&[(12, 0.3), (9, 0.9), (9, 1.1), (10, 0.3)]);
        assert_eq!(kept(&raw), [true, false, true, true]);
        assert_eq!(
            raw.in_true_pieces(10, false)
                .iter()
                .filter(|&&kept| kept)
                .count(),
            22,
            "by size alone"
        );
    }

    #[test]
    fn many_frames_make_no_surface_of_noise() {
        assert_eq!(
            kept(&strips(&[(40, 20.0), (9, 9.0), (9, 11.0)])),
            [true, false, true]
        );
        assert!(Raw::default().in_true_pieces(10, true).is_empty());
    }
}
