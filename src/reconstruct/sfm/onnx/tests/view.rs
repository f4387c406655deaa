use std::path::Path;

use glam::{DMat3, DVec2, DVec3};

use crate::sfm::Features;

/// An image with its true camera.
pub struct View {
    pub grey: Vec<f32>,
    pub width: usize,
    pub height: usize,
    intrinsics: DMat3,
    rotation: DMat3,
    shift: DVec3,
}

impl View {
    /// Reads a view from the folder of the set `dtu_scan24`.
    pub fn read(data: &Path, index: usize) -> Self {
        let text = std::fs::read_to_string(data.join("cameras.json")).unwrap();
        let cameras: serde_json::Value = serde_json::from_str(&text).unwrap();
        let frame = &cameras["frames"][index];
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let matrix = |name: &str| {
            DMat3::from_cols_array(&std::array::from_fn(|at| {
                number(&frame[name][at % 3][at / 3])
            }))
        };
        let mut intrinsics = matrix("K");
        // The set's pixel centres are at whole numbers.
        intrinsics.z_axis += DVec3::new(0.5, 0.5, 0.0);
        let shift = DVec3::from_array(std::array::from_fn(|row| {
            number(&frame["world_to_cam"][row][3])
        }));
        let image = image::open(data.join(frame["image"].as_str().unwrap()))
            .unwrap()
            .into_rgb32f();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let grey = image
            .pixels()
            .map(|pixel| pixel.0.iter().sum::<f32>() / 3.0)
            .collect();
        Self {
            grey,
            width,
            height,
            intrinsics,
            rotation: matrix("world_to_cam"),
            shift,
        }
    }

    /// Returns distances of matches from the true epipolar geometry in pixels (Sampson), ascending.
    pub fn errors(
        &self,
        other: &Self,
        features: [&Features; 2],
        matches: &[(u32, u32)],
    ) -> Vec<f64> {
        let fundamental = self.fundamental(other);
        let error = |&(first, second): &(u32, u32)| {
            let (a, b) = (
                features[0].keypoints[first as usize],
                features[1].keypoints[second as usize],
            );
            sampson(fundamental, a, b)
        };
        let mut errors: Vec<f64> = matches.iter().map(error).collect();
        errors.sort_by(f64::total_cmp);
        errors
    }

    fn fundamental(&self, other: &Self) -> DMat3 {
        let rotation = other.rotation * self.rotation.transpose();
        let shift = other.shift - rotation * self.shift;
        let cross = DMat3::from_cols_array(&[
            0.0, shift.z, -shift.y, -shift.z, 0.0, shift.x, shift.y, -shift.x, 0.0,
        ]);
        other.intrinsics.inverse().transpose() * cross * rotation * self.intrinsics.inverse()
    }
}

fn sampson(fundamental: DMat3, a: DVec2, b: DVec2) -> f64 {
    let (a, b) = (a.extend(1.0), b.extend(1.0));
    let (in_b, in_a) = (fundamental * a, fundamental.transpose() * b);
    let slope = in_b.truncate().length_squared() + in_a.truncate().length_squared();
    b.dot(in_b).abs() / slope.sqrt()
}
