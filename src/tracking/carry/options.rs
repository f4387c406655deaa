/// How masks are carried through geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarryOptions {
    /// How much two depths of one surface may differ, in medians of the differences between two frames; ≥ 1.
    pub noise_factor: f32,
    /// Least of that, as a share of the depth at the scene's median depth; > 0.
    pub least_tolerance: f32,
    /// Most of that, as a share of the depth at the scene's median depth; < 0.1.
    pub most_tolerance: f32,
    /// Anchors asked per label and frame; ≥ 1.
    pub anchors: usize,
    /// Frames that fill the holes in an anchor's depth; 0 = none.
    pub fillers: usize,
    /// Weight of a vote where a surface is seen at a grazing angle, 0–1; 1 where it is faced.
    pub grazing_weight: f32,
    /// Weight of a vote on the border of an anchor's mask, 0–1; 1 from `border_px` inside or outside.
    pub border_weight: f32,
    /// Width of the border that is trusted less, in pixels; 0–8.
    pub border_px: u8,
    /// Weight of an anchor's surface that is drawn where the target has no depth, 0–1.
    pub drawn_weight: f32,
    /// The same for a surface in a hole of the anchor's own depth, 0–1.
    pub filled_weight: f32,
    /// How far votes spread over an even surface, in pixels; > 0.
    pub reach_px: f32,
    /// Extra length of a step between pixels whose colours differ by 255 (sum over channels), in pixels.
    pub color_edge_px: f32,
    /// Extra length of a step over a jump in depth, in pixels.
    pub depth_edge_px: f32,
    /// Weight of a pixel's own votes beside those that are spread to it; ≥ 0.
    pub own_weight: f32,
    /// Least weight that decides a pixel; 0–1.
    pub least_weight: f32,
    /// How far beyond the pixels that were voted for a label may spread, in pixels.
    pub margin_px: usize,
}

impl Default for CarryOptions {
    fn default() -> Self {
        Self {
            noise_factor: 3.0,
            least_tolerance: 0.005,
            most_tolerance: 0.04,
            anchors: 3,
            fillers: 8,
            grazing_weight: 0.1,
            border_weight: 0.2,
            border_px: 3,
            drawn_weight: 0.4,
            filled_weight: 0.2,
            reach_px: 30.0,
            color_edge_px: 60.0,
            depth_edge_px: 300.0,
            own_weight: 1.0,
            least_weight: 1e-3,
            margin_px: 32,
        }
    }
}
