use std::collections::BinaryHeap;

use super::link::Link;
use ostra_geometry::Pose;

/// Sets of scans that links tie together.
#[derive(Debug, Clone)]
pub struct Components {
    parent: Vec<usize>,
}

impl Components {
    /// The components of `count` scans under some links, given by their ends.
    #[must_use]
    pub fn new(count: usize, links: impl IntoIterator<Item = [usize; 2]>) -> Self {
        let mut components = Self {
            parent: (0..count).collect(),
        };
        for [a, b] in links {
            let (a, b) = (components.of(a), components.of(b));
            // The lower number leads, so that a component is named by its first scan.
            components.parent[a.max(b)] = a.min(b);
        }
        components
    }

    /// The first scan of the component that a scan belongs to.
    #[must_use]
    pub fn of(&self, mut scan: usize) -> usize {
        while self.parent[scan] != scan {
            scan = self.parent[scan];
        }
        scan
    }

    /// Members of each component, ascending; the largest first, of equal ones the earlier.
    #[must_use]
    pub fn members(&self) -> Vec<Vec<usize>> {
        let mut by_first = std::collections::BTreeMap::<usize, Vec<usize>>::new();
        for scan in 0..self.parent.len() {
            by_first.entry(self.of(scan)).or_default().push(scan);
        }
        let mut members: Vec<Vec<usize>> = by_first.into_values().collect();
        members.sort_by_key(|members| std::cmp::Reverse(members.len()));
        members
    }
}

/// Poses of the scans that links tie to `root`, which stays at the world's origin, along the links that agree best (a
/// maximum spanning tree); `None` for the others.
#[must_use]
pub fn chained(count: usize, links: &[Link], root: usize) -> Vec<Option<Pose>> {
    let mut by_scan: Vec<Vec<usize>> = vec![Vec::new(); count];
    for (at, link) in links.iter().enumerate() {
        for scan in link.scans {
            by_scan[scan].push(at);
        }
    }
    let quality =
        |at: usize| (1e6 * links[at].agreement.overlap * links[at].agreement.consistent) as u64;
    let mut poses: Vec<Option<Pose>> = vec![None; count];
    poses[root] = Some(Pose::IDENTITY);
    let reach = |scan: usize| {
        by_scan[scan]
            .iter()
            .map(|&at| (quality(at), std::cmp::Reverse(at)))
    };
    let mut open: BinaryHeap<_> = reach(root).collect();
    while let Some((_, std::cmp::Reverse(at))) = open.pop() {
        let [source, target] = links[at].scans;
        let measured = links[at].aligned.target_from_source;
        let (scan, pose) = match (poses[source], poses[target]) {
            (Some(known), None) => (target, measured.compose(&known)),
            (None, Some(known)) => (source, measured.inverse().compose(&known)),
            _ => continue,
        };
        poses[scan] = Some(pose);
        open.extend(reach(scan));
    }
    poses
}
