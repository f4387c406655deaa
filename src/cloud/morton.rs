/// Interleaves the lowest 21 bits of three numbers, with the last one in the lowest bit.
///
/// The result is the position along the Z-order curve (Morton, A computer oriented geodetic data
/// base, IBM 1966). Cells that are close in space are mostly close along the curve.
#[must_use]
pub fn morton(cell: [u64; 3]) -> u64 {
    let spread = |value: u64| {
        let mut bits = value & 0x1F_FFFF;
        for (shift, mask) in [
            (32, 0x001F_0000_0000_FFFF),
            (16, 0x001F_0000_FF00_00FF),
            (8, 0x100F_00F0_0F00_F00F),
            (4, 0x10C3_0C30_C30C_30C3),
            (2, 0x1249_2492_4924_9249),
        ] {
            bits = (bits | bits << shift) & mask;
        }
        bits
    };
    spread(cell[0]) << 2 | spread(cell[1]) << 1 | spread(cell[2])
}
