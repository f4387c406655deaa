use glam::Vec2;

use super::plane::{Flow, Level, interpolated};

/// Weights of smoothness, of equal grey levels and of equal gradients.
const EVEN: f32 = 20.0;
const GREY: f32 = 5.0;
const SLOPE: f32 = 10.0;
/// Number of updates of the robust weights, and of sweeps per update.
const ROUNDS: usize = 3;
const SWEEPS: usize = 5;
/// Over-relaxation factor.
const OMEGA: f32 = 1.6;
/// Squared gradient, in grey levels per pixel, below which it counts as noise.
const NOISE_2: f32 = 0.01;
const EPSILON_2: f32 = 1e-6;

/// Refines a flow by minimizing a variational energy.
///
/// The energy has a smoothness term and data terms for equal grey levels and equal gradients at
/// both ends of each vector; all terms are robust. Source: Brox, Bruhn, Papenberg, Weickert, "High
/// accuracy optical flow estimation based on a theory for warping", ECCV 2004. The system is solved
/// by red-black successive over-relaxation.
pub(super) fn smoothed(from: &Level, to: &Level, flow: &Flow) -> Flow {
    let size = Size {
        width: flow.width,
        height: flow.height,
    };
    let slopes = Slopes::new(size, from, to, flow);
    let start = [
        size.framed(|at| flow.vectors[at].x),
        size.framed(|at| flow.vectors[at].y),
    ];
    let mut change = [vec![0.0; start[0].len()], vec![0.0; start[0].len()]];
    let mut edges = EdgeWeights {
        across: vec![0.0; start[0].len()],
        down: vec![0.0; start[0].len()],
    };
    let mut system = System::new(start[0].len());
    for _ in 0..ROUNDS {
        edges.weigh(size, &start, &change);
        system.set_up(size, &slopes, &edges, &start, &change);
        for sweep in 0..2 * SWEEPS {
            system.relax(size, &edges, &mut change, sweep % 2);
        }
    }
    let vector = |at: usize| {
        flow.vectors[at] + Vec2::new(change[0][size.place(at)], change[1][size.place(at)])
    };
    let vectors = (0..flow.vectors.len()).map(vector).collect();
    Flow {
        width: flow.width,
        height: flow.height,
        vectors,
    }
}

/// Size of a flow.
///
/// Planes over it have a border of one pixel, so every pixel has four neighbours.
#[derive(Clone, Copy)]
struct Size {
    width: usize,
    height: usize,
}

impl Size {
    fn stride(self) -> usize {
        self.width + 2
    }

    /// Converts a pixel's index in the image to its index in a bordered plane.
    fn place(self, at: usize) -> usize {
        (at / self.width + 1) * self.stride() + at % self.width + 1
    }

    /// Creates a plane with a border of zeros.
    fn framed(self, value: impl Fn(usize) -> f32) -> Vec<f32> {
        let mut plane = vec![0.0; self.stride() * (self.height + 2)];
        (0..self.width * self.height).for_each(|at| plane[self.place(at)] = value(at));
        plane
    }

    /// Returns the index of each row's first pixel, top to bottom.
    fn rows(self) -> impl Iterator<Item = usize> {
        (1..=self.height).map(move |y| y * self.stride() + 1)
    }

    /// Returns central differences of neighbours `step` places apart.
    ///
    /// At the border, the border pixel replaces the missing neighbour.
    fn slope(self, plane: &[f32], step: usize) -> Vec<f32> {
        let mut slope = vec![0.0; plane.len()];
        for (y, row) in self.rows().enumerate() {
            for (x, at) in (row..row + self.width).enumerate() {
                let first = if step == 1 { x == 0 } else { y == 0 };
                let last = if step == 1 {
                    x + 1 == self.width
                } else {
                    y + 1 == self.height
                };
                let before = if first { plane[at] } else { plane[at - step] };
                let after = if last { plane[at] } else { plane[at + step] };
                slope[at] = 0.5 * (after - before);
            }
        }
        slope
    }
}

/// First and second derivatives of the mean of both images, as bordered planes.
///
/// `t` is the temporal difference.
struct Slopes {
    x: Vec<f32>,
    y: Vec<f32>,
    t: Vec<f32>,
    xx: Vec<f32>,
    xy: Vec<f32>,
    yy: Vec<f32>,
    xt: Vec<f32>,
    yt: Vec<f32>,
}

impl Slopes {
    fn new(size: Size, from: &Level, to: &Level, flow: &Flow) -> Self {
        let here = |at: usize| from.at((at % size.width) as isize, (at / size.width) as isize);
        let there =
            |at: usize| interpolated(to, at % size.width, at / size.width, flow.vectors[at]);
        let (here, there) = (size.framed(here), size.framed(there));
        let mean: Vec<f32> = here
            .iter()
            .zip(&there)
            .map(|(a, b)| 0.5 * (a + b))
            .collect();
        let t: Vec<f32> = here.iter().zip(&there).map(|(a, b)| b - a).collect();
        let down = size.stride();
        let (x, y) = (size.slope(&mean, 1), size.slope(&mean, down));
        let (xx, xy, yy) = (
            size.slope(&x, 1),
            size.slope(&x, down),
            size.slope(&y, down),
        );
        let (xt, yt) = (size.slope(&t, 1), size.slope(&t, down));
        Self {
            x,
            y,
            t,
            xx,
            xy,
            yy,
            xt,
            yt,
        }
    }
}

/// Smoothness weights of the edges to the right and lower neighbour; 0 at the border.
struct EdgeWeights {
    across: Vec<f32>,
    down: Vec<f32>,
}

impl EdgeWeights {
    fn weigh(&mut self, size: Size, start: &[Vec<f32>; 2], change: &[Vec<f32>; 2]) {
        let stride = size.stride();
        for (y, row) in size.rows().enumerate() {
            let has_below = y + 1 < size.height;
            for (x, at) in (row..row + size.width).enumerate() {
                let has_right = x + 1 < size.width;
                let mut steep = EPSILON_2;
                for (start, change) in start.iter().zip(change) {
                    let here = start[at] + change[at];
                    let right = if has_right {
                        start[at + 1] + change[at + 1] - here
                    } else {
                        0.0
                    };
                    let below = if has_below {
                        start[at + stride] + change[at + stride] - here
                    } else {
                        0.0
                    };
                    steep += right * right + below * below;
                }
                let weight = EVEN / steep.sqrt();
                self.across[at] = if has_right { weight } else { 0.0 };
                self.down[at] = if has_below { weight } else { 0.0 };
            }
        }
    }

    /// Returns the weights of the row whose first pixel has index `first`.
    fn of_row(&self, size: Size, first: usize) -> Ties<'_> {
        let row = |from: usize| from..from + size.width;
        Ties {
            left: &self.across[row(first - 1)],
            right: &self.across[row(first)],
            above: &self.down[row(first - size.stride())],
            below: &self.down[row(first)],
        }
    }

    /// Sums the values of the four neighbours, weighted by their edges.
    #[inline]
    fn sum(&self, plane: &[f32], at: usize, stride: usize) -> f32 {
        self.across[at - 1] * plane[at - 1]
            + self.across[at] * plane[at + 1]
            + self.down[at - stride] * plane[at - stride]
            + self.down[at] * plane[at + stride]
    }
}

/// Two linear equations per pixel for its flow increment.
struct System {
    xy: Vec<f32>,
    /// Reciprocal of the diagonal.
    inverse: [Vec<f32>; 2],
    right: [Vec<f32>; 2],
}

impl System {
    fn new(places: usize) -> Self {
        let plane = || vec![0.0; places];
        Self {
            xy: plane(),
            inverse: [plane(), plane()],
            right: [plane(), plane()],
        }
    }

    /// Sets up the equations with the robust weights at the current increment.
    fn set_up(
        &mut self,
        size: Size,
        s: &Slopes,
        edges: &EdgeWeights,
        start: &[Vec<f32>; 2],
        change: &[Vec<f32>; 2],
    ) {
        let stride = size.stride();
        for row in size.rows() {
            for at in row..row + size.width {
                let (u, v) = (change[0][at], change[1][at]);
                let (x, y, t) = (s.x[at], s.y[at], s.t[at]);
                let (xx, xy, yy, xt, yt) = (s.xx[at], s.xy[at], s.yy[at], s.xt[at], s.yt[at]);
                let norm = 1.0 / (x * x + y * y + NOISE_2);
                let miss = t + x * u + y * v;
                let grey = GREY * norm / (miss * miss * norm + EPSILON_2).sqrt();
                let (norm_x, norm_y) = (
                    1.0 / (xx * xx + xy * xy + NOISE_2),
                    1.0 / (yy * yy + xy * xy + NOISE_2),
                );
                let (miss_x, miss_y) = (xt + xx * u + xy * v, yt + xy * u + yy * v);
                let slope = SLOPE
                    / (miss_x * miss_x * norm_x + miss_y * miss_y * norm_y + EPSILON_2).sqrt();
                let (a, b) = (slope * norm_x, slope * norm_y);
                let even = edges.across[at - 1]
                    + edges.across[at]
                    + edges.down[at - stride]
                    + edges.down[at];
                self.xy[at] = grey * x * y + a * xx * xy + b * xy * yy;
                self.inverse[0][at] = 1.0 / (grey * x * x + a * xx * xx + b * xy * xy + even);
                self.inverse[1][at] = 1.0 / (grey * y * y + a * xy * xy + b * yy * yy + even);
                let pull = |plane: &[f32]| edges.sum(plane, at, stride) - even * plane[at];
                self.right[0][at] = pull(&start[0]) - grey * x * t - a * xx * xt - b * xy * yt;
                self.right[1][at] = pull(&start[1]) - grey * y * t - a * xy * xt - b * yy * yt;
            }
        }
    }

    /// Half a sweep: updates the pixels of one colour.
    fn relax(&self, size: Size, edges: &EdgeWeights, change: &mut [Vec<f32>; 2], colour: usize) {
        let [us, vs] = change;
        for (y, first) in size.rows().enumerate() {
            let here = first..first + size.width;
            let row = |component: usize| RowEquations {
                xy: &self.xy[here.clone()],
                inverse: &self.inverse[component][here.clone()],
                right: &self.right[component][here.clone()],
                ties: edges.of_row(size, first),
            };
            row(0).relax(us, &vs[here.clone()], first, (y + colour) % 2);
            row(1).relax(vs, &us[here.clone()], first, (y + colour) % 2);
        }
    }
}

/// Weights of the edges from the pixels of one row to their neighbours.
struct Ties<'a> {
    left: &'a [f32],
    right: &'a [f32],
    above: &'a [f32],
    below: &'a [f32],
}

/// Equations of one row in one component of the increment.
struct RowEquations<'a> {
    xy: &'a [f32],
    inverse: &'a [f32],
    right: &'a [f32],
    ties: Ties<'a>,
}

impl RowEquations<'_> {
    /// Updates every other pixel from `start` on.
    ///
    /// The row's first pixel has index `first` in the bordered plane.
    fn relax(&self, plane: &mut [f32], other: &[f32], first: usize, start: usize) {
        let width = self.right.len();
        let stride = width + 2;
        let (above, rest) = plane.split_at_mut(first - 1);
        let (here, below) = rest.split_at_mut(stride);
        let (above, below) = (
            &above[first - stride..first - stride + width],
            &below[1..=width],
        );
        for x in (start..width).step_by(2) {
            let adjacent = self.ties.left[x] * here[x] + self.ties.right[x] * here[x + 2];
            let over = self.ties.above[x] * above[x] + self.ties.below[x] * below[x];
            let solved =
                (self.right[x] + adjacent + over - self.xy[x] * other[x]) * self.inverse[x];
            here[x + 1] += OMEGA * (solved - here[x + 1]);
        }
    }
}
