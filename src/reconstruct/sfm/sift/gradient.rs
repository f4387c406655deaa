use super::rows::Rows;

/// Most samples of a row that a keypoint's surroundings span.
pub(super) const MOST_COLUMNS: usize = 256;

/// Gradients of a stretch of a row.
pub(super) struct GradientRow {
    /// Length, in grey per sample.
    pub length: [f32; MOST_COLUMNS],
    /// Direction in turns, 0..1, from the x axis towards the y axis.
    pub turn: [f32; MOST_COLUMNS],
}

impl GradientRow {
    pub fn new() -> Self {
        Self {
            length: [0.0; MOST_COLUMNS],
            turn: [0.0; MOST_COLUMNS],
        }
    }

    /// Fills in the central differences at columns `first..=last` of row `y`, all inside the picture's border.
    #[inline(always)]
    pub fn fill(&mut self, level: &Rows, y: usize, first: usize, last: usize) {
        let [above, below] = [level.row(y - 1), level.row(y + 1)].map(|row| &row[first..=last]);
        let row = level.row(y);
        let (left, right) = (&row[first - 1..last], &row[first + 1..last + 2]);
        let out = self.length.iter_mut().zip(&mut self.turn);
        let across = right.iter().zip(left);
        let down = below.iter().zip(above);
        for ((length, turn), ((right, left), (below, above))) in out.zip(across.zip(down)) {
            let (dx, dy) = (0.5 * (right - left), 0.5 * (below - above));
            *length = (dx * dx + dy * dy).sqrt();
            *turn = turn_of(dx, dy);
        }
    }
}

/// The direction of (dx, dy) in turns, 0..1, to 2e-6: the polynomial of Abramowitz and Stegun, "Handbook of Mathematical
/// Functions", 1964, 4.4.47. Without branches, so that it is vectorised.
#[inline(always)]
pub(super) fn turn_of(dx: f32, dy: f32) -> f32 {
    const COEFFICIENTS: [f32; 5] = [0.999_866, -0.330_299_5, 0.180_141, -0.085_133, 0.020_835_1];
    let (ax, ay) = (dx.abs(), dy.abs());
    let (small, large) = if ax < ay { (ax, ay) } else { (ay, ax) };
    let ratio = small / (large + f32::MIN_POSITIVE);
    let square = ratio * ratio;
    let [a, b, c, d, e] = COEFFICIENTS;
    let angle = ratio * (a + square * (b + square * (c + square * (d + square * e))));
    let turn = angle * (0.5 * std::f32::consts::FRAC_1_PI);
    let turn = if ax < ay { 0.25 - turn } else { turn };
    let turn = if dx < 0.0 { 0.5 - turn } else { turn };
    if dy < 0.0 { 1.0 - turn } else { turn }
}
