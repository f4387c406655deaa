use serde::{Deserialize, Serialize};

use super::{ScenePrefs, Shortcuts};
use ostra_compute::nn::Provider;
use ostra_view::OverlayStyle;

/// What the window remembers from one start to the next: taste, never content.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Prefs {
    /// Keys that the user changed.
    pub shortcuts: Shortcuts,
    /// Which panes are shown.
    pub panes: Panes,
    /// Opacity of masks, 0–1.
    pub opacity: f32,
    /// Whether labels are outlined.
    pub outlines: bool,
    /// Radius of brush and eraser in picture pixels.
    pub brush_px: f64,
    /// Whether a click is previewed where the pointer rests.
    pub hover_preview: bool,
    /// Whether the brush stops at the picture's edges.
    pub snap: bool,
    /// Holes and islands of fewer pixels are filled and removed.
    pub tidy_px: usize,
    /// Size of points in the 3-D view in screen points.
    pub point_size: f32,
    /// How the 3-D view is drawn.
    pub scene: ScenePrefs,
    /// Whether camera frusta are drawn.
    pub frusta: bool,
    /// Whether links between frames are drawn.
    pub links: bool,
    /// Whether the grid of labels and frames is shown.
    pub timeline: bool,
    /// What networks run on.
    pub provider: Provider,
    /// Whether it is shown where the vote of all contradicts a doubtful mask.
    pub contradictions: bool,
    /// Confidence below which a frame is one to check, 0–1.
    pub doubt_below: f32,
}

impl Default for Prefs {
    fn default() -> Self {
        let style = OverlayStyle::default();
        Self {
            shortcuts: Shortcuts::default(),
            panes: Panes::default(),
            opacity: style.opacity,
            outlines: style.outlines,
            brush_px: 12.0,
            hover_preview: true,
            snap: false,
            tidy_px: 64,
            point_size: 2.0,
            scene: ScenePrefs::default(),
            frusta: true,
            links: false,
            timeline: true,
            provider: Provider::default(),
            contradictions: true,
            doubt_below: 0.5,
        }
    }
}

/// Which panes the middle of the window shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Panes {
    /// Picture and 3-D side by side; the picture alone while there is no cloud and no camera.
    #[default]
    Both,
    /// The picture alone.
    Picture,
    /// The 3-D view alone.
    Scene,
}
