use super::block::{EDGE, ROWS};

/// Samples along an edge of a block with those of the next blocks that its cells need.
const SPAN: usize = EDGE + 1;

/// Which samples of a block some layer has behind a surface, and which before it: a bit for each of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Signs {
    pub(super) behind: [u8; ROWS],
    pub(super) before: [u8; ROWS],
}

/// The signs of a block and of the first samples of the blocks after it.
pub(super) struct SignsAround {
    behind: [u16; SPAN * SPAN],
    before: [u16; SPAN * SPAN],
}

impl SignsAround {
    /// `around`: the block itself and those after it, by their corner's number.
    pub(super) fn new(around: [Option<&Signs>; 8]) -> Self {
        let mut signs = Self {
            behind: [0; SPAN * SPAN],
            before: [0; SPAN * SPAN],
        };
        for row in 0..SPAN * SPAN {
            let (y, z) = (row % SPAN, row / SPAN);
            let block = (y / EDGE) << 1 | (z / EDGE) << 2;
            let at = (z % EDGE) * EDGE + y % EDGE;
            if let Some(here) = around[block] {
                signs.behind[row] = u16::from(here.behind[at]);
                signs.before[row] = u16::from(here.before[at]);
            }
            if let Some(next) = around[block | 1] {
                signs.behind[row] |= u16::from(next.behind[at] & 1) << EDGE;
                signs.before[row] |= u16::from(next.before[at] & 1) << EDGE;
            }
        }
        signs
    }

    /// For the samples of a row, along x, y and z, those between which and the next a surface may be.
    pub(super) fn edges(&self, row: usize) -> [u8; 3] {
        let at = row / EDGE * SPAN + row % EDGE;
        let (behind, before) = (self.behind[at], self.before[at]);
        let crossing = |(next_behind, next_before): (u16, u16)| {
            (behind & next_before | before & next_behind) as u8
        };
        let next_row = |step: usize| (self.behind[at + step], self.before[at + step]);
        [(behind >> 1, before >> 1), next_row(1), next_row(SPAN)].map(crossing)
    }

    /// The cells of a row through which a surface may go: all corners were seen, and on both sides of it.
    pub(super) fn cells(&self, row: usize) -> u8 {
        let at = row / EDGE * SPAN + row % EDGE;
        let rows = [at, at + 1, at + SPAN, at + SPAN + 1];
        let behind = rows.iter().fold(0, |all, &row| all | self.behind[row]);
        let before = rows.iter().fold(0, |all, &row| all | self.before[row]);
        let seen = rows.iter().fold(u16::MAX, |all, &row| {
            all & (self.behind[row] | self.before[row])
        });
        ((behind | behind >> 1) & (before | before >> 1) & seen & seen >> 1) as u8
    }
}
