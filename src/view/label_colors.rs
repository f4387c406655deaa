use super::Appearance;
use ostra_masks::{LabelId, LabelTree};

/// Colour of what has no label or no known value (sRGB).
pub(super) const UNKNOWN: [u8; 3] = [120, 120, 120];

/// Colour and opacity by label, ready for loops over millions of points or pixels.
#[derive(Debug, Clone)]
pub(super) struct LabelColors {
    /// Opacity 0 = hidden; ids beyond the end belong to no label.
    by_id: Vec<[u8; 4]>,
    unlabelled: [u8; 4],
}

impl LabelColors {
    pub(super) fn new(tree: &LabelTree, appearance: &Appearance) -> Self {
        let faint = faint_opacity(appearance);
        let of_label = |id| {
            let [r, g, b] = color_at(tree, id, appearance.level);
            [r, g, b, opacity(tree, id, appearance, faint)]
        };
        let [r, g, b] = UNKNOWN;
        let by_id = (0..tree.next_id().0)
            .map(|id| of_label(LabelId(id)))
            .collect();
        Self {
            by_id,
            unlabelled: [
                r,
                g,
                b,
                if appearance.isolated.is_some() {
                    faint
                } else {
                    255
                },
            ],
        }
    }

    /// sRGB and opacity (0 = hidden) of a label; grey for none.
    pub(super) fn get(&self, id: LabelId) -> [u8; 4] {
        let known = self
            .by_id
            .get(usize::from(id.0))
            .filter(|_| id != LabelId::NONE);
        known.copied().unwrap_or(self.unlabelled)
    }
}

/// Opacity of what is faint, 0 to 255.
pub(super) fn faint_opacity(appearance: &Appearance) -> u8 {
    (appearance.faint.clamp(0.0, 1.0) * 255.0).round() as u8
}

fn color_at(tree: &LabelTree, id: LabelId, level: Option<usize>) -> [u8; 3] {
    let shown = level.map_or(id, |level| tree.at_level(id, level));
    tree.get(shown).map_or(UNKNOWN, |label| label.color)
}

fn opacity(tree: &LabelTree, id: LabelId, appearance: &Appearance, faint: u8) -> u8 {
    let path = tree.path(id);
    let is_within = |other: &LabelId| id == *other || path.contains(other);
    if appearance.hidden.iter().any(is_within) {
        0
    } else if appearance
        .isolated
        .is_none_or(|isolated| is_within(&isolated))
    {
        255
    } else {
        faint
    }
}
