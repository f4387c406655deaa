/// A bit set over a box of cells; x runs fastest, then y, then z.
#[derive(Debug, Clone)]
pub(super) struct Bits {
    size: [usize; 3],
    words: Vec<u64>,
}

impl Bits {
    /// Creates an empty set, or returns `None` if it needs more than `most_bytes`.
    pub(super) fn new(size: [usize; 3], most_bytes: usize) -> Option<Self> {
        let words = size[0]
            .div_ceil(64)
            .checked_mul(size[1])?
            .checked_mul(size[2])?;
        (words.checked_mul(8)? <= most_bytes).then(|| Self {
            size,
            words: vec![0; words],
        })
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

    /// Returns the cells of a word that correspond to the given bits.
    pub(super) fn cells(&self, word: usize, mut bits: u64) -> impl Iterator<Item = [usize; 3]> {
        let (row, first) = (word / self.words_a_row(), word % self.words_a_row() * 64);
        let (y, z) = (row % self.size[1], row / self.size[1]);
        std::iter::from_fn(move || {
            let cell = (bits != 0).then(|| [first + bits.trailing_zeros() as usize, y, z]);
            bits &= bits.wrapping_sub(1);
            cell
        })
    }

    /// Returns the bits of a word of the set.
    pub(super) fn bits(&self, word: usize) -> u64 {
        self.words[word]
    }

    /// Returns the indices of the non-zero words.
    pub(super) fn words(&self) -> Vec<usize> {
        (0..self.words.len())
            .filter(|&word| self.words[word] != 0)
            .collect()
    }

    /// Moves cells of a word to another set of the same box.
    pub(super) fn shift(&mut self, word: usize, bits: u64, to: &mut Self) {
        to.words[word] |= self.words[word] & bits;
        self.words[word] &= !bits;
    }

    /// Returns the empty set of the same box.
    pub(super) fn none(&self) -> Self {
        Self {
            size: self.size,
            words: vec![0; self.words.len()],
        }
    }

    /// Returns the complement of this set within the box.
    pub(super) fn others(&self) -> Self {
        let words = (0..self.words.len())
            .map(|word| self.within(word) & !self.words[word])
            .collect();
        Self {
            size: self.size,
            words,
        }
    }

    /// Returns the bits of a word that are cells of the box.
    fn within(&self, word: usize) -> u64 {
        let left = self.size[0] - word % self.words_a_row() * 64;
        if left < 64 { (1 << left) - 1 } else { u64::MAX }
    }

    /// Repeatedly removes cells that are open in two or more of the six directions along the axes.
    ///
    /// A direction is closed if it leads to a wall through cells of the set only.
    pub(super) fn keep_enclosed(&mut self, walls: &Self) {
        loop {
            let (mut once, mut twice) = (vec![0; self.words.len()], vec![0; self.words.len()]);
            for axis in 0..3 {
                for closed in [
                    self.closed_before(axis, walls),
                    self.closed_after(axis, walls),
                ] {
                    for (word, closed) in closed.into_iter().enumerate() {
                        let open = self.words[word] & !closed;
                        twice[word] |= once[word] & open;
                        once[word] |= open;
                    }
                }
            }
            if twice.iter().all(|&bits| bits == 0) {
                return;
            }
            self.words
                .iter_mut()
                .zip(twice)
                .for_each(|(word, open)| *word &= !open);
        }
    }

    /// Returns the cells of the set that are closed in the negative direction of an axis.
    fn closed_before(&self, axis: usize, walls: &Self) -> Vec<u64> {
        let mut closed = vec![0; self.words.len()];
        for word in 0..closed.len() {
            let before = self
                .next_before(axis, word)
                .map_or(0, |before| walls.words[before] | closed[before]);
            closed[word] = match axis {
                0 => spread_up(
                    self.words[word] & (walls.words[word] << 1 | before >> 63),
                    self.words[word],
                ),
                _ => self.words[word] & before,
            };
        }
        closed
    }

    /// Returns the cells of the set that are closed in the positive direction of an axis.
    fn closed_after(&self, axis: usize, walls: &Self) -> Vec<u64> {
        let mut closed = vec![0; self.words.len()];
        for word in (0..closed.len()).rev() {
            let after = self
                .next_after(axis, word)
                .map_or(0, |after| walls.words[after] | closed[after]);
            closed[word] = match axis {
                0 => spread_down(
                    self.words[word] & (walls.words[word] >> 1 | after << 63),
                    self.words[word],
                ),
                _ => self.words[word] & after,
            };
        }
        closed
    }

    /// Returns the position of a word along an axis, and the index step to the next word.
    fn place(&self, axis: usize, word: usize) -> (usize, usize) {
        let row = self.words_a_row();
        match axis {
            0 => (word % row, 1),
            1 => (word / row % self.size[1], row),
            _ => (word / row / self.size[1], row * self.size[1]),
        }
    }

    fn next_before(&self, axis: usize, word: usize) -> Option<usize> {
        let (at, step) = self.place(axis, word);
        (at > 0).then(|| word - step)
    }

    fn next_after(&self, axis: usize, word: usize) -> Option<usize> {
        let (at, step) = self.place(axis, word);
        let count = if axis == 0 {
            self.words_a_row()
        } else {
            self.size[axis]
        };
        (at + 1 < count).then_some(word + step)
    }
}

/// Returns the bits `from` and all higher bits connected to them within `room`.
fn spread_up(mut from: u64, mut room: u64) -> u64 {
    for step in [1, 2, 4, 8, 16, 32] {
        from |= room & (from << step);
        room &= room << step;
    }
    from
}

/// Returns the bits `from` and all lower bits connected to them within `room`.
fn spread_down(mut from: u64, mut room: u64) -> u64 {
    for step in [1, 2, 4, 8, 16, 32] {
        from |= room & (from >> step);
        room &= room >> step;
    }
    from
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_filled_in_one_direction() {
        let room = 0b0111_0110_1110_u64 | 0xff << 50;
        assert_eq!(spread_up(0b0000_0010_0000, room), 0b0000_0110_0000);
        assert_eq!(spread_down(1 << 57 | 1 << 2, room), 0xff << 50 | 0b0110);
        assert_eq!(spread_up(1, u64::MAX), u64::MAX);
        assert_eq!(spread_down(1 << 63, u64::MAX), u64::MAX);
    }

    /// Counts the enclosed cells of a hollow block over several words, with walls on some sides.
    ///
    /// The block extends from 2 to 99 along x and from 2 to 9 along y and z.
    fn kept(sides: &[usize]) -> u32 {
        let size = [102, 12, 12];
        let mut walls = Bits::new(size, usize::MAX).unwrap();
        for z in 1..=10 {
            for y in 1..=10 {
                for x in 1..=100 {
                    let on = [x == 1, x == 100, y == 1, y == 10, z == 1, z == 10];
                    if sides.iter().any(|&side| on[side]) {
                        walls.set([x, y, z]);
                    }
                }
            }
        }
        let mut enclosed = walls.others();
        enclosed.keep_enclosed(&walls);
        enclosed.words.iter().map(|word| word.count_ones()).sum()
    }

    #[test]
    fn cells_walled_on_five_sides_are_enclosed() {
        let inner = 98 * 8 * 8;
        assert_eq!(kept(&[0, 1, 2, 3, 4, 5]), inner);
        for open in 0..6 {
            let sides: Vec<usize> = (0..6).filter(|&side| side != open).collect();
            assert!(kept(&sides) >= inner, "side {open}");
        }
        assert_eq!(kept(&[0, 2, 4, 5]), 0);
        assert_eq!(kept(&[0, 1, 2]), 0);
    }

    #[test]
    fn box_beyond_its_memory_limit_is_none() {
        assert!(Bits::new([64, 10, 10], 800).is_some());
        assert!(Bits::new([65, 10, 10], 800).is_none());
        assert!(Bits::new([usize::MAX; 3], usize::MAX).is_none());
    }
}
