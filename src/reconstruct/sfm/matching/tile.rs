//! Dot products of a few descriptors with a panel of others, as long as registers last.

/// Columns processed together.
pub(crate) const LANES: usize = 16;
/// Rows processed together: with [`LANES`] columns their sums fill twelve of AVX2's sixteen registers.
pub(crate) const ROWS: usize = 6;

/// Computes the dot products of some rows with the columns of a panel.
///
/// `FUSED` is set if the processor multiplies and adds in one instruction; otherwise `mul_add`
/// would be a slow function call.
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

/// Two neighbouring bytes of a descriptor as 16-bit numbers.
///
/// Their products are added in one instruction, which does twice the work of one on floats. Sums
/// of products of bytes are exact either way, so that floats would give the same.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct BytePair(pub [i16; 2]);

impl BytePair {
    /// Passes the pairs of some bytes to `put`, with their numbers; a missing second byte is 0.
    #[inline(always)]
    pub fn each_of(bytes: &[u8], mut put: impl FnMut(usize, Self)) {
        let (pairs, rest) = bytes.as_chunks::<2>();
        for (k, &[a, b]) in pairs.iter().enumerate() {
            put(k, Self([i16::from(a), i16::from(b)]));
        }
        if let [last] = rest {
            put(pairs.len(), Self([i16::from(*last), 0]));
        }
    }
}

/// Computes the dot products of some rows with the columns of a panel, both in pairs of bytes.
#[inline(always)]
pub(crate) fn byte_tile(
    rows: [&[BytePair]; ROWS],
    panel: &[[BytePair; LANES]],
) -> [[i32; LANES]; ROWS] {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        return avx2_byte_tile(simd, rows, panel);
    }
    plain_byte_tile(rows, panel)
}

#[inline(always)]
fn plain_byte_tile(rows: [&[BytePair]; ROWS], panel: &[[BytePair; LANES]]) -> [[i32; LANES]; ROWS] {
    let mut sums = [[0; LANES]; ROWS];
    for (k, column) in panel.iter().enumerate() {
        for (sum, row) in sums.iter_mut().zip(rows) {
            let [a, b] = row[k].0.map(i32::from);
            for (sum, BytePair([c, d])) in sum.iter_mut().zip(column) {
                *sum += a * i32::from(*c) + b * i32::from(*d);
            }
        }
    }
    sums
}

/// Pairs of bytes, and sums, in one register of AVX2.
#[cfg(target_arch = "x86_64")]
const HALF: usize = LANES / 2;
/// Rows whose sums stay in registers, with a column and a row of pairs and their products.
#[cfg(target_arch = "x86_64")]
const GROUP: usize = ROWS / 2;

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn avx2_byte_tile(
    simd: pulp::x86::V3,
    rows: [&[BytePair]; ROWS],
    panel: &[[BytePair; LANES]],
) -> [[i32; LANES]; ROWS] {
    let [a, b, c, d, e, f] = rows;
    let [a, b, c] = avx2_byte_group(simd, [a, b, c], panel);
    let [d, e, f] = avx2_byte_group(simd, [d, e, f], panel);
    [a, b, c, d, e, f]
}

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn avx2_byte_group(
    simd: pulp::x86::V3,
    rows: [&[BytePair]; GROUP],
    panel: &[[BytePair; LANES]],
) -> [[i32; LANES]; GROUP] {
    use pulp::{Simd as _, i16x16};
    let rows = rows.map(|row| &row[..panel.len()]);
    let mut sums = [[simd.splat_u32s(0); 2]; GROUP];
    for (k, column) in panel.iter().enumerate() {
        let column: [i16x16; 2] = pulp::cast(*column);
        for (sum, row) in sums.iter_mut().zip(rows) {
            let pair: i16x16 = pulp::cast([row[k]; HALF]);
            for (sum, column) in sum.iter_mut().zip(column) {
                let products = simd.multiply_wrapping_add_adjacent_i16x16(pair, column);
                *sum = simd.add_u32s(*sum, pulp::cast(products));
            }
        }
    }
    sums.map(pulp::cast)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn products_of_bytes_are_exact() {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        for dim in [128, 127, 1] {
            let mut bytes = |count: usize| -> Vec<Vec<u8>> {
                (0..count)
                    .map(|_| (0..dim).map(|_| random.random()).collect())
                    .collect()
            };
            let (mut firsts, seconds) = (bytes(ROWS), bytes(LANES));
            firsts[0].fill(255);
            let pairs = |bytes: &Vec<u8>| {
                let mut pairs = Vec::new();
                BytePair::each_of(bytes, |_, pair| pairs.push(pair));
                pairs
            };
            let rows: Vec<Vec<BytePair>> = firsts.iter().map(pairs).collect();
            let columns: Vec<Vec<BytePair>> = seconds.iter().map(pairs).collect();
            let panel: Vec<[BytePair; LANES]> = (0..rows[0].len())
                .map(|k| std::array::from_fn(|lane| columns[lane][k]))
                .collect();
            let rows = std::array::from_fn(|row| &rows[row][..]);
            let (fast, plain) = (byte_tile(rows, &panel), plain_byte_tile(rows, &panel));
            assert_eq!(fast, plain);
            for (row, first) in firsts.iter().enumerate() {
                for (lane, second) in seconds.iter().enumerate() {
                    let exact: i32 = first
                        .iter()
                        .zip(second)
                        .map(|(&a, &b)| i32::from(a) * i32::from(b))
                        .sum();
                    assert_eq!(fast[row][lane], exact);
                }
            }
        }
    }
}
