use crate::carry::CarryOptions;

/// How masks are held against geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstrainOptions {
    /// How the anchors' masks are carried.
    pub carry: CarryOptions,
    /// Share of the anchors' weights that a label must win for geometry to be sure of it; 0.5–1.
    pub sure_share: f32,
    /// What these weights must sum to at least; 1 = one anchor that faces the surface from as near; > 0.
    pub least_weight: f32,
    /// Borders that differ by no more are the tracker's, in pixels.
    pub border_px: u32,
    /// Contradictions of fewer connected pixels are let pass, and objects contradicted in fewer have not strayed.
    pub least_area: usize,
    /// Frames that a walk goes on after an object was given to it anew, before it is given one again.
    pub rest: usize,
}

impl Default for ConstrainOptions {
    fn default() -> Self {
        Self {
            carry: CarryOptions::default(),
            sure_share: 0.75,
            least_weight: 1e-3,
            border_px: 3,
            least_area: 25,
            rest: 5,
        }
    }
}
