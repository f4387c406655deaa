use glam::Vec4;

use super::{Bounds, SceneStyle, ViewCamera};

/// The part of space of which a picture shows anything: what lies in the camera's frustum and in the clip box.
pub(super) struct Frustum {
    /// Inside is where all of `normal · x + offset` are at least 0.
    planes: [Vec4; 12],
}

impl Frustum {
    /// Wider than the picture by the largest disc, since discs at its border reach into it.
    pub fn new(camera: &ViewCamera, style: &SceneStyle) -> Self {
        let clip = camera.clip_from_world();
        let [x, y, z, w] = [0, 1, 2, 3].map(|row| clip.row(row));
        let beyond = |size: u32| 1.0 + 2.0 * (style.most_px() + 1.0) / size.max(1) as f32;
        let (wide, high) = (w * beyond(camera.width), w * beyond(camera.height));
        let cube = style.clip.cube_from_world;
        let [u, v, t, one] = [0, 1, 2, 3].map(|row| cube.row(row));
        let sides = [wide + x, wide - x, high + y, high - y, w - z, z];
        let walls = [one + u, one - u, one + v, one - v, one + t, one - t];
        Self {
            planes: std::array::from_fn(|at| if at < 6 { sides[at] } else { walls[at - 6] }),
        }
    }

    /// Whether anything in a box might be seen. Never wrong when it says no.
    pub fn reaches(&self, bounds: &Bounds) -> bool {
        let (centre, half) = (bounds.centre(), (bounds.max - bounds.min) / 2.0);
        self.planes.iter().all(|plane| {
            let normal = plane.truncate();
            let reach = normal.abs().dot(half);
            let rounding = 1e-5 * (normal.abs().dot(centre.abs()) + reach + plane.w.abs());
            normal.dot(centre) + plane.w + reach >= -rounding
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;
    use crate::{Axes, Clip, Orbit};

    fn orbit() -> Orbit {
        Orbit::framing(
            &Bounds {
                min: Vec3::NEG_ONE,
                max: Vec3::ONE,
            },
            Vec3::new(0.3, 0.2, 1.0),
            Vec3::NEG_Y,
        )
    }

    fn around(x: Vec3, half: f32) -> Bounds {
        Bounds {
            min: x - half,
            max: x + half,
        }
    }

    proptest! {
        #[test]
        fn a_box_with_a_point_that_is_drawn_is_reached(
            at in prop::array::uniform3(-4.0_f32..4.0),
            off in prop::array::uniform3(-1.0_f32..1.0),
            (half, closer, orthographic, clipped) in (0.0_f32..2.0, 0.02_f32..2.0, any::<bool>(), any::<bool>()),
        ) {
            let mut orbit = Orbit { orthographic, ..orbit() };
            orbit.distance *= closer;
            let camera = orbit.camera(320, 200);
            let sides = around(Vec3::new(0.2, -0.1, 0.3), 0.8);
            let axes = Axes::new(Vec3::new(0.2, -1.0, 0.1), Vec3::Z);
            let clip = if clipped { Clip::inside(&axes, &sides) } else { Clip::default() };
            let style = SceneStyle { clip, ..SceneStyle::default() };
            let x = Vec3::from_array(at);
            let is_drawn = clip.contains(x) && camera.project(x).is_some_and(|(px, _)| {
                let most = style.most_px();
                px.x > -most && px.y > -most && px.x < 320.0 + most && px.y < 200.0 + most
            });
            let bounds = around(x + Vec3::from_array(off) * half, half);
            prop_assert!(!is_drawn || Frustum::new(&camera, &style).reaches(&bounds));
        }
    }

    #[test]
    fn boxes_beside_behind_and_outside_the_clip_box_are_not_reached() {
        let camera = orbit().camera(320, 200);
        let style = SceneStyle::default();
        let (inside, behind) = (
            around(Vec3::ZERO, 0.1),
            camera.unproject(glam::Vec2::new(160.0, 100.0), -2.0),
        );
        let beside = camera.unproject(glam::Vec2::new(-200.0, 100.0), 3.0);
        let frustum = Frustum::new(&camera, &style);
        assert!(frustum.reaches(&inside) && frustum.reaches(&around(beside, 50.0)));
        assert!(!frustum.reaches(&around(behind, 0.1)) && !frustum.reaches(&around(beside, 0.1)));
        let axes = Axes::new(Vec3::NEG_Y, Vec3::Z);
        let clip = Clip::inside(
            &axes,
            &axes
                .bounds([Vec3::splat(0.5), Vec3::ONE].into_iter())
                .unwrap(),
        );
        let clipped = Frustum::new(&camera, &SceneStyle { clip, ..style });
        assert!(!clipped.reaches(&inside) && clipped.reaches(&around(Vec3::splat(0.7), 0.1)));
    }
}
