use glam::DVec2;

use super::{Focal, GivenIntrinsics};
use crate::geometry::{Camera, Distortion};

/// The COLMAP camera models by number, as its binary files name them.
const NAMES: [&str; 12] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
];

const SUPPORTED: &str =
    "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, THIN_PRISM_FISHEYE";

/// The name of a model of a binary file; its number where it is not known.
pub fn model_name(number: i32) -> String {
    usize::try_from(number)
        .ok()
        .and_then(|i| NAMES.get(i))
        .map_or_else(|| format!("number {number}"), ToString::to_string)
}

/// The number of a model that is written.
pub fn model_number(name: &str) -> i32 {
    NAMES.iter().position(|&known| known == name).map_or(-1, |number| number as i32)
}

/// Number of parameters of a supported model.
pub fn parameter_count(model: &str) -> Result<usize, String> {
    match model {
        "SIMPLE_PINHOLE" => Ok(3),
        "PINHOLE" | "SIMPLE_RADIAL" => Ok(4),
        "RADIAL" => Ok(5),
        "OPENCV" | "OPENCV_FISHEYE" => Ok(8),
        "FULL_OPENCV" | "THIN_PRISM_FISHEYE" => Ok(12),
        _ => Err(format!("camera model {model} is not supported; undistort the pictures or use one of {SUPPORTED}")),
    }
}

/// Intrinsics from a model's name, size and parameters in COLMAP's order.
pub fn intrinsics(model: &str, size: [u64; 2], p: &[f64]) -> Result<GivenIntrinsics, String> {
    let count = parameter_count(model)?;
    if p.len() != count {
        return Err(format!("a {model} camera has {count} parameters, not {}; check that the file is whole", p.len()));
    }
    if p.iter().any(|v| !v.is_finite()) {
        return Err("a camera parameter is not a finite number; remove or repair it".into());
    }
    let side = |side: u64| u32::try_from(side).ok().filter(|&s| s > 0).ok_or("a camera has no possible picture size");
    let size = [side(size[0])?, side(size[1])?];
    let single = matches!(model, "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL");
    let (focal, rest) = if single { ([p[0], p[0]], &p[1..]) } else { ([p[0], p[1]], &p[2..]) };
    let (principal, d) = (DVec2::new(rest[0], rest[1]), &rest[2..]);
    let distortion = match model {
        "SIMPLE_RADIAL" => Distortion::Radial { k: [d[0], 0.0] },
        "RADIAL" => Distortion::Radial { k: [d[0], d[1]] },
        "OPENCV" => Distortion::OpenCv { k: [d[0], d[1]], p: [d[2], d[3]] },
        "FULL_OPENCV" => Distortion::FullOpenCv { k: [d[0], d[1], d[4], d[5], d[6], d[7]], p: [d[2], d[3]] },
        "OPENCV_FISHEYE" => Distortion::OpenCvFisheye { k: [d[0], d[1], d[2], d[3]] },
        "THIN_PRISM_FISHEYE" => {
            Distortion::ThinPrismFisheye { k: [d[0], d[1], d[4], d[5]], p: [d[2], d[3]], s: [d[6], d[7]] }
        }
        _ => Distortion::None,
    };
    Ok(GivenIntrinsics {
        size: Some(size),
        focal: Focal::Pixels(DVec2::from(focal)),
        principal_px: Some(principal),
        distortion,
    })
}

/// The model and parameters under which a camera is written.
pub fn model_and_parameters(camera: &Camera) -> (&'static str, Vec<f64>) {
    let (f, c) = (camera.focal_px, camera.principal_px);
    let with = |rest: &[f64]| [&[f.x, f.y, c.x, c.y], rest].concat();
    match camera.distortion {
        Distortion::None => ("PINHOLE", with(&[])),
        Distortion::Radial { k } if f.x == f.y => ("RADIAL", vec![f.x, c.x, c.y, k[0], k[1]]),
        Distortion::Radial { k } => ("OPENCV", with(&[k[0], k[1], 0.0, 0.0])),
        Distortion::OpenCv { k, p } => ("OPENCV", with(&[k[0], k[1], p[0], p[1]])),
        Distortion::FullOpenCv { k, p } => ("FULL_OPENCV", with(&[k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5]])),
        Distortion::OpenCvFisheye { k } => ("OPENCV_FISHEYE", with(&k)),
        Distortion::ThinPrismFisheye { k, p, s } => {
            ("THIN_PRISM_FISHEYE", with(&[k[0], k[1], p[0], p[1], k[2], k[3], s[0], s[1]]))
        }
    }
}
