use glam::{DQuat, Mat3, Vec3};

use super::Bounds;
use super::upright::upright;
use ostra_frames::Frame;

/// Least share of the cameras' common direction that must point sideways for it to say where the front is.
const LEVEL_SHARE: f32 = 0.2;

/// Which way is right, up and away as one stands before a scene: unit vectors in world space, square to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// To the right.
    pub right: Vec3,
    /// Upwards.
    pub up: Vec3,
    /// Away from who looks at the front.
    pub forward: Vec3,
}

/// The sides that a scene can be seen from.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub enum Side {
    /// As the cameras stood.
    Front,
    /// From behind.
    Back,
    /// From the left.
    Left,
    /// From the right.
    Right,
    /// From above.
    Top,
    /// From below.
    Bottom,
}

impl Side {
    /// All six.
    pub const ALL: [Self; 6] = [
        Self::Front,
        Self::Back,
        Self::Left,
        Self::Right,
        Self::Top,
        Self::Bottom,
    ];
}

impl Axes {
    /// Axes with this up and, as far as it is square to that, this direction away from the viewer.
    #[must_use]
    pub fn new(up: Vec3, forward: Vec3) -> Self {
        let up = up.normalize_or(Vec3::NEG_Y);
        let forward = forward
            .reject_from_normalized(up)
            .try_normalize()
            .unwrap_or_else(|| up.any_orthonormal_vector());
        Self {
            right: forward.cross(up),
            up,
            forward,
        }
    }

    /// Upright as the cameras were held; the front is what most of them look at, or the first one where they
    /// stand all around. Without cameras y is down and z away.
    #[must_use]
    pub fn of_cameras(frames: &[Frame]) -> Self {
        let posed = frames.iter().filter_map(Frame::posed_camera);
        let turns: Vec<DQuat> = posed.map(|(_, pose)| pose.rotation.conjugate()).collect();
        let up = upright(&turns).as_vec3();
        let looks: Vec<Vec3> = turns.iter().map(|turn| turn.as_quat() * Vec3::Z).collect();
        let level =
            (looks.iter().sum::<Vec3>() / looks.len().max(1) as f32).reject_from_normalized(up);
        let first = looks.first().copied().unwrap_or(Vec3::Z);
        Self::new(
            up,
            if level.length() > LEVEL_SHARE {
                level
            } else {
                first
            },
        )
    }

    /// Takes world space to distances along right, up and forward.
    #[must_use]
    pub fn axes_from_world(&self) -> Mat3 {
        Mat3::from_cols(self.right, self.up, self.forward).transpose()
    }

    /// The box along these axes that holds all but the outermost points, see [`Bounds::of`].
    #[must_use]
    pub fn bounds(&self, points: impl Iterator<Item = Vec3>) -> Option<Bounds> {
        let axes_from_world = self.axes_from_world();
        Bounds::of(points.map(|x| axes_from_world * x))
    }

    /// The direction to look along from a side, and what is up in the picture then.
    #[must_use]
    pub fn look_from(&self, side: Side) -> (Vec3, Vec3) {
        match side {
            Side::Front => (self.forward, self.up),
            Side::Back => (-self.forward, self.up),
            Side::Left => (self.right, self.up),
            Side::Right => (-self.right, self.up),
            Side::Top => (-self.up, self.forward),
            Side::Bottom => (self.up, self.forward),
        }
    }
}
