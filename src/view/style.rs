use super::{Appearance, Clip};

/// How a scene is drawn, by the graphics card ([`super::SceneView`]) or the processor ([`super::draw_cloud`],
/// [`super::draw_mesh`]).
#[derive(Debug, Clone, PartialEq)]
pub struct SceneStyle {
    /// Colours, and what is seen at all.
    pub appearance: Appearance,
    /// The part of space that is drawn.
    pub clip: Clip,
    /// Smallest disc radius in pixels, above 0.
    pub point_px: f32,
    /// sRGB.
    pub background: [u8; 3],
    /// Strength of the eye-dome lighting of points, 0 = off; triangles are lit by their normals.
    pub edl_strength: f32,
}

impl SceneStyle {
    /// Largest disc radius in pixels.
    pub(super) fn most_px(&self) -> f32 {
        self.point_px.max(24.0)
    }
}

impl Default for SceneStyle {
    fn default() -> Self {
        Self {
            appearance: Appearance::default(),
            clip: Clip::default(),
            point_px: 0.8,
            background: [24, 26, 30],
            edl_strength: 0.8,
        }
    }
}
