use super::{KeypointId, MapProblem};

/// For every keypoint the keypoints of other images that it was matched with.
#[derive(Debug)]
pub struct Correspondences {
    /// Number of the first keypoint of each image, counted over all images.
    first: Vec<u32>,
    /// Where the links of each keypoint begin; one more at the end.
    starts: Vec<u32>,
    links: Vec<KeypointId>,
}

impl Correspondences {
    /// Gathers the matches of all pairs.
    #[must_use]
    pub fn new(problem: &MapProblem) -> Self {
        let mut first = vec![0];
        for image in &problem.images {
            first.push(first[first.len() - 1] + image.keypoints.len() as u32);
        }
        let mut starts = vec![0; first[first.len() - 1] as usize + 1];
        let both = || {
            problem.pairs.iter().flat_map(|pair| {
                let [a, b] = pair.images;
                pair.matches.iter().flat_map(move |&[i, j]| {
                    let (x, y) = (
                        KeypointId { image: a, index: i },
                        KeypointId { image: b, index: j },
                    );
                    [(x, y), (y, x)]
                })
            })
        };
        let slot =
            |keypoint: KeypointId| (first[keypoint.image as usize] + keypoint.index) as usize;
        for (from, _) in both() {
            starts[slot(from) + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut links = vec![KeypointId { image: 0, index: 0 }; starts[starts.len() - 1] as usize];
        let mut next = starts.clone();
        for (from, to) in both() {
            let place = &mut next[slot(from)];
            links[*place as usize] = to;
            *place += 1;
        }
        Self {
            first,
            starts,
            links,
        }
    }

    /// What a keypoint was matched with, in the order of the pairs.
    #[must_use]
    pub fn of(&self, keypoint: KeypointId) -> &[KeypointId] {
        let slot = (self.first[keypoint.image as usize] + keypoint.index) as usize;
        &self.links[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }
}
