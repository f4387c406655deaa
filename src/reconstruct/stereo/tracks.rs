use std::collections::BTreeMap;

/// Keypoints of several views joined by matches (union–find).
#[derive(Debug)]
pub struct Tracks {
    /// Number of the first keypoint of each view, counted over all, then the number of all.
    first: Vec<usize>,
    parents: Vec<usize>,
}

impl Tracks {
    /// Keypoints of each view, none joined.
    pub fn new(counts: impl Iterator<Item = usize>) -> Self {
        let mut first = vec![0];
        counts.for_each(|count| first.push(first[first.len() - 1] + count));
        let parents = (0..first[first.len() - 1]).collect();
        Self { first, parents }
    }

    /// Joins the tracks of two (view, keypoint).
    pub fn join(&mut self, a: (usize, usize), b: (usize, usize)) {
        let (a, b) = (
            self.root(self.first[a.0] + a.1),
            self.root(self.first[b.0] + b.1),
        );
        self.parents[a.max(b)] = a.min(b);
    }

    fn root(&mut self, mut at: usize) -> usize {
        while self.parents[at] != at {
            self.parents[at] = self.parents[self.parents[at]];
            at = self.parents[at];
        }
        at
    }

    /// The tracks of two or more (view, keypoint), without those of views that come up twice: one of the two is wrong.
    pub fn finish(mut self) -> Vec<Vec<(usize, usize)>> {
        let mut members: BTreeMap<usize, Vec<(usize, usize)>> = BTreeMap::new();
        for view in 0..self.first.len() - 1 {
            for at in self.first[view]..self.first[view + 1] {
                let root = self.root(at);
                members
                    .entry(root)
                    .or_default()
                    .push((view, at - self.first[view]));
            }
        }
        let mut tracks: Vec<Vec<(usize, usize)>> = members
            .into_values()
            .filter(|track| track.len() > 1)
            .collect();
        for track in &mut tracks {
            let all = track.clone();
            track.retain(|&(view, _)| all.iter().filter(|other| other.0 == view).count() == 1);
        }
        tracks.retain(|track| track.len() > 1);
        tracks
    }
}
