use super::extract::Raw;

impl Raw {
    /// For each triangle, whether the connected piece that it belongs to has at least `least` of them.
    pub(super) fn in_large_pieces(&self, least: usize) -> Vec<bool> {
        let mut parent: Vec<u32> = (0..self.positions.len() as u32).collect();
        for &[a, b, c] in &self.triangles {
            join(&mut parent, a, b);
            join(&mut parent, b, c);
        }
        let mut sizes = vec![0usize; parent.len()];
        let roots: Vec<u32> = self.triangles.iter().map(|triangle| root(&mut parent, triangle[0])).collect();
        roots.iter().for_each(|&root| sizes[root as usize] += 1);
        roots.into_iter().map(|root| sizes[root as usize] >= least).collect()
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
