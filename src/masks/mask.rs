use serde::{Deserialize, Serialize};

use super::LabelId;

/// A label for every pixel of one frame, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LabelMask {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` ids; 0 = nothing.
    pub ids: Vec<LabelId>,
}

/// The pixels of one object on one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Region {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` flags, row by row.
    pub inside: Vec<bool>,
}

/// A [`LabelMask`] as runs of equal ids, row by row without a break between rows: what a project holds and keeps in
/// its history.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunMask {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// (id, length) of each run; lengths are above 0 and sum to `width · height`; neighbours differ in id.
    pub runs: Vec<(LabelId, u32)>,
}

impl LabelMask {
    /// A mask with no label anywhere.
    #[must_use]
    pub fn empty(width: u32, height: u32) -> Self {
        Self { width, height, ids: vec![LabelId::NONE; width as usize * height as usize] }
    }

    /// The id in column `x`, row `y`.
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> LabelId {
        self.ids[y as usize * self.width as usize + x as usize]
    }

    /// The pixels of one label.
    #[must_use]
    pub fn region(&self, id: LabelId) -> Region {
        Region { width: self.width, height: self.height, inside: self.ids.iter().map(|&at| at == id).collect() }
    }
}

impl Region {
    /// A region without pixels.
    #[must_use]
    pub fn empty(width: u32, height: u32) -> Self {
        Self { width, height, inside: vec![false; width as usize * height as usize] }
    }

    /// Whether column `x`, row `y` is inside.
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> bool {
        self.inside[y as usize * self.width as usize + x as usize]
    }

    /// Number of pixels inside.
    #[must_use]
    pub fn area(&self) -> usize {
        self.inside.iter().filter(|&&inside| inside).count()
    }
}

impl RunMask {
    /// Run-length encodes a mask.
    #[must_use]
    pub fn encode(mask: &LabelMask) -> Self {
        let runs = mask.ids.chunk_by(|a, b| a == b).map(|run| (run[0], run.len() as u32)).collect();
        Self { width: mask.width, height: mask.height, runs }
    }

    /// The mask as pixels.
    #[must_use]
    pub fn decode(&self) -> LabelMask {
        let mut ids = Vec::with_capacity(self.width as usize * self.height as usize);
        for &(id, length) in &self.runs {
            ids.resize(ids.len() + length as usize, id);
        }
        LabelMask { width: self.width, height: self.height, ids }
    }
}
