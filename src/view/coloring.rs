use std::collections::BTreeSet;

use crate::masks::{LabelId, LabelTree};
use crate::scene::LabelledCloud;

/// What a point's colour shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Coloring {
    /// The colour of the pictures.
    #[default]
    Rgb,
    /// The colour of its label; unlabelled points grey.
    Label,
    /// The share of the vote its label won: dark violet (0) over green to yellow (1).
    Confidence,
}

/// Label colours by id, ready for loops over millions of points or pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct LabelColors {
    /// `None` = hidden; ids beyond the end belong to no label.
    by_id: Vec<Option<[u8; 3]>>,
}

impl LabelColors {
    /// Colours of all labels but those hidden (with all below them).
    pub(super) fn new(tree: &LabelTree, hidden: &BTreeSet<LabelId>) -> Self {
        let count = tree.next_id().0;
        let color = |id| {
            let drawn = !hidden.contains(&id) && !tree.path(id).iter().any(|id| hidden.contains(id));
            drawn.then(|| tree.get(id).map_or(UNLABELLED, |label| label.color))
        };
        Self { by_id: (0..count).map(|id| color(LabelId(id))).collect() }
    }

    /// The label's colour, grey for none; `None` when it is hidden.
    pub(super) fn get(&self, id: LabelId) -> Option<[u8; 3]> {
        self.by_id.get(usize::from(id.0)).copied().unwrap_or(Some(UNLABELLED))
    }
}

const UNLABELLED: [u8; 3] = [120, 120, 120];

/// The sRGB colour of point `index`; `None` when its label is hidden.
pub(super) fn point_color(
    cloud: &LabelledCloud,
    index: usize,
    coloring: Coloring,
    labels: &LabelColors,
) -> Option<[u8; 3]> {
    let label_color = labels.get(cloud.labels[index])?;
    Some(match coloring {
        Coloring::Rgb => cloud.colors[index],
        Coloring::Label => label_color,
        Coloring::Confidence => ramp(cloud.confidence[index]),
    })
}

/// A perceptually ordered ramp through five stops (violet, blue, green, lime, yellow): sRGB for a share from 0 to 1.
#[must_use]
pub fn ramp(share: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];
    let at = share.clamp(0.0, 1.0) * 4.0;
    let low = (at as usize).min(3);
    let t = at - low as f32;
    std::array::from_fn(|c| (STOPS[low][c] * (1.0 - t) + STOPS[low + 1][c] * t) as u8)
}
