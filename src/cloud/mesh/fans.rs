/// Ends a list of corners.
const END: u32 = u32::MAX;

/// The triangles around each vertex, as linked lists of corners: corner `3·t + k` is the k-th of triangle `t`.
pub(super) struct Fans {
    first: Vec<u32>,
    next: Vec<u32>,
}

impl Fans {
    /// Of `vertices` vertices.
    pub(super) fn of(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut fans = Self {
            first: vec![END; vertices],
            next: vec![END; triangles.len() * 3],
        };
        for (corner, &vertex) in triangles.as_flattened().iter().enumerate().rev() {
            fans.put(vertex, corner as u32);
        }
        fans
    }

    /// The corners at a vertex.
    pub(super) fn corners(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let some = |corner: u32| (corner != END).then_some(corner);
        std::iter::successors(some(self.first[vertex as usize]), move |&corner| {
            some(self.next[corner as usize])
        })
    }

    /// The triangles around a vertex.
    pub(super) fn triangles(&self, vertex: u32) -> impl Iterator<Item = usize> {
        self.corners(vertex).map(|corner| corner as usize / 3)
    }

    /// Leaves only those corners at a vertex for which `keep` holds.
    pub(super) fn retain(&mut self, vertex: u32, keep: impl Fn(u32) -> bool) {
        let mut corner = std::mem::replace(&mut self.first[vertex as usize], END);
        while corner != END {
            let next = self.next[corner as usize];
            if keep(corner) {
                self.put(vertex, corner);
            }
            corner = next;
        }
    }

    /// Gives the corners at `gone` to `kept`.
    pub(super) fn join(&mut self, kept: u32, gone: u32) {
        let mut corner = std::mem::replace(&mut self.first[gone as usize], END);
        while corner != END {
            let next = self.next[corner as usize];
            self.put(kept, corner);
            corner = next;
        }
    }

    fn put(&mut self, vertex: u32, corner: u32) {
        self.next[corner as usize] = std::mem::replace(&mut self.first[vertex as usize], corner);
    }
}
