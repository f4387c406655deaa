/// Options of the flow tracker.
///
/// Weights are natural logarithms of odds. Lengths are in pixels of the working size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowOptions {
    /// Longer side, in pixels, that images are reduced to when tracking from one keyframe.
    pub most_side: u32,
    /// Longer side, in pixels, that images are reduced to between two keyframes.
    ///
    /// There, flow is also measured at full resolution: users who correct every few frames expect
    /// precise masks in between, and wait for few frames. From one keyframe alone, half the
    /// resolution of smaller images is enough and keeps up with a video. `cargo bench --bench flow
    /// -- --every N` gives true masks on every N-th frame and scores the others.
    pub most_side_between: u32,
    /// Weight of the labels that the flow transfers from the last frame.
    pub flow_weight: f32,
    /// Penalty for a pixel whose flow is unreliable.
    pub uncertainty_weight: f32,
    /// Weight of the expected shape near a keyframe, where the flow is unreliable.
    pub shape_weight: f32,
    /// Weight of the distance from the expected position.
    pub place_weight: f32,
    /// Weight of the object's colours in the keyframes.
    pub first_color_weight: f32,
    /// Weight of the object's recent colours.
    pub last_color_weight: f32,
    /// Rate at which the recent colours adapt to each new frame, 0–1.
    pub color_rate: f32,
    /// Weight of moving like the object rather than like the background.
    pub motion_weight: f32,
    /// Weight of the most similar keyframe cells, if a network computes features.
    pub memory_weight: f32,
    /// Weight of similar patches in both neighbouring frames, between two keyframes.
    ///
    /// The patches recover rims and legs a few pixels wide that the flow loses. A pass from one
    /// keyframe alone would use its own last mask as reference and confirm its errors: mean J of
    /// the seven videos of DAVIS 2016 from one mask falls from 0.650 to 0.597 (`cargo bench --bench
    /// flow`).
    pub vote_weight: f32,
    /// Cost of the outline per pixel side on uniform colour.
    pub outline_weight: f32,
    /// Share of the expected shape that persists per frame where the mask is empty, 0–1.
    pub memory: f32,
    /// Maximum distance from the expected shape, in square roots of its area.
    pub reach: f32,
    /// Maximum area relative to the median of the last frames.
    ///
    /// If the mask is larger, the odds are lowered and the cut is repeated.
    pub most_growth: f32,
    /// Trust in a pixel that joins the object without being transferred from it, 0–1.
    pub trust_of_new: f32,
    /// Radius of the search around the position from flow, in square roots of the area.
    pub search: f32,
}

impl Default for FlowOptions {
    fn default() -> Self {
        Self {
            most_side: 640,
            most_side_between: 854,
            flow_weight: 1.0,
            uncertainty_weight: 0.7,
            shape_weight: 1.0,
            place_weight: 0.3,
            first_color_weight: 0.35,
            last_color_weight: 0.25,
            color_rate: 0.1,
            motion_weight: 0.5,
            memory_weight: 0.5,
            vote_weight: 3.0,
            outline_weight: 2.0,
            memory: 0.94,
            reach: 0.35,
            most_growth: 1.15,
            trust_of_new: 0.4,
            search: 0.8,
        }
    }
}
