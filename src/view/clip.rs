use glam::{Mat4, Vec3, Vec4};

use super::{Axes, Bounds};

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
