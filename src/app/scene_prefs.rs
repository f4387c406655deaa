use glam::Vec3;
use serde::{Deserialize, Serialize};

use ostra_masks::{LabelId, LabelTree};
use ostra_view::{Axes, Bounds, Clip};

/// Rendering preferences of the 3-D view, kept between sessions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ScenePrefs {
    /// Whether points are shaded by eye-dome lighting.
    pub edl: bool,
    /// Strength of eye-dome lighting, above 0.
    pub edl_strength: f32,
    /// Whether the projection is orthographic.
    pub orthographic: bool,
    /// Background colour, sRGB; `None` uses the theme's.
    pub background: Option<[u8; 3]>,
    /// Whether a scale bar is drawn.
    pub scale_bar: bool,
    /// Whether the directions of the world axes are drawn.
    pub axes: bool,
    /// Opacity of points outside the isolated label or above the vote threshold, 0–1.
    pub faint: f32,
    /// Whether the points of the shown frame's depth are drawn over the fused cloud.
    pub frame_points: bool,
    /// Depth of camera frusta, as a share of the scene's radius.
    pub frustum: f32,
    /// Whether camera frusta show their images.
    #[serde(alias = "pictures")]
    pub images: bool,
    /// Opacity of the image over the 3-D view when looking through its camera, 0–1.
    pub blend: f32,
}

impl Default for ScenePrefs {
    fn default() -> Self {
        Self {
            edl: true,
            edl_strength: 0.8,
            orthographic: false,
            background: None,
            scale_bar: true,
            axes: true,
            faint: 0.0,
            frame_points: false,
            frustum: 0.12,
            images: false,
            blend: 0.0,
        }
    }
}

/// Selection of the project's content that the 3-D view shows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SceneLook {
    /// Visible part of space.
    pub clip: ClipSides,
    /// Label that is highlighted together with its descendants.
    pub isolated: Option<LabelId>,
    /// Highlights only points whose label won less than this share of votes, 0–1; `None` for all.
    pub uncertain_below: Option<f32>,
    /// Number of votes below which points are hidden; 0 and 1 show all.
    pub least_views: u32,
    /// Depth in the label tree from which labels take their ancestor's colour.
    ///
    /// 1 is the top; `None` gives every label its own colour.
    pub level: Option<usize>,
    /// Whether the view rotates about the vertical.
    pub turning: bool,
    /// Frame whose camera the view looks through.
    ///
    /// It follows the shown frame until the user moves the view.
    pub through: Option<usize>,
}

impl SceneLook {
    /// Isolates a label, or shows all labels again if it is already isolated.
    pub fn isolate(&mut self, label: LabelId) {
        self.isolated = (label != LabelId::NONE && self.isolated != Some(label)).then_some(label);
    }

    /// Returns the label whose colour is used for points with `label`.
    #[must_use]
    pub fn shown_as(&self, tree: &LabelTree, label: LabelId) -> LabelId {
        self.level
            .map_or(label, |level| tree.at_level(label, level))
    }
}

/// Clipping box and slice, as shares (0–1) of the scene's extent.
///
/// The axes point right, up and away from the front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipSides {
    /// Lower and upper bound along each axis; 0 and 1 do not clip.
    pub sides: [[f32; 2]; 3],
    /// Additional slice.
    pub slice: Option<Slice>,
}

/// Slab around a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slice {
    /// Axis that the slab is perpendicular to: 0 right, 1 up, 2 away.
    pub axis: usize,
    /// Position of the centre, as a share of the extent.
    pub at: f32,
    /// Thickness, as a share of the extent, above 0.
    pub thickness: f32,
}

impl Default for ClipSides {
    fn default() -> Self {
        Self {
            sides: [[0.0, 1.0]; 3],
            slice: None,
        }
    }
}

impl Default for Slice {
    fn default() -> Self {
        Self {
            axis: 1,
            at: 0.5,
            thickness: 0.1,
        }
    }
}

impl ClipSides {
    /// Distance of an unlimited side, in multiples of the extent.
    const FAR: f32 = 1000.0;

    /// Returns the box in world space. `extent` contains the scene along `axes`.
    #[must_use]
    pub fn clip(&self, axes: &Axes, extent: &Bounds) -> Clip {
        if *self == Self::default() {
            return Clip::default();
        }
        let size = extent.max - extent.min;
        let side = |axis: usize, share: f32| extent.min[axis] + size[axis] * share;
        let (mut min, mut max) = (
            extent.min - size.max_element() * Self::FAR,
            extent.max + size.max_element() * Self::FAR,
        );
        for (axis, [low, high]) in self.sides.into_iter().enumerate() {
            min[axis] = if low > 0.0 {
                side(axis, low)
            } else {
                min[axis]
            };
            max[axis] = if high < 1.0 {
                side(axis, high)
            } else {
                max[axis]
            };
        }
        if let Some(Slice {
            axis,
            at,
            thickness,
        }) = self.slice
        {
            min[axis] = min[axis].max(side(axis, at - thickness / 2.0));
            max[axis] = max[axis].min(side(axis, at + thickness / 2.0));
        }
        Clip::inside(
            axes,
            &Bounds {
                min,
                max: max.max(min + Vec3::splat(f32::MIN_POSITIVE)),
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moved_sides_and_slice_clip() {
        let axes = Axes::new(Vec3::Y, Vec3::NEG_Z);
        let extent = Bounds {
            min: Vec3::ZERO,
            max: Vec3::new(2.0, 10.0, 4.0),
        };
        let mut sides = ClipSides::default();
        let holds = |sides: &ClipSides, along: Vec3| {
            sides
                .clip(&axes, &extent)
                .contains(axes.right * along.x + axes.up * along.y + axes.forward * along.z)
        };
        assert!(holds(&sides, Vec3::splat(1e6)));
        sides.sides[1] = [0.0, 0.5];
        assert!(
            holds(&sides, Vec3::new(-50.0, 4.9, 50.0)) && !holds(&sides, Vec3::new(1.0, 5.1, 1.0))
        );
        sides.slice = Some(Slice {
            axis: 1,
            at: 0.3,
            thickness: 0.2,
        });
        assert!(
            holds(&sides, Vec3::Y * 3.9)
                && !holds(&sides, Vec3::Y * 4.1)
                && !holds(&sides, Vec3::Y * 1.9)
        );
    }

    #[test]
    fn isolating_twice_shows_all_labels() {
        let mut session = SceneLook::default();
        session.isolate(LabelId(3));
        assert_eq!(session.isolated, Some(LabelId(3)));
        session.isolate(LabelId(3));
        assert_eq!(session.isolated, None);
    }
}
