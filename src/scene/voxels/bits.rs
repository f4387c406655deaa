/// A box of cells, a bit for each: rows along x, then y, then z.
#[derive(Debug, Clone)]
pub(super) struct Bits {
    size: [usize; 3],
    words: Vec<u64>,
}

impl Bits {
    /// All clear; `None` where that takes more than `most_bytes`.
    pub(super) fn new(size: [usize; 3], most_bytes: usize) -> Option<Self> {
        let words = size[0].div_ceil(64).checked_mul(size[1])?.checked_mul(size[2])?;
        (words.checked_mul(8)? <= most_bytes).then(|| Self { size, words: vec![0; words] })
    }

    /// Takes all cells out.
    pub(super) fn clear(&mut self) {
        self.words.fill(0);
    }

    fn words_a_row(&self) -> usize {
        self.size[0].div_ceil(64)
    }

    fn word_of(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.words_a_row() + x / 64
    }

    pub(super) fn set(&mut self, cell: [usize; 3]) {
        let word = self.word_of(cell);
        self.words[word] |= 1 << (cell[0] % 64);
    }

    pub(super) fn is_set(&self, cell: [usize; 3]) -> bool {
        self.words[self.word_of(cell)] >> (cell[0] % 64) & 1 != 0
    }

    /// The cells of a word whose bits these are.
    pub(super) fn cells(&self, word: usize, mut bits: u64) -> impl Iterator<Item = [usize; 3]> {
        let (row, first) = (word / self.words_a_row(), word % self.words_a_row() * 64);
        let (y, z) = (row % self.size[1], row / self.size[1]);
        std::iter::from_fn(move || {
            let cell = (bits != 0).then(|| [first + bits.trailing_zeros() as usize, y, z]);
            bits &= bits.wrapping_sub(1);
            cell
        })
    }

    /// The cells of a word that neither this set nor another of the same box has.
    pub(super) fn in_neither(&self, other: &Self, word: usize) -> u64 {
        self.within(word) & !self.words[word] & !other.words[word]
    }

    /// The words with a cell that neither this set nor another of the same box has.
    pub(super) fn words_in_neither(&self, other: &Self) -> Vec<usize> {
        (0..self.words.len()).filter(|&word| self.in_neither(other, word) != 0).collect()
    }

    /// The bits of a word that are cells of the box.
    fn within(&self, word: usize) -> u64 {
        let left = self.size[0] - word % self.words_a_row() * 64;
        if left < 64 { (1 << left) - 1 } else { u64::MAX }
    }

    /// Adds to this set the cells given, by word, and all that can be reached from them over faces of cells outside `walls`.
    pub(super) fn flood(&mut self, walls: &Self, from: impl IntoIterator<Item = (usize, u64)>) {
        let mut entered: Vec<(usize, u64)> = from.into_iter().collect();
        let row = self.words_a_row();
        let layer = row * self.size[1];
        while let Some((word, bits)) = entered.pop() {
            let open = self.within(word) & !walls.words[word];
            let new = spread(bits & open, open) & !self.words[word];
            if new == 0 {
                continue;
            }
            self.words[word] |= new;
            let (x, y) = (word % row, word / row % self.size[1]);
            let mut enter = |next: usize, bits: u64| {
                let bits = bits & !self.words[next] & !walls.words[next];
                if bits != 0 {
                    entered.push((next, bits));
                }
            };
            if x > 0 {
                enter(word - 1, new << 63);
            }
            if x + 1 < row {
                enter(word + 1, new >> 63);
            }
            if y > 0 {
                enter(word - row, new);
            }
            if y + 1 < self.size[1] {
                enter(word + row, new);
            }
            if word >= layer {
                enter(word - layer, new);
            }
            if word + layer < self.words.len() {
                enter(word + layer, new);
            }
        }
    }
}

/// All bits of `open` in one run with a bit of `from`, which is part of it.
fn spread(from: u64, open: u64) -> u64 {
    let (mut up, mut room) = (from, open);
    for step in [1, 2, 4, 8, 16, 32] {
        up |= room & (up << step);
        room &= room << step;
    }
    let (mut all, mut room) = (up, open);
    for step in [1, 2, 4, 8, 16, 32] {
        all |= room & (all >> step);
        room &= room >> step;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_filled_from_any_bit() {
        let open = 0b0111_0110_1110_u64 | 0xff << 50;
        assert_eq!(spread(0b0000_0100_0000, open), 0b0000_0110_0000);
        assert_eq!(spread(1 << 57 | 1 << 1, open), 0xff << 50 | 0b1110);
        assert_eq!(spread(1 << 63, u64::MAX), u64::MAX);
        assert_eq!(spread(0, u64::MAX), 0);
    }

    #[test]
    fn a_flood_goes_round_walls_but_not_through_their_edges() {
        // A diagonal wall of cells that touch by their edges only, over several words, with a way round at one end.
        let size = [150, 150, 2];
        let mut walls = Bits::new(size, usize::MAX).unwrap();
        for at in 0..150 {
            (0..2).for_each(|z| walls.set([at, at, z]));
        }
        let flooded = |walls: &Bits| {
            let mut reached = Bits::new(size, usize::MAX).unwrap();
            reached.flood(walls, [(0, 2)]);
            reached
        };
        let closed = flooded(&walls);
        assert!(closed.is_set([149, 0, 1]) && closed.is_set([2, 1, 0]));
        assert!(!closed.is_set([0, 149, 1]) && !closed.is_set([77, 77, 0]));
        let hole = walls.word_of([149, 149, 1]);
        walls.words[hole] = 0;
        let open = flooded(&walls);
        assert!(open.is_set([0, 149, 1]) && open.is_set([0, 149, 0]) && !open.is_set([149, 149, 0]));
    }

    #[test]
    fn a_box_beyond_its_memory_is_none() {
        assert!(Bits::new([64, 10, 10], 800).is_some());
        assert!(Bits::new([65, 10, 10], 800).is_none());
        assert!(Bits::new([usize::MAX; 3], usize::MAX).is_none());
    }
}
