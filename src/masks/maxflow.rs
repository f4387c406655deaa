//! Minimum cut between two terminals.
//!
//! Finds augmenting paths along two search trees (Boykov and Kolmogorov, "An experimental
//! comparison of min-cut/max-flow algorithms for energy minimization in vision", PAMI 2004).

use std::collections::VecDeque;

const NONE: u32 = u32::MAX;
const TERMINAL: u32 = u32::MAX - 1;
const ORPHAN: u32 = u32::MAX - 2;

/// An edge of a [`FlowGraph`] with its capacity in both directions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlowLink {
    pub from: u32,
    pub to: u32,
    pub forward: i32,
    pub backward: i32,
}

/// A graph with two terminals.
///
/// Capacities are integers, so that the cut is exact. Their sum must fit in 31 bits per node.
pub(crate) struct FlowGraph {
    first: Vec<u32>,
    head: Vec<u32>,
    sister: Vec<u32>,
    residual: Vec<i32>,
    /// Remaining capacity from the source (above 0) or to the sink (below 0).
    terminal: Vec<i32>,
}

impl FlowGraph {
    /// Builds a graph over `terminal.len()` nodes.
    ///
    /// A `terminal` above 0 is a capacity from the source, below 0 to the sink.
    pub fn new(terminal: Vec<i32>, links: &[FlowLink]) -> Self {
        let nodes = terminal.len();
        let mut first = vec![0u32; nodes + 2];
        for link in links {
            first[link.from as usize + 2] += 1;
            first[link.to as usize + 2] += 1;
        }
        for node in 2..first.len() {
            first[node] += first[node - 1];
        }
        let arcs = links.len() * 2;
        let (mut head, mut sister, mut residual) = (vec![0; arcs], vec![0; arcs], vec![0; arcs]);
        for link in links {
            let there = first[link.from as usize + 1];
            first[link.from as usize + 1] += 1;
            let back = first[link.to as usize + 1];
            first[link.to as usize + 1] += 1;
            (
                head[there as usize],
                sister[there as usize],
                residual[there as usize],
            ) = (link.to, back, link.forward);
            (
                head[back as usize],
                sister[back as usize],
                residual[back as usize],
            ) = (link.from, there, link.backward);
        }
        first.pop();
        Self {
            first,
            head,
            sister,
            residual,
            terminal,
        }
    }

    /// Returns which nodes are on the source's side of the minimum cut (the smallest such set).
    pub fn source_side(self) -> Vec<bool> {
        let mut search = SearchTrees::new(self);
        search.run();
        search
            .tree
            .iter()
            .map(|&tree| tree == Tree::Source)
            .collect()
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Tree {
    Free,
    Source,
    Sink,
}

/// State of the two search trees.
struct SearchTrees {
    graph: FlowGraph,
    tree: Vec<Tree>,
    /// Arc from the node to its parent, or one of the markers above.
    parent: Vec<u32>,
    /// Time at which `distance` was last known to be correct.
    stamp: Vec<u32>,
    distance: Vec<u32>,
    queued: Vec<bool>,
    active: VecDeque<u32>,
    orphans: VecDeque<u32>,
    time: u32,
}

impl SearchTrees {
    fn new(graph: FlowGraph) -> Self {
        let nodes = graph.terminal.len();
        let mut search = Self {
            tree: vec![Tree::Free; nodes],
            parent: vec![NONE; nodes],
            stamp: vec![0; nodes],
            distance: vec![0; nodes],
            queued: vec![false; nodes],
            active: VecDeque::new(),
            orphans: VecDeque::new(),
            time: 0,
            graph,
        };
        for node in 0..nodes {
            let terminal = search.graph.terminal[node];
            if terminal != 0 {
                search.tree[node] = if terminal > 0 {
                    Tree::Source
                } else {
                    Tree::Sink
                };
                search.parent[node] = TERMINAL;
                search.distance[node] = 1;
                search.activate(node as u32);
            }
        }
        search
    }

    fn run(&mut self) {
        while let Some(&node) = self.active.front() {
            match self.grow(node) {
                Some(meeting) => {
                    self.time += 1;
                    self.augment(meeting);
                    while let Some(orphan) = self.orphans.pop_front() {
                        self.label_import(orphan);
                    }
                }
                None => {
                    self.active.pop_front();
                    self.queued[node as usize] = false;
                }
            }
        }
    }

    fn activate(&mut self, node: u32) {
        if !self.queued[node as usize] {
            self.queued[node as usize] = true;
            self.active.push_back(node);
        }
    }

    fn arcs(&self, node: u32) -> std::ops::Range<u32> {
        self.graph.first[node as usize]..self.graph.first[node as usize + 1]
    }

    /// Returns the residual capacity of `arc`, which leads from a node of `tree` to its children.
    fn room(&self, arc: u32, tree: Tree) -> i32 {
        let arc = if tree == Tree::Source {
            arc
        } else {
            self.graph.sister[arc as usize]
        };
        self.graph.residual[arc as usize]
    }

    /// Grows a tree around an active node.
    ///
    /// Returns the arc from the source's tree to the sink's tree if the two meet.
    fn grow(&mut self, node: u32) -> Option<u32> {
        let at = node as usize;
        let tree = self.tree[at];
        if tree == Tree::Free {
            return None;
        }
        for arc in self.arcs(node) {
            if self.room(arc, tree) <= 0 {
                continue;
            }
            let next = self.graph.head[arc as usize] as usize;
            if self.tree[next] == Tree::Free {
                self.tree[next] = tree;
                self.parent[next] = self.graph.sister[arc as usize];
                self.stamp[next] = self.stamp[at];
                self.distance[next] = self.distance[at] + 1;
                self.activate(next as u32);
            } else if self.tree[next] != tree {
                return Some(if tree == Tree::Source {
                    arc
                } else {
                    self.graph.sister[arc as usize]
                });
            } else if self.stamp[next] <= self.stamp[at] && self.distance[next] > self.distance[at]
            {
                self.parent[next] = self.graph.sister[arc as usize];
                self.stamp[next] = self.stamp[at];
                self.distance[next] = self.distance[at] + 1;
            }
        }
        None
    }

    /// Pushes as much flow as possible along the path over `meeting`.
    fn augment(&mut self, meeting: u32) {
        let source_end = self.graph.head[self.graph.sister[meeting as usize] as usize];
        let sink_end = self.graph.head[meeting as usize];
        let flow = self.graph.residual[meeting as usize]
            .min(self.bottleneck(source_end, Tree::Source))
            .min(self.bottleneck(sink_end, Tree::Sink));
        self.graph.residual[meeting as usize] -= flow;
        self.graph.residual[self.graph.sister[meeting as usize] as usize] += flow;
        self.push(source_end, flow, Tree::Source);
        self.push(sink_end, flow, Tree::Sink);
    }

    fn bottleneck(&self, mut node: u32, tree: Tree) -> i32 {
        let mut least = i32::MAX;
        loop {
            let arc = self.parent[node as usize];
            if arc == TERMINAL {
                return least.min(self.graph.terminal[node as usize].abs());
            }
            least = least.min(self.room(self.graph.sister[arc as usize], tree));
            node = self.graph.head[arc as usize];
        }
    }

    fn push(&mut self, mut node: u32, flow: i32, tree: Tree) {
        loop {
            let arc = self.parent[node as usize];
            if arc == TERMINAL {
                self.graph.terminal[node as usize] -=
                    if tree == Tree::Source { flow } else { -flow };
                if self.graph.terminal[node as usize] == 0 {
                    self.orphan(node);
                }
                return;
            }
            let back = self.graph.sister[arc as usize];
            let (used, reverse) = if tree == Tree::Source {
                (back, arc)
            } else {
                (arc, back)
            };
            self.graph.residual[used as usize] -= flow;
            self.graph.residual[reverse as usize] += flow;
            if self.graph.residual[used as usize] == 0 {
                self.orphan(node);
            }
            node = self.graph.head[arc as usize];
        }
    }

    fn orphan(&mut self, node: u32) {
        self.parent[node as usize] = ORPHAN;
        self.orphans.push_back(node);
    }

    /// Finds a new parent for an orphan in its tree, or frees it and makes its children orphans.
    fn label_import(&mut self, node: u32) {
        let tree = self.tree[node as usize];
        let mut best: Option<(u32, u32)> = None;
        for arc in self.arcs(node) {
            let other = self.graph.head[arc as usize];
            if self.tree[other as usize] != tree
                || self.room(self.graph.sister[arc as usize], tree) <= 0
            {
                continue;
            }
            if let Some(distance) = self.distance_to_terminal(other)
                && best.is_none_or(|(least, _)| distance < least)
            {
                best = Some((distance, arc));
            }
        }
        if let Some((distance, arc)) = best {
            self.parent[node as usize] = arc;
            self.stamp[node as usize] = self.time;
            self.distance[node as usize] = distance + 1;
        } else {
            self.free(node, tree);
        }
    }

    fn free(&mut self, node: u32, tree: Tree) {
        self.tree[node as usize] = Tree::Free;
        self.parent[node as usize] = NONE;
        for arc in self.arcs(node) {
            let other = self.graph.head[arc as usize];
            if self.tree[other as usize] != tree {
                continue;
            }
            if self.room(self.graph.sister[arc as usize], tree) > 0 {
                self.activate(other);
            }
            let parent = self.parent[other as usize];
            if parent < ORPHAN && self.graph.head[parent as usize] == node {
                self.orphan(other);
            }
        }
    }

    /// Returns the number of steps from `node` to its terminal; `None` if it is disconnected.
    fn distance_to_terminal(&mut self, node: u32) -> Option<u32> {
        let mut steps = 0;
        let mut at = node;
        let distance = loop {
            if self.stamp[at as usize] == self.time {
                break steps + self.distance[at as usize];
            }
            match self.parent[at as usize] {
                TERMINAL => {
                    self.stamp[at as usize] = self.time;
                    self.distance[at as usize] = 1;
                    break steps + 1;
                }
                NONE | ORPHAN => return None,
                arc => at = self.graph.head[arc as usize],
            }
            steps += 1;
        };
        let (mut at, mut left) = (node, distance);
        while self.stamp[at as usize] != self.time {
            self.stamp[at as usize] = self.time;
            self.distance[at as usize] = left;
            left -= 1;
            at = self.graph.head[self.parent[at as usize] as usize];
        }
        Some(distance)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn cut_value(inside: &[bool], terminal: &[i32], links: &[FlowLink]) -> i64 {
        let cut = |(node, &capacity): (usize, &i32)| {
            let paid = if capacity > 0 {
                !inside[node]
            } else {
                inside[node]
            };
            if paid { i64::from(capacity.abs()) } else { 0 }
        };
        let across = |link: &FlowLink| match (inside[link.from as usize], inside[link.to as usize])
        {
            (true, false) => i64::from(link.forward),
            (false, true) => i64::from(link.backward),
            _ => 0,
        };
        terminal.iter().enumerate().map(cut).sum::<i64>() + links.iter().map(across).sum::<i64>()
    }

    fn least_cut(terminal: &[i32], links: &[FlowLink]) -> i64 {
        (0..1u32 << terminal.len())
            .map(|bits| {
                let inside: Vec<bool> = (0..terminal.len())
                    .map(|node| bits >> node & 1 == 1)
                    .collect();
                cut_value(&inside, terminal, links)
            })
            .min()
            .unwrap()
    }

    proptest! {
        #[test]
        fn cut_is_as_cheap_as_the_best_of_all_subsets(
            terminal in prop::collection::vec(-20i32..20, 2..10),
            raw in prop::collection::vec((0u32..10, 0u32..10, 0i32..15, 0i32..15), 0..30),
        ) {
            let nodes = terminal.len() as u32;
            let links: Vec<FlowLink> = raw
                .into_iter()
                .map(|(from, to, forward, backward)| FlowLink { from: from % nodes, to: to % nodes, forward, backward })
                .filter(|link| link.from != link.to)
                .collect();
            let inside = FlowGraph::new(terminal.clone(), &links).source_side();
            prop_assert_eq!(cut_value(&inside, &terminal, &links), least_cut(&terminal, &links));
        }
    }

    #[test]
    fn chain_is_cut_at_its_weakest_link() {
        let links: Vec<FlowLink> = [5, 4, 1, 6]
            .iter()
            .enumerate()
            .map(|(at, &capacity)| FlowLink {
                from: at as u32,
                to: at as u32 + 1,
                forward: capacity,
                backward: capacity,
            })
            .collect();
        let inside = FlowGraph::new(vec![100, 0, 0, 0, -100], &links).source_side();
        assert_eq!(inside, [true, true, true, false, false]);
    }

    #[test]
    fn cut_without_links_is_the_sign_of_the_terminals() {
        let terminal: Vec<i32> = (0..10_000).map(|at| (at * 7919 % 41) - 20).collect();
        let inside = FlowGraph::new(terminal.clone(), &[]).source_side();
        assert!(
            inside
                .iter()
                .zip(&terminal)
                .all(|(&inside, &terminal)| inside == (terminal > 0))
        );
    }
}
