use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::noise::Dice;
use super::options::{SceneKind, SceneOptions, SensorNoise, ViewPath};
use ostra_frames::{DepthMap, FrameCamera, Image};
use ostra_geometry::{Camera, Pose};
use ostra_masks::LabelMask;

/// A camera of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticView {
    /// File name without extension, e.g. `007`.
    pub name: String,
    /// Index along the arc, from 0.
    pub index: usize,
    /// Pinhole intrinsics.
    pub camera: Camera,
    /// Pose, in metres.
    pub camera_from_world: Pose,
}

/// A rendered view.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedView {
    /// Colour, averaged over the area of each pixel.
    pub image: Image,
    /// Depth at the pixel centres, in metres.
    pub depth: DepthMap,
    /// Deepest label at the pixel centres; exact even if image and depth are noisy.
    pub mask: LabelMask,
    /// Intrinsics and pose.
    pub camera: FrameCamera,
}

impl SyntheticView {
    /// Returns the camera in the form that frames use.
    #[must_use]
    pub fn frame_camera(&self) -> FrameCamera {
        FrameCamera::given(self.camera, Some(self.camera_from_world))
    }
}

/// Centre and size of the region that must fit into the image, in metres.
struct Subject {
    middle: DVec3,
    width_m: f64,
    height_m: f64,
    /// Angle by which the cameras look down.
    pitch_deg: f64,
}

/// Returns views along arcs around the specimen, the lowest looking slightly down.
///
/// The first row goes from left to right. If one camera goes to and fro, the next one goes back, and
/// so on.
pub(super) fn arc_of_views(options: &SceneOptions) -> Vec<SyntheticView> {
    let subject = match options.scene {
        SceneKind::Tiller => Subject {
            middle: DVec3::new(0.0, 0.0, 0.303),
            width_m: 0.50,
            height_m: 0.69,
            pitch_deg: 9.0,
        },
        SceneKind::Bricks => Subject {
            middle: DVec3::new(0.0, 0.0, 0.06),
            width_m: 0.40,
            height_m: 0.30,
            pitch_deg: 22.0,
        },
    };
    let (width, height) = (f64::from(options.width), f64::from(options.height));
    let focal = options.distance_m * (width / subject.width_m).min(height / subject.height_m);
    let camera = Camera::pinhole(
        options.width,
        options.height,
        [focal, focal],
        [0.5 * width, 0.5 * height],
    );
    let digits = (options.views.max(2) - 1).to_string().len().max(3);
    let per_row = options.views.div_ceil(options.rows);
    (0..options.views)
        .map(|index| {
            let (row, along) = (index / per_row, index % per_row);
            let share = if per_row > 1 {
                along as f64 / (per_row - 1) as f64 - 0.5
            } else {
                0.0
            };
            let (name, goes_back) = match options.path {
                ViewPath::ToAndFro => (format!("{index:0digits$}"), row % 2 == 1),
                ViewPath::CameraPerRow => (format!("{}{along:0digits$}", letters(row)), false),
            };
            let share = if goes_back { -share } else { share };
            let azimuth = (share * options.arc_deg).to_radians();
            let pitch = (subject.pitch_deg + options.row_step_deg * row as f64).to_radians();
            let away = DVec3::new(
                pitch.cos() * azimuth.sin(),
                -pitch.cos() * azimuth.cos(),
                pitch.sin(),
            );
            let camera_from_world =
                look_at(subject.middle + options.distance_m * away, subject.middle);
            SyntheticView {
                name,
                index,
                camera,
                camera_from_world,
            }
        })
        .collect()
}

/// Returns the name of a row: `a` to `y`, then `za`, `zb` and so on, which sort in this order.
fn letters(row: usize) -> String {
    let letter = char::from(b'a' + (row % 25) as u8);
    "z".repeat(row / 25) + &letter.to_string()
}

/// Returns the pose of a camera at `centre` that views `target`, with z upwards in the image.
pub(super) fn look_at(centre: DVec3, target: DVec3) -> Pose {
    let forward = (target - centre).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let down = forward.cross(right);
    let world_from_camera = DQuat::from_mat3(&DMat3::from_cols(right, down, forward)).normalize();
    Pose {
        rotation: world_from_camera,
        translation: centre,
    }
    .inverse()
}

/// Adds sensor noise to exact colour and depth; the mask stays exact.
pub(super) fn spoil(view: &mut RenderedView, noise: &SensorNoise, seed: u64) {
    let width = view.image.width as usize;
    let exact = view.depth.clone();
    view.depth
        .depths
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, depths)| {
            let mut dice = Dice::new(seed, 1000 + 2 * row as u64);
            for (column, depth) in depths.iter_mut().enumerate() {
                *depth = measured_depth(&exact, column, row, noise, &mut dice);
            }
        });
    view.image
        .pixels
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, pixels)| {
            let mut dice = Dice::new(seed, 1001 + 2 * row as u64);
            for pixel in pixels {
                *pixel =
                    pixel.map(|v| (f64::from(v) + noise.color_sigma * dice.normal()).round() as u8);
            }
        });
}

fn measured_depth(
    exact: &DepthMap,
    column: usize,
    row: usize,
    noise: &SensorNoise,
    dice: &mut Dice,
) -> f32 {
    let at = |x: usize, y: usize| f64::from(exact.depths[y * exact.width as usize + x]);
    let depth = at(column, row);
    if depth <= 0.0 {
        return 0.0;
    }
    let (right, below) = (
        (column + 1).min(exact.width as usize - 1),
        (row + 1).min(exact.height as usize - 1),
    );
    let around = [
        (column.saturating_sub(1), row),
        (right, row),
        (column, row.saturating_sub(1)),
        (column, below),
    ];
    let (low, high) = around
        .iter()
        .map(|&(x, y)| at(x, y))
        .fold((depth, depth), |(l, h), z| (l.min(z), h.max(z)));
    let draw = dice.range(0.0, 1.0);
    let mixed = match high - low > noise.edge_m {
        true if draw < noise.missing => return 0.0,
        true if draw < noise.missing + noise.flying => dice.range(low, high),
        _ => depth,
    };
    let deviation = noise.depth_base_m + noise.depth_growth * (mixed - 0.4).powi(2);
    let noisy = mixed + deviation * dice.normal();
    ((noisy / noise.step_m).round() * noise.step_m).max(0.0) as f32
}
