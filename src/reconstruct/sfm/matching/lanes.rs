/// Columns that are worked on together.
pub(crate) const LANES: usize = 16;
/// Rows that are worked on together: with [`LANES`] columns their sums fill twelve of AVX2's sixteen registers.
pub(crate) const ROWS: usize = 6;

/// Dot products of some rows with the columns of a panel. `FUSED` where the processor multiplies and adds in one
/// instruction; without one, `mul_add` would be a slow function call.
#[inline(always)]
pub(crate) fn tile<const FUSED: bool>(
    rows: [&[f32]; ROWS],
    panel: &[[f32; LANES]],
) -> [[f32; LANES]; ROWS] {
    let rows = rows.map(|row| &row[..panel.len()]);
    let mut sums = [[0.0; LANES]; ROWS];
    for (k, column) in panel.iter().enumerate() {
        for (sum, row) in sums.iter_mut().zip(rows) {
            for (sum, value) in sum.iter_mut().zip(column) {
                *sum = if FUSED {
                    row[k].mul_add(*value, *sum)
                } else {
                    row[k] * value + *sum
                };
            }
        }
    }
    sums
}
