//! The pose graph of all links, the groups that links connect, and their clouds.

use std::collections::{BTreeSet, BinaryHeap};

use super::link::{FrameLink, Link};
use super::odometry::{OnPose, Tried};
use super::pyramid::Pyramid;
use super::register::OrientedCloud;
use super::scan::Scan;
use ostra_core::union_find::DisjointSets;
use ostra_geometry::{Pose, PoseEdge, PoseGraphOptions, solve_pose_graph};

/// A link must keep this share of its weight to hold scans together.
const HOLDS: f64 = 0.25;
/// Links may contradict each other by this share of the typical depth before they lose weight.
const SWITCH: f64 = 0.02;

/// Scans with the links between them, and their poses as far as known.
pub struct Graph {
    /// The links.
    pub links: Vec<Link>,
    /// Share of its weight that each link kept.
    pub shares: Vec<f64>,
    /// Pose of each scan.
    pub poses: Vec<Option<Pose>>,
    /// Pairs that were tried, whether they agreed or not.
    tried: BTreeSet<[usize; 2]>,
    /// Mean of the scans' mean depths, in world units.
    pub typical_depth: f64,
}

impl Graph {
    /// Builds the graph of some scans; the poses of the largest connected group are known.
    #[must_use]
    pub fn new(scans: &[Scan], tried: &[Tried]) -> Self {
        let typical: f64 =
            scans.iter().map(Scan::typical_depth).sum::<f64>() / scans.len().max(1) as f64;
        let mut graph = Self {
            links: Vec::new(),
            shares: Vec::new(),
            poses: vec![None; scans.len()],
            tried: BTreeSet::new(),
            typical_depth: typical,
        };
        graph.add(tried.iter().cloned());
        if let Some(largest) = graph.fragments().first() {
            graph.place(largest, &Pose::IDENTITY);
        }
        graph.solve();
        graph
    }

    /// Adds pairs that were tried since.
    pub fn add(&mut self, tried: impl IntoIterator<Item = Tried>) {
        for (pair, result) in tried {
            self.tried.insert(pair);
            if let Ok(link) = result {
                self.links.push(link);
                self.shares.push(1.0);
            }
        }
    }

    /// Returns the pairs that were tried, whether they agreed or not.
    #[must_use]
    pub fn tried(&self) -> &BTreeSet<[usize; 2]> {
        &self.tried
    }

    /// Returns the scans whose poses are known.
    #[must_use]
    pub fn whole(&self) -> Fragment {
        let posed = self
            .poses
            .iter()
            .enumerate()
            .filter_map(|(scan, pose)| Some((scan, (*pose)?)));
        let (scans, poses) = posed.unzip();
        Fragment { scans, poses }
    }

    /// Returns the connected groups of scans without a pose, largest first.
    ///
    /// Each is in a world of its own: its poses follow the links that agree best.
    #[must_use]
    pub fn fragments(&self) -> Vec<Fragment> {
        let links: Vec<Link> = self.holding().copied().collect();
        let members =
            ScanComponents::new(self.poses.len(), links.iter().map(|link| link.scans)).members();
        let open = members
            .into_iter()
            .filter(|scans| scans.iter().all(|&scan| self.poses[scan].is_none()));
        let fragment = |scans: Vec<usize>| {
            let along = chained(self.poses.len(), &links, scans[0]);
            let poses = scans
                .iter()
                .map(|&scan| along[scan].unwrap_or_default())
                .collect();
            Fragment { scans, poses }
        };
        open.map(fragment).collect()
    }

    /// Adds the poses of a fragment, given its pose in the world.
    pub fn place(&mut self, fragment: &Fragment, fragment_from_world: &Pose) {
        for (&scan, pose) in fragment.scans.iter().zip(&fragment.poses) {
            self.poses[scan] = Some(pose.compose(fragment_from_world));
        }
    }

    /// Returns the links that the others do not contradict.
    pub fn holding(&self) -> impl Iterator<Item = &Link> {
        self.links
            .iter()
            .zip(&self.shares)
            .filter(|(_, share)| **share >= HOLDS)
            .map(|(link, _)| link)
    }

    /// Reports all known poses, in the world of the first scan that has one.
    pub fn tell(&self, scans: &[Scan], on_pose: &OnPose<'_>) {
        let world_from_first = self
            .poses
            .iter()
            .flatten()
            .next()
            .copied()
            .unwrap_or_default()
            .inverse();
        for (scan, pose) in scans.iter().zip(&self.poses) {
            pose.iter()
                .for_each(|pose| on_pose(scan.frame, &pose.compose(&world_from_first)));
        }
    }

    /// Returns all links by the frames' numbers, ascending.
    #[must_use]
    pub fn frame_links(&self, scans: &[Scan]) -> Vec<FrameLink> {
        let frame_link = |(link, share): (&Link, &f64)| FrameLink {
            frames: link.scans.map(|scan| scans[scan].frame),
            kind: link.kind,
            consistent: link.agreement.consistent,
            holds: *share >= HOLDS,
        };
        let mut links: Vec<FrameLink> = self
            .links
            .iter()
            .zip(&self.shares)
            .map(frame_link)
            .collect();
        links.sort_by_key(|link| (link.frames, link.kind));
        links
    }

    /// Solves the pose graph; scans that no link then connects to the largest group lose their pose.
    pub fn solve(&mut self) {
        let is_posed = |link: &Link| link.scans.iter().all(|&scan| self.poses[scan].is_some());
        let posed: Vec<usize> = (0..self.links.len())
            .filter(|&at| is_posed(&self.links[at]))
            .collect();
        let edges: Vec<PoseEdge> = posed.iter().map(|&at| self.links[at].edge()).collect();
        let start: Vec<Pose> = self
            .poses
            .iter()
            .map(|pose| pose.unwrap_or_default())
            .collect();
        let root = self.poses.iter().position(Option::is_some);
        let fixed: Vec<bool> = (0..start.len()).map(|scan| Some(scan) == root).collect();
        let switch_distance = (SWITCH * self.typical_depth).max(f64::MIN_POSITIVE);
        let options = PoseGraphOptions {
            switch_distance,
            ..PoseGraphOptions::default()
        };
        let solved = solve_pose_graph(&start, &fixed, &edges, &options);
        for (&at, &share) in posed.iter().zip(&solved.shares) {
            self.shares[at] = share;
        }
        let held = self.holding().map(|link| link.scans);
        let held = held.filter(|[a, b]| self.poses[*a].is_some() && self.poses[*b].is_some());
        let kept = ScanComponents::new(self.poses.len(), held)
            .members()
            .into_iter()
            .next()
            .unwrap_or_default();
        self.poses = vec![None; start.len()];
        for scan in kept {
            self.poses[scan] = Some(solved.node_from_world[scan]);
        }
    }
}

/// Sets of scans that links connect.
#[derive(Debug, Clone)]
pub struct ScanComponents {
    /// By scan, the first scan of its component.
    first: Vec<u32>,
}

impl ScanComponents {
    /// Computes the components of `count` scans under some links, given by their ends.
    #[must_use]
    pub fn new(count: usize, links: impl IntoIterator<Item = [usize; 2]>) -> Self {
        let mut sets = DisjointSets::new(count);
        for [a, b] in links {
            sets.unite(a as u32, b as u32);
        }
        Self {
            first: sets.into_roots(),
        }
    }

    /// Returns the first scan of the component that a scan belongs to.
    #[must_use]
    pub fn of(&self, scan: usize) -> usize {
        self.first[scan] as usize
    }

    /// Returns the members of each component, ascending; the largest first, of equal ones the earlier.
    #[must_use]
    pub fn members(&self) -> Vec<Vec<usize>> {
        let mut by_first = std::collections::BTreeMap::<usize, Vec<usize>>::new();
        for scan in 0..self.first.len() {
            by_first.entry(self.of(scan)).or_default().push(scan);
        }
        let mut members: Vec<Vec<usize>> = by_first.into_values().collect();
        members.sort_by_key(|members| std::cmp::Reverse(members.len()));
        members
    }
}

/// Returns poses of the scans that links connect to `root`, along the links that agree best.
///
/// These form a maximum spanning tree. `root` is at the world's origin; `None` for scans that are
/// not connected.
#[must_use]
fn chained(count: usize, links: &[Link], root: usize) -> Vec<Option<Pose>> {
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

/// Maximum number of scans that a fragment's cloud is made from.
const SCANS: usize = 30;
/// The level of the views whose pixels become points.
const LEVEL: usize = 1;

/// Scans that odometry and loops connect, and their relative poses.
#[derive(Debug, Clone)]
pub struct Fragment {
    /// Indices of its scans, ascending.
    pub scans: Vec<usize>,
    /// Pose of each scan, in a world of the fragment's own.
    pub poses: Vec<Pose>,
}

impl Fragment {
    /// Returns the points that its scans see, in its own world.
    #[must_use]
    pub fn cloud(&self, scans: &[Scan]) -> OrientedCloud {
        let mut cloud = OrientedCloud::default();
        let step = self.scans.len().div_ceil(SCANS).max(1);
        for (&scan, pose) in self.scans.iter().zip(&self.poses).step_by(step) {
            add(&mut cloud, &scans[scan], pose);
        }
        cloud
    }
}

fn add(cloud: &mut OrientedCloud, scan: &Scan, pose: &Pose) {
    let pyramid = Pyramid::new(&scan.view);
    let level = &pyramid.levels[LEVEL];
    let world_from_camera = pose.inverse();
    let (rotation, shift) = (
        world_from_camera.rotation.as_quat(),
        world_from_camera.translation.as_vec3(),
    );
    for (pixel, &depth) in level.depths.iter().enumerate() {
        if depth > 0.0 {
            let ray = level.ray(pixel % level.width, pixel / level.width);
            cloud.positions.push(rotation * (ray * depth) + shift);
            cloud.normals.push(rotation * level.normals[pixel]);
            cloud.intensities.push(level.grey[pixel]);
        }
    }
}
