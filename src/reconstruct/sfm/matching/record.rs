/// The nearest descriptor seen so far, and whether another one is nearly as near.
///
/// The second nearest itself is not kept: once it spoils the ratio only a nearer one can matter, and that turns the
/// present nearest into the second. So the bar for further scores stands as high as it can without changing a result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Record {
    /// Dot product with the nearest, of unit vectors.
    best: f32,
    /// Its index; [`NOBODY`] before the first.
    index: u32,
    /// Whether the second nearest spoils it.
    ambiguous: bool,
}

const NOBODY: u32 = u32::MAX;

/// What makes a nearest neighbour a match.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rule {
    /// 1 / ratio² − 1; 0 = seconds do not matter.
    excess: f32,
    /// Dot products of matches are larger.
    floor: f32,
}

impl Rule {
    /// Distance to the nearest < `ratio` (0..1; 1 = any) · distance to the second nearest, and dot product > `floor`.
    pub fn new(ratio: f32, floor: f32) -> Self {
        Self {
            excess: 1.0 / (ratio * ratio).clamp(1e-6, 1.0) - 1.0,
            floor,
        }
    }

    /// The dot product from which on a second spoils a best: |a − b|² = 2 − 2 a·b for unit vectors.
    #[inline(always)]
    fn rival(self, best: f32) -> f32 {
        best - (1.0 - best).max(0.0) * self.excess
    }

    #[inline(always)]
    fn spoils(self, best: f32, second: f32) -> bool {
        self.excess > 0.0 && second >= self.rival(best)
    }

    /// Before anything was seen.
    pub fn blank(self) -> Record {
        Record {
            best: self.rival(self.floor),
            index: NOBODY,
            ambiguous: true,
        }
    }

    /// Scores below this one change nothing.
    #[inline(always)]
    pub fn bar(self, record: Record) -> f32 {
        if record.ambiguous {
            record.best
        } else {
            self.rival(record.best)
        }
    }

    /// The record after one more score, in whichever order they come; the lower index wins a tie. The nearest may come
    /// again.
    #[inline(always)]
    pub fn after(self, record: Record, score: f32, index: u32) -> Record {
        if index == record.index {
            return record;
        }
        if score > record.best {
            let ambiguous = record.index != NOBODY && self.spoils(score, record.best);
            return Record {
                best: score,
                index,
                ambiguous,
            };
        }
        let index = if score == record.best {
            index.min(record.index)
        } else {
            record.index
        };
        Record {
            index,
            ambiguous: record.ambiguous || self.spoils(record.best, score),
            ..record
        }
    }

    /// The match, if the record holds one.
    pub fn accepted(self, record: Record) -> Option<u32> {
        (record.index != NOBODY && !record.ambiguous && record.best > self.floor)
            .then_some(record.index)
    }
}
