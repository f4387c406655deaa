//! How a scene is drawn: what points are coloured by, which labels are shown, the clip box, sizes and background.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::{Mat4, Vec3, Vec4};

use super::{Axes, Bounds};
use ostra_cloud::fuse::Votes;
use ostra_core::image::blend;
use ostra_masks::{LabelId, LabelTree};

/// How a scene is drawn, by the graphics card ([`super::SceneView`]) or the processor ([`super::draw_cloud`],
/// [`super::draw_mesh`]). Both depend on nothing else, so that one test can compare their images.
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

/// How points and triangles get their colours, and which of them are seen.
#[derive(Debug, Clone)]
pub struct Appearance {
    /// What colours show.
    pub coloring: Coloring,
    /// Labels deeper than this take the colour of their ancestor there, 1 = top; `None` = every label its own.
    pub level: Option<usize>,
    /// Labels (with all below them) that are not drawn.
    pub hidden: BTreeSet<LabelId>,
    /// The label that, with all below it, is drawn as ever while all else is drawn faintly; `None` = nothing is faint.
    pub isolated: Option<LabelId>,
    /// Only points stand out whose label won less than this share of the votes ([`ostra_cloud::LabelledCloud::is_doubtful`]), 0–1, and all
    /// else is drawn faintly; `None` = all do.
    pub doubtful_below: Option<f32>,
    /// Opacity of what is faint, 0 (not drawn) to 1.
    pub faint: f32,
    /// Names and colours newer than the cloud's own.
    pub tree: Option<LabelTree>,
    /// How the points were voted on; without it, colours that show votes are grey.
    pub votes: Option<Arc<Votes>>,
    /// The direction that height is measured along, a unit vector in world space.
    pub up: Vec3,
}

impl Default for Appearance {
    fn default() -> Self {
        Self {
            coloring: Coloring::Rgb,
            level: None,
            hidden: BTreeSet::new(),
            isolated: None,
            doubtful_below: None,
            faint: 0.0,
            tree: None,
            votes: None,
            up: Vec3::NEG_Y,
        }
    }
}

impl PartialEq for Appearance {
    /// Votes are equal when they are the very same.
    fn eq(&self, other: &Self) -> bool {
        let votes = |one: &Self| one.votes.as_ref().map(Arc::as_ptr);
        (self.coloring, self.level, self.isolated) == (other.coloring, other.level, other.isolated)
            && (self.faint, self.up, self.doubtful_below)
                == (other.faint, other.up, other.doubtful_below)
            && votes(self) == votes(other)
            && self.hidden == other.hidden
            && self.tree == other.tree
    }
}

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
    std::array::from_fn(|c| blend(STOPS[low][c], STOPS[low + 1][c], t) as u8)
}

/// The part of space that is drawn and picked: all of it, or the inside of a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clip {
    /// Takes the inside of the box to the cube from -1 to 1; everything into its middle = no limits.
    pub(super) cube_from_world: Mat4,
}

impl Default for Clip {
    /// No limits.
    fn default() -> Self {
        Self {
            cube_from_world: Mat4::from_diagonal(Vec4::W),
        }
    }
}

impl Clip {
    /// A box whose sides are parallel to `axes`; `sides` are its corners along them ([`Axes::axes_from_world`]).
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

    /// What takes the inside of the box to the cube from −1 to 1; `None` where there are no limits.
    #[must_use]
    pub fn cube_from_world(&self) -> Option<Mat4> {
        (*self != Self::default()).then_some(self.cube_from_world)
    }

    /// Whether a point of world space is drawn and picked.
    #[must_use]
    pub fn contains(&self, x_in_world: Vec3) -> bool {
        Self::is_in_cube(self.in_cube(x_in_world))
    }

    /// Where a point of world space lies in the cube.
    pub(super) fn in_cube(&self, x_in_world: Vec3) -> Vec3 {
        self.cube_from_world.transform_point3(x_in_world)
    }

    /// Whether a point that was brought into the cube's space lies inside.
    pub(super) fn is_in_cube(x_in_cube: Vec3) -> bool {
        x_in_cube.abs().max_element() <= 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_along_turned_axes_holds_what_lies_between_its_sides() {
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
