use egui::ThemePreference;
use serde::{Deserialize, Serialize};

use super::arrangement::Arrangement;
use super::last_frames::LastFrames;
use super::playback::PlaybackPrefs;
use super::{ScenePrefs, Shortcuts};
use ostra_compute::nn::Provider;
use ostra_project::review::FLAG_BELOW;
use ostra_view::OverlayStyle;

/// Preferences kept between sessions.
///
/// Of projects they include only the folders of the latest ones and which frame was shown there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Prefs {
    /// Shortcuts changed by the user.
    pub shortcuts: Shortcuts,
    /// Dark theme, light theme, or the one of the system.
    pub theme: ThemePreference,
    /// Size of the interface, relative to the one that the system asks for.
    pub scale: f32,
    /// Visible panes.
    pub panes: Panes,
    /// Arrangement of the panes and their shares of the space.
    pub arrangement: Arrangement,
    /// Whether the side panel is at the left.
    pub panel_on_left: bool,
    /// Opacity of masks, 0–1.
    pub opacity: f32,
    /// Whether labels are outlined.
    pub outlines: bool,
    /// Radius of brush and eraser in image pixels.
    pub brush_px: f64,
    /// Whether a click is previewed where the pointer rests.
    pub hover_preview: bool,
    /// Whether the brush stops at image edges.
    pub snap: bool,
    /// Size in pixels below which holes are filled and specks removed.
    pub tidy_px: usize,
    /// Size of points in the 3-D view, in screen points.
    pub point_size: f32,
    /// Rendering options of the 3-D view.
    pub scene: ScenePrefs,
    /// Whether camera frusta are drawn.
    pub frusta: bool,
    /// Whether links between frames are drawn.
    pub links: bool,
    /// Whether the timeline is shown.
    pub timeline: bool,
    /// Device that runs neural networks.
    pub provider: Provider,
    /// Whether networks are offered where they would help.
    pub offer_networks: bool,
    /// Whether a message of the system reports the end of long work while another window is in use.
    pub notify: bool,
    /// Whether pixels that contradict the vote of all views are highlighted.
    #[serde(alias = "contradictions")]
    pub mismatches: bool,
    /// Confidence below which a frame is flagged for checking, 0–1.
    #[serde(alias = "doubt_below")]
    pub flag_below: f32,
    /// Speed, loop and stops of playback.
    pub playback: PlaybackPrefs,
    /// Frames that were shown last in projects.
    pub last_frames: LastFrames,
}

impl Default for Prefs {
    fn default() -> Self {
        let style = OverlayStyle::default();
        Self {
            shortcuts: Shortcuts::default(),
            theme: ThemePreference::default(),
            scale: 1.0,
            panes: Panes::default(),
            arrangement: Arrangement::default(),
            panel_on_left: false,
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
            offer_networks: true,
            notify: true,
            mismatches: true,
            flag_below: FLAG_BELOW,
            playback: PlaybackPrefs::default(),
            last_frames: LastFrames::default(),
        }
    }
}

/// Panes in the middle of the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Panes {
    /// Image and 3-D view.
    #[default]
    Both,
    /// Image only.
    #[serde(alias = "Picture")]
    Image,
    /// 3-D view only.
    Scene,
}
