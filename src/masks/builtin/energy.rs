//! The energy of changing regions' sides, and its minimum cut.

use super::graph::{Edge, RegionGraph};
use crate::maxflow::{FlowGraph, Link};

/// Capacity units per pixel side of a border without any edge.
const UNIT: f32 = 1000.0;
const CERTAIN: i32 = 100_000_000;

/// What a region's fate is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// The cut decides.
    Open,
    /// Changes for sure.
    Seed,
    /// Stays for sure; a border with it costs.
    Wall,
    /// Is on the wanted side already; a border with it costs nothing, leaving a gap to it does.
    Joined,
}

/// The price of an object ending on an edge, per pixel side.
pub(super) fn border_price(edge: &Edge) -> f32 {
    (-5.0 * edge.strength).exp() + 0.01
}

/// Which open regions change at least energy; `gain` per region is what its change is worth, in pixel sides of a
/// border without any edge; `pull` scales the price of a gap to regions joined already.
pub(super) fn cheapest_change(
    graph: &RegionGraph,
    roles: &[Role],
    gain: &[f32],
    pull: f32,
) -> Vec<bool> {
    let mut node_of = vec![u32::MAX; roles.len()];
    let mut terminal: Vec<i32> = Vec::new();
    for (region, role) in roles.iter().enumerate() {
        if matches!(role, Role::Open | Role::Seed) {
            node_of[region] = terminal.len() as u32;
            let worth = (gain[region] * UNIT).clamp(-1e8, 1e8) as i32;
            terminal.push(if *role == Role::Seed { CERTAIN } else { worth });
        }
    }
    let mut links = Vec::with_capacity(graph.edges.len());
    for edge in &graph.edges {
        let price = (edge.length * border_price(edge) * UNIT) as i32;
        let (a, b) = (edge.a as usize, edge.b as usize);
        match (node_of[a], node_of[b]) {
            (u32::MAX, u32::MAX) => {}
            (u32::MAX, node) => rest(&mut terminal[node as usize], roles[a], price, pull),
            (node, u32::MAX) => rest(&mut terminal[node as usize], roles[b], price, pull),
            (from, to) => links.push(Link {
                from,
                to,
                forward: price,
                backward: price,
            }),
        }
    }
    let side = FlowGraph::new(terminal, &links).source_side();
    node_of
        .iter()
        .map(|&node| side.get(node as usize).copied().unwrap_or(false))
        .collect()
}

/// A border with a region that the cut does not decide.
fn rest(terminal: &mut i32, role: Role, price: i32, pull: f32) {
    match role {
        Role::Wall => *terminal -= price,
        Role::Joined => *terminal += (price as f32 * pull) as i32,
        Role::Open | Role::Seed => {}
    }
}
