//! Style of a scene: colouring, visible labels, clip box, sizes and background.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::{Mat4, Vec3, Vec4};

use super::{Axes, Bounds};
use ostra_cloud::fuse::Votes;
use ostra_core::image::blend;
use ostra_masks::{LabelId, LabelTree};

/// Style of a scene, for the GPU ([`super::SceneView`]) and for the CPU.
///
/// The CPU functions are [`super::draw_cloud`] and [`super::draw_mesh`]. Both depend on nothing
/// else, so that one test can compare their images.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneStyle {
    /// Colours and visibility.
    pub appearance: Appearance,
    /// The part of space that is drawn.
    pub clip: Clip,
    /// Minimum disc radius in pixels, above 0.
    pub point_px: f32,
    /// Background colour, sRGB.
    pub background: [u8; 3],
    /// Strength of the eye-dome lighting of points; 0 means off.
    ///
    /// Triangles are lit by their normals.
    pub edl_strength: f32,
}

impl SceneStyle {
    /// Returns the maximum disc radius in pixels.
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

/// Colours and visibility of points and triangles.
#[derive(Debug, Clone)]
pub struct Appearance {
    /// What the colours show.
    pub coloring: Coloring,
    /// Depth in the label tree, 1 = top; deeper labels take the colour of their ancestor there.
    ///
    /// `None` gives every label its own colour.
    pub level: Option<usize>,
    /// Labels that are not drawn, including their descendants.
    pub hidden: BTreeSet<LabelId>,
    /// The label that keeps its opacity, including its descendants; everything else is faint.
    ///
    /// `None` means that no label is isolated.
    pub isolated: Option<LabelId>,
    /// Share of the votes, 0–1, below which a point stands out; all other points are faint.
    ///
    /// See [`ostra_cloud::LabelledCloud::is_uncertain`]. `None` means that all points stand out.
    pub uncertain_below: Option<f32>,
    /// Number of views that have to have voted on a point for it to be drawn; 0 draws all points.
    ///
    /// Without votes, all points are drawn.
    pub least_views: u32,
    /// Opacity of faint points, 0 (not drawn) to 1.
    pub faint: f32,
    /// Label tree that replaces the one of the cloud, for newer names and colours.
    pub tree: Option<LabelTree>,
    /// Votes per point; without them, colourings that show votes are grey.
    pub votes: Option<Arc<Votes>>,
    /// Direction of height, a unit vector in world space.
    pub up: Vec3,
}

impl Default for Appearance {
    fn default() -> Self {
        Self {
            coloring: Coloring::Rgb,
            level: None,
            hidden: BTreeSet::new(),
            isolated: None,
            uncertain_below: None,
            least_views: 0,
            faint: 0.0,
            tree: None,
            votes: None,
            up: Vec3::NEG_Y,
        }
    }
}

impl PartialEq for Appearance {
    /// Compares votes by pointer.
    fn eq(&self, other: &Self) -> bool {
        let votes = |one: &Self| one.votes.as_ref().map(Arc::as_ptr);
        (self.coloring, self.level, self.isolated) == (other.coloring, other.level, other.isolated)
            && (self.faint, self.up, self.uncertain_below)
                == (other.faint, other.up, other.uncertain_below)
            && self.least_views == other.least_views
            && votes(self) == votes(other)
            && self.hidden == other.hidden
            && self.tree == other.tree
    }
}

/// What the colour of a point shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Coloring {
    /// The colour in the images.
    #[default]
    Rgb,
    /// The colour of its label; unlabelled points are grey.
    Label,
    /// The share of votes of its label: dark violet (0) over green to yellow (1).
    Confidence,
    /// The share of votes of the second-best label: dark violet (0) to yellow (0.5).
    Conflict,
    /// The number of views that voted: dark violet (0) to yellow (maximum).
    Views,
    /// Its normal in world space: x, y, z as red, green, blue, from -1 (0) to 1 (255).
    ///
    /// Unknown normals are grey.
    Normals,
    /// Its height along [`super::Appearance::up`]: dark violet (lowest) to yellow (highest).
    Height,
}

impl Coloring {
    /// All colourings, that of the images first.
    pub const ALL: [Self; 7] = [
        Self::Rgb,
        Self::Label,
        Self::Confidence,
        Self::Conflict,
        Self::Views,
        Self::Normals,
        Self::Height,
    ];

    /// Returns whether it shows votes.
    #[must_use]
    pub fn needs_votes(self) -> bool {
        matches!(self, Self::Conflict | Self::Views)
    }
}

/// Returns the sRGB colour for a share from 0 to 1.
///
/// The ramp is perceptually ordered through five stops: violet, blue, green, lime and yellow.
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
    std::array::from_fn(|c| blend(STOPS[low][c], STOPS[low + 1][c], t) as u8)
}

/// The part of space that is drawn and picked: everything, or the inside of a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clip {
    /// Maps the inside of the box to the cube from -1 to 1.
    ///
    /// Mapping everything to the origin means no limits.
    pub(super) cube_from_world: Mat4,
}

impl Default for Clip {
    /// Returns a clip without limits.
    fn default() -> Self {
        Self {
            cube_from_world: Mat4::from_diagonal(Vec4::W),
        }
    }
}

impl Clip {
    /// Creates a box whose faces are parallel to `axes`.
    ///
    /// `sides` are its corners in axis coordinates ([`Axes::axes_from_world`]).
    #[must_use]
    pub fn inside(axes: &Axes, sides: &Bounds) -> Self {
        let half = ((sides.max - sides.min) / 2.0).max(Vec3::splat(f32::MIN_POSITIVE.sqrt()));
        let axes_from_world = Mat4::from_mat3(axes.axes_from_world());
        Self {
            cube_from_world: Mat4::from_scale(half.recip())
                * Mat4::from_translation(-sides.centre())
                * axes_from_world,
        }
    }

    /// Returns the map from the box to the cube from −1 to 1; `None` if there are no limits.
    #[must_use]
    pub fn cube_from_world(&self) -> Option<Mat4> {
        (*self != Self::default()).then_some(self.cube_from_world)
    }

    /// Returns whether a world point is drawn and picked.
    #[must_use]
    pub fn contains(&self, x_in_world: Vec3) -> bool {
        Self::is_in_cube(self.in_cube(x_in_world))
    }

    /// Transforms a world point into the space of the cube.
    pub(super) fn in_cube(&self, x_in_world: Vec3) -> Vec3 {
        self.cube_from_world.transform_point3(x_in_world)
    }

    /// Returns whether a point in the space of the cube is inside.
    pub(super) fn is_in_cube(x_in_cube: Vec3) -> bool {
        x_in_cube.abs().max_element() <= 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotated_clip_box_contains_points_between_its_faces() {
        let axes = Axes::new(Vec3::new(0.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0));
        let clip = Clip::inside(
            &axes,
            &Bounds {
                min: Vec3::new(-1.0, 0.0, -5.0),
                max: Vec3::new(1.0, 2.0, 5.0),
            },
        );
        for (x, inside) in [
            (0.9 * axes.right + axes.up, true),
            (1.1 * axes.right + axes.up, false),
        ] {
            assert_eq!(clip.contains(x), inside, "{x}");
        }
        assert!(
            clip.contains(1.9 * axes.up + 4.9 * axes.forward) && !clip.contains(-0.1 * axes.up)
        );
        assert!(Clip::default().contains(Vec3::splat(1e9)));
    }
}
