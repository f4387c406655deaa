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
    /// The share of the vote its strongest rival got: dark violet (0) to yellow (a half).
    Conflict,
    /// How many views voted on it: dark violet (none) to yellow (the most).
    Views,
    /// Its normal in world space: x as red, y as green, z as blue, each from -1 (0) to 1 (255); unknown ones grey.
    Normals,
    /// How high it lies along [`super::Appearance::up`]: dark violet (lowest) to yellow (highest).
    Height,
}

impl Coloring {
    /// All, the picture's colours first.
    pub const ALL: [Self; 7] = [
        Self::Rgb,
        Self::Label,
        Self::Confidence,
        Self::Conflict,
        Self::Views,
        Self::Normals,
        Self::Height,
    ];

    /// Whether it shows how points were voted on.
    #[must_use]
    pub fn needs_votes(self) -> bool {
        matches!(self, Self::Conflict | Self::Views)
    }
}

/// A perceptually ordered ramp through five stops (violet, blue, green, lime, yellow): sRGB for a share from 0 to 1.
#[must_use]
pub fn ramp(share: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 5] = [
        [68.0, 1.0, 84.0],
        [59.0, 82.0, 139.0],
        [33.0, 145.0, 140.0],
        [94.0, 201.0, 98.0],
        [253.0, 231.0, 37.0],
    ];
    let at = share.clamp(0.0, 1.0) * 4.0;
    let low = (at as usize).min(3);
    let t = at - low as f32;
    std::array::from_fn(|c| (STOPS[low][c] * (1.0 - t) + STOPS[low + 1][c] * t) as u8)
}
