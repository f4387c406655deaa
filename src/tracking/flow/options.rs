/// How the flow tracker works. Weights are natural logarithms of odds; lengths in pixels of the working size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowOptions {
    /// Longer side of the pictures worked on from one keyframe, in pixels; larger ones are reduced.
    pub most_side: u32,
    /// The same between two keyframes, where flow is also measured at full resolution: users who correct a frame in a few
    /// expect the frames between to be right in detail, and wait for few frames. From one keyframe alone half the resolution
    /// of smaller images is enough and keeps up with a video. `cargo bench --bench flow -- --every N` gives true masks on
    /// every N-th frame and scores the others.
    pub most_side_between: u32,
    /// Weight of where the flow says that the object came from.
    pub flow_weight: f32,
    /// How much a pixel whose flow cannot be trusted speaks against the object.
    pub doubt_weight: f32,
    /// Weight of the expected shape where the flow cannot be trusted, next to a keyframe.
    pub shape_weight: f32,
    /// Weight of the distance from where the object is expected.
    pub place_weight: f32,
    /// Weight of the object's colours in the keyframes.
    pub first_color_weight: f32,
    /// Weight of the object's colours of late.
    pub last_color_weight: f32,
    /// Share of a frame's colours that the colours of late take over, 0–1.
    pub color_rate: f32,
    /// Weight of moving like the object rather than like the background.
    pub motion_weight: f32,
    /// Weight of what the cells of the keyframes that look most alike show, where pictures are described.
    pub memory_weight: f32,
    /// Weight of what patches of both neighbouring frames show that look alike, between two keyframes. There they recover
    /// rims and legs a few pixels wide that flow loses. A pass from one keyframe alone would take its own last mask as
    /// reference and confirm its errors: mean J of the seven videos of DAVIS 2016 from one mask falls from 0.650 to 0.597
    /// (`cargo bench --bench flow`).
    pub vote_weight: f32,
    /// Price of the outline per pixel side on even colour.
    pub outline_weight: f32,
    /// Share of the expected shape that stays from one frame to the next where the mask shows nothing, 0–1.
    pub memory: f32,
    /// How far beyond the expected shape the object may be, in square roots of its area.
    pub reach: f32,
    /// What the object's area may be of its median over the last frames before the odds are lowered for a smaller mask.
    pub most_growth: f32,
    /// Trust, 0–1, in a pixel that joins the object without having come from it.
    pub trust_of_new: f32,
    /// Where the object is looked for: distance from where flow puts it, in square roots of its area.
    pub search: f32,
}

impl Default for FlowOptions {
    fn default() -> Self {
        Self {
            most_side: 640,
            most_side_between: 854,
            flow_weight: 1.0,
            doubt_weight: 0.7,
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
