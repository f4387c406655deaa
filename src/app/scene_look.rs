use glam::Vec3;
use serde::{Deserialize, Serialize};

use ostra_masks::{LabelId, LabelTree};
use ostra_view::{Axes, Bounds, Clip};

/// How the 3-D view is drawn: taste, kept from one start to the next.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ScenePrefs {
    /// Whether points are shaded by eye-dome lighting.
    pub edl: bool,
    /// Its strength, above 0.
    pub edl_strength: f32,
    /// Whether things do not shrink with distance.
    pub orthographic: bool,
    /// sRGB; `None` = the theme's.
    pub background: Option<[u8; 3]>,
    /// Whether a length is drawn to compare with.
    pub scale_bar: bool,
    /// Whether the directions of the world's axes are drawn.
    pub axes: bool,
    /// Opacity of all but the isolated label or the doubtful points, 0–1.
    pub faint: f32,
    /// Depth of the cameras' frusta, share of the scene's radius.
    pub frustum: f32,
    /// Whether the frusta of cameras carry their pictures.
    pub pictures: bool,
    /// Opacity (0–1) of the picture over what the view sees through its camera.
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
            frustum: 0.12,
            pictures: false,
            blend: 0.0,
        }
    }
}

/// What of a project the 3-D view shows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SceneLook {
    /// The part of space that is shown.
    pub clip: ClipSides,
    /// The label that, with all below it, stands out.
    pub isolated: Option<LabelId>,
    /// Only points stand out whose label won less than this share of the votes, 0–1; `None` = all do.
    pub doubtful_below: Option<f32>,
    /// Deeper labels take the colour of their ancestor at this depth, 1 = top; `None` = every label its own.
    pub level: Option<usize>,
    /// Whether the view turns about the vertical by itself.
    pub turning: bool,
    /// The frame whose camera it looks through; it follows the frame shown until the view is moved by hand.
    pub through: Option<usize>,
}

impl SceneLook {
    /// Isolates a label, or shows all again where it is isolated already.
    pub fn isolate(&mut self, label: LabelId) {
        self.isolated = (label != LabelId::NONE && self.isolated != Some(label)).then_some(label);
    }

    /// The label that a point with this one is shown as.
    #[must_use]
    pub fn shown_as(&self, tree: &LabelTree, label: LabelId) -> LabelId {
        self.level
            .map_or(label, |level| tree.at_level(label, level))
    }
}

/// A box, and a slice of it, given as shares (0–1) of the scene's extent to the right, upwards and away from the front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipSides {
    /// Lower and upper side along each axis; 0 and 1 limit nothing.
    pub sides: [[f32; 2]; 3],
    /// A slice besides.
    pub slice: Option<Slice>,
}

/// What lies about one plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slice {
    /// The axis it stands square to: 0 right, 1 up, 2 away.
    pub axis: usize,
    /// Where its middle is, share of the extent.
    pub at: f32,
    /// How thick it is, share of the extent, above 0.
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
    /// Times the extent that a side without a limit lies away.
    const FAR: f32 = 1000.0;

    /// The box in world space; `extent` holds the scene along `axes`.
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
    fn sides_limit_only_where_they_were_moved_and_a_slice_limits_more() {
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
    fn isolating_twice_shows_all_again() {
        let mut session = SceneLook::default();
        session.isolate(LabelId(3));
        assert_eq!(session.isolated, Some(LabelId(3)));
        session.isolate(LabelId(3));
        assert_eq!(session.isolated, None);
    }
}
