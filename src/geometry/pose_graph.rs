use glam::{DMat3, DQuat, DVec3};

use super::Pose;
use super::blocks::{BLOCK, Block6, Column6, Skyline, dot, solve};

/// A measured relative pose between two nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseEdge {
    /// Source node of the measured pose.
    pub source: usize,
    /// Target node of the measured pose.
    pub target: usize,
    /// Measured pose, `target_from_source`.
    pub target_from_source: Pose,
    /// Information matrix of the measurement.
    ///
    /// For a small motion δ of the source in the axes of the target (rotation vector in radians,
    /// then translation), `δᵀ · information · δ` is the mean squared displacement of the points on
    /// which the measurement is based.
    pub information: [[f64; 6]; 6],
    /// Weight, above 0.
    pub weight: f64,
    /// Whether the edge loses weight if other edges contradict it.
    pub switchable: bool,
}

/// Options of [`solve_pose_graph`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGraphOptions {
    /// Displacement at which a switchable edge has a weight of a quarter, in world units, above 0.
    pub switch_distance: f64,
    /// Maximum number of steps.
    pub max_iterations: usize,
}

impl Default for PoseGraphOptions {
    fn default() -> Self {
        Self {
            switch_distance: 0.05,
            max_iterations: 100,
        }
    }
}

/// A solved pose graph.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedPoseGraph {
    /// Pose of each node.
    pub node_from_world: Vec<Pose>,
    /// Error of each edge: root mean square displacement of its points, in world units.
    pub displacements: Vec<f64>,
    /// Weight factor of each edge, 0–1; 1 for edges that are not switchable.
    pub shares: Vec<f64>,
    /// Number of steps taken.
    pub iterations: usize,
}

/// Step size, relative to the scale of the unknowns, below which the solver has converged.
const CONVERGED: f64 = 1e-9;
const LEAST_DAMPING: f64 = 1e-9;
const MOST_DAMPING: f64 = 1e6;

/// Computes the node poses that best agree with the measured edges, by Levenberg–Marquardt.
///
/// Nodes in `fixed` do not move. Switchable edges that contradict the others lose their weight as
/// in a line process (S. Choi, Q.-Y. Zhou, V. Koltun, *Robust Reconstruction of Indoor Scenes*,
/// CVPR 2015). Nodes that are not connected to a fixed one keep their poses.
///
/// Edges whose ends are equal or do not exist are ignored.
#[must_use]
pub fn solve_pose_graph(
    node_from_world: &[Pose],
    fixed: &[bool],
    edges: &[PoseEdge],
    options: &PoseGraphOptions,
) -> SolvedPoseGraph {
    let graph = Graph::new(
        node_from_world.len(),
        fixed,
        edges,
        options.switch_distance.powi(2),
    );
    let mut poses = node_from_world.to_vec();
    let mut cost = graph.cost(&poses);
    let mut damping = 1e-4;
    let mut iterations = 0;
    while iterations < options.max_iterations && damping < MOST_DAMPING && !graph.first.is_empty() {
        iterations += 1;
        let Some(step) = graph.step(&poses, damping) else {
            damping *= 10.0;
            continue;
        };
        let moved = graph.moved(&poses, &step);
        let lower = graph.cost(&moved);
        if lower.is_nan() || lower > cost {
            damping *= 10.0;
            continue;
        }
        let gain = cost - lower;
        (poses, cost) = (moved, lower);
        damping = (damping * 0.2).max(LEAST_DAMPING);
        if gain <= CONVERGED * cost || step.iter().flatten().all(|value| value.abs() < 1e-12) {
            break;
        }
    }
    let squared: Vec<f64> = edges
        .iter()
        .map(|edge| squared_displacement(edge, &poses).unwrap_or(0.0))
        .collect();
    let shares = edges
        .iter()
        .zip(&squared)
        .map(|(edge, &squared)| graph.share(edge, squared))
        .collect();
    SolvedPoseGraph {
        node_from_world: poses,
        displacements: squared.iter().map(|squared| squared.sqrt()).collect(),
        shares,
        iterations,
    }
}

struct Graph<'a> {
    edges: Vec<&'a PoseEdge>,
    /// Block of each node that moves.
    block: Vec<Option<usize>>,
    /// Lowest block with which each block shares an edge.
    first: Vec<usize>,
    /// Squared displacement at which a switchable edge has a weight of a quarter.
    switch: f64,
}

impl<'a> Graph<'a> {
    fn new(nodes: usize, fixed: &[bool], edges: &'a [PoseEdge], switch: f64) -> Self {
        let exists = |edge: &&PoseEdge| {
            edge.source < nodes && edge.target < nodes && edge.source != edge.target
        };
        let edges: Vec<&PoseEdge> = edges.iter().filter(exists).collect();
        let mut block = vec![None; nodes];
        let mut next = 0;
        for (node, block) in block.iter_mut().enumerate() {
            if !fixed.get(node).copied().unwrap_or(false) {
                *block = Some(next);
                next += 1;
            }
        }
        let mut first: Vec<usize> = (0..next).collect();
        for edge in &edges {
            if let (Some(a), Some(b)) = (block[edge.source], block[edge.target]) {
                first[a.max(b)] = first[a.max(b)].min(a.min(b));
            }
        }
        Self {
            edges,
            block,
            first,
            switch,
        }
    }

    /// Returns the weight factor of an edge.
    fn share(&self, edge: &PoseEdge, squared: f64) -> f64 {
        if edge.switchable {
            (self.switch / (self.switch + squared)).powi(2)
        } else {
            1.0
        }
    }

    fn cost(&self, poses: &[Pose]) -> f64 {
        let of = |edge: &&PoseEdge| {
            let squared = squared_displacement(edge, poses)?;
            let loss = if edge.switchable {
                self.switch * squared / (self.switch + squared)
            } else {
                squared
            };
            Some(edge.weight * loss)
        };
        self.edges.iter().filter_map(of).sum()
    }

    fn step(&self, poses: &[Pose], damping: f64) -> Option<Vec<Column6>> {
        let mut matrix = Skyline::new(&self.first);
        let mut right = vec![[0.0; BLOCK]; self.first.len()];
        for edge in &self.edges {
            self.add(edge, poses, &mut matrix, &mut right);
        }
        for row in &mut matrix.rows {
            let Some(diagonal) = row.blocks.last_mut() else {
                continue;
            };
            let largest = (0..BLOCK).map(|i| diagonal[i][i]).fold(0.0, f64::max);
            for (i, column) in diagonal.iter_mut().enumerate() {
                column[i] += if largest > 0.0 {
                    damping * column[i] + 1e-9 * largest
                } else {
                    1.0
                };
            }
        }
        let step = solve(&mut matrix, &right)?;
        step.iter()
            .flatten()
            .all(|value| value.is_finite())
            .then_some(step)
    }

    /// Adds an edge to the normal equations.
    ///
    /// Its error changes by the target's step minus the source's step in the target's axes.
    fn add(&self, edge: &PoseEdge, poses: &[Pose], matrix: &mut Skyline, right: &mut [Column6]) {
        let current = poses[edge.target].compose(&poses[edge.source].inverse());
        let error = difference(&current, &edge.target_from_source);
        let weight = edge.weight * self.share(edge, quadratic(&edge.information, &error));
        let by_source = adjoint(&current);
        let pulled = times(&edge.information, &error);
        // Columns of the derivative by the source, times the information.
        let weighted: Block6 = by_source.map(|column| times(&edge.information, &column));
        if let Some(target) = self.block[edge.target] {
            accumulate(matrix, target, target, &edge.information, weight);
            subtract(&mut right[target], &pulled, weight);
        }
        if let Some(source) = self.block[edge.source] {
            let own: Block6 = weighted.map(|column| by_source.map(|other| dot(&other, &column)));
            accumulate(matrix, source, source, &own, weight);
            subtract(
                &mut right[source],
                &by_source.map(|column| dot(&column, &pulled)),
                -weight,
            );
        }
        if let (Some(target), Some(source)) = (self.block[edge.target], self.block[edge.source]) {
            // Rows are the target's, columns the source's; only the lower triangle is stored.
            let cross = if target > source {
                weighted
            } else {
                transposed(&weighted)
            };
            accumulate(
                matrix,
                target.max(source),
                target.min(source),
                &cross,
                -weight,
            );
        }
    }

    fn moved(&self, poses: &[Pose], step: &[Column6]) -> Vec<Pose> {
        let moved = |(pose, block): (&Pose, &Option<usize>)| {
            block.map_or(*pose, |block| exp(&step[block]).compose(pose))
        };
        poses.iter().zip(&self.block).map(moved).collect()
    }
}

fn accumulate(matrix: &mut Skyline, row: usize, column: usize, block: &Block6, weight: f64) {
    let row = &mut matrix.rows[row];
    let at = column - row.first;
    for (sum, values) in row.blocks[at]
        .as_flattened_mut()
        .iter_mut()
        .zip(block.as_flattened())
    {
        *sum += weight * values;
    }
}

fn subtract(sum: &mut Column6, values: &Column6, weight: f64) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum -= weight * value;
    }
}

fn transposed(block: &Block6) -> Block6 {
    std::array::from_fn(|row| std::array::from_fn(|column| block[column][row]))
}

/// Multiplies a symmetric block by a column.
fn times(block: &Block6, x: &Column6) -> Column6 {
    block.map(|column| dot(&column, x))
}

fn quadratic(block: &Block6, x: &Column6) -> f64 {
    dot(x, &times(block, x)).max(0.0)
}

/// Converts a small motion (rotation vector, then translation) to a pose.
fn exp(step: &Column6) -> Pose {
    let [a, b, c, x, y, z] = *step;
    Pose {
        rotation: DQuat::from_scaled_axis(DVec3::new(a, b, c)),
        translation: DVec3::new(x, y, z),
    }
}

/// Returns the motion δ with `to = exp(δ) · from`.
fn difference(to: &Pose, from: &Pose) -> Column6 {
    let movement = to.compose(&from.inverse());
    let rotation = if movement.rotation.w < 0.0 {
        -movement.rotation
    } else {
        movement.rotation
    };
    let (turn, shift) = (rotation.to_scaled_axis(), movement.translation);
    [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
}

/// Returns the matrix, by columns, that converts a small motion to the target's axes.
///
/// The motion is one of the source.
fn adjoint(target_from_source: &Pose) -> Block6 {
    let rotation = DMat3::from_quat(target_from_source.rotation);
    let shift = target_from_source.translation;
    let column = |i: usize| {
        let axis = rotation.col(i % 3);
        let (turn, moved) = if i < 3 {
            (axis, shift.cross(axis))
        } else {
            (DVec3::ZERO, axis)
        };
        [turn.x, turn.y, turn.z, moved.x, moved.y, moved.z]
    };
    std::array::from_fn(column)
}

/// Returns the mean squared displacement of an edge's points, in squared world units.
///
/// `None` if the edge does not connect two nodes.
fn squared_displacement(edge: &PoseEdge, poses: &[Pose]) -> Option<f64> {
    let current = poses
        .get(edge.target)?
        .compose(&poses.get(edge.source)?.inverse());
    Some(quadratic(
        &edge.information,
        &difference(&current, &edge.target_from_source),
    ))
}

#[cfg(test)]
mod tests;
