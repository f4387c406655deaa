use crate::masks::{LabelId, LabelTree};

/// Points with colour, normal, label and the share of the vote that the label won. All vectors have equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LabelledCloud {
    /// Positions in world units.
    pub positions: Vec<glam::Vec3>,
    /// Unit normals towards the cameras; zero = unknown.
    pub normals: Vec<glam::Vec3>,
    /// sRGB.
    pub colors: Vec<[u8; 3]>,
    /// The winner of the vote; 0 = unlabelled.
    pub labels: Vec<LabelId>,
    /// Share of the votes that the winner got, 0–1.
    pub confidence: Vec<f32>,
    /// Names, colours and parents of the labels.
    pub tree: LabelTree,
}

impl LabelledCloud {
    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }
}
