use glam::DVec2;

use super::{Focal, GivenIntrinsics};
use ostra_geometry::{Camera, Distortion};

/// The camera models of COLMAP 4.2 with their parameter counts, in the order of their numbers.
///
/// Unsupported models are listed so that binary files with them can be read past.
const MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
];

const SUPPORTED: [&str; 8] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "FULL_OPENCV",
    "OPENCV_FISHEYE",
    "THIN_PRISM_FISHEYE",
];

/// Returns the name of a binary file's model, or its number if it is unknown.
pub fn model_name(number: i32) -> String {
    usize::try_from(number)
        .ok()
        .and_then(|i| MODELS.get(i))
        .map_or_else(
            || format!("number {number}"),
            |(name, _)| (*name).to_owned(),
        )
}

/// Returns the number under which a model is written.
pub fn model_number(name: &str) -> i32 {
    MODELS
        .iter()
        .position(|&(known, _)| known == name)
        .map_or(-1, |number| number as i32)
}

/// Returns the number of parameters of a model, supported or not.
pub fn parameter_count(model: &str) -> Result<usize, String> {
    let known = MODELS.iter().find(|(name, _)| *name == model);
    known
        .map(|&(_, count)| count)
        .ok_or_else(|| unsupported(model))
}

fn unsupported(model: &str) -> String {
    format!(
        "camera model {model} is not supported; undistort the images or use one of {}",
        SUPPORTED.join(", ")
    )
}

/// Returns the intrinsics for a model's name, size and parameters in COLMAP's order.
pub fn intrinsics(model: &str, size: [u64; 2], p: &[f64]) -> Result<GivenIntrinsics, String> {
    if !SUPPORTED.contains(&model) {
        return Err(unsupported(model));
    }
    let count = parameter_count(model)?;
    if p.len() != count {
        return Err(format!(
            "a {model} camera has {count} parameters, not {}; check that the file is whole",
            p.len()
        ));
    }
    if p.iter().any(|v| !v.is_finite()) {
        return Err("a camera parameter is not a finite number; remove or repair it".into());
    }
    let side = |side: u64| {
        u32::try_from(side)
            .ok()
            .filter(|&side| (1..=Camera::MAX_SIDE).contains(&side))
    };
    let Some(size) = side(size[0])
        .zip(side(size[1]))
        .map(|(width, height)| [width, height])
    else {
        return Err(format!(
            "an image size of {} × {} pixels is not possible for a camera; sides are 1 to {}",
            size[0],
            size[1],
            Camera::MAX_SIDE
        ));
    };
    let single = matches!(model, "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL");
    let (focal, rest) = if single {
        ([p[0], p[0]], &p[1..])
    } else {
        ([p[0], p[1]], &p[2..])
    };
    let (principal, d) = (DVec2::new(rest[0], rest[1]), &rest[2..]);
    let distortion = match model {
        "SIMPLE_RADIAL" => Distortion::Radial { k: [d[0], 0.0] },
        "RADIAL" => Distortion::Radial { k: [d[0], d[1]] },
        "OPENCV" => Distortion::OpenCv {
            k: [d[0], d[1]],
            p: [d[2], d[3]],
        },
        "FULL_OPENCV" => Distortion::FullOpenCv {
            k: [d[0], d[1], d[4], d[5], d[6], d[7]],
            p: [d[2], d[3]],
        },
        "OPENCV_FISHEYE" => Distortion::OpenCvFisheye {
            k: [d[0], d[1], d[2], d[3]],
        },
        "THIN_PRISM_FISHEYE" => Distortion::ThinPrismFisheye {
            k: [d[0], d[1], d[4], d[5]],
            p: [d[2], d[3]],
            s: [d[6], d[7]],
        },
        _ => Distortion::None,
    };
    Ok(GivenIntrinsics {
        size: Some(size),
        focal: Focal::Pixels(DVec2::from(focal)),
        principal_px: Some(principal),
        distortion,
    })
}

/// Returns the model and parameters under which a camera is written.
pub fn model_and_parameters(camera: &Camera) -> (&'static str, Vec<f64>) {
    let (f, c) = (camera.focal_px, camera.principal_px);
    let with = |rest: &[f64]| [&[f.x, f.y, c.x, c.y], rest].concat();
    match camera.distortion {
        Distortion::None => ("PINHOLE", with(&[])),
        Distortion::Radial { k } if f.x == f.y => ("RADIAL", vec![f.x, c.x, c.y, k[0], k[1]]),
        Distortion::Radial { k } => ("OPENCV", with(&[k[0], k[1], 0.0, 0.0])),
        Distortion::OpenCv { k, p } => ("OPENCV", with(&[k[0], k[1], p[0], p[1]])),
        Distortion::FullOpenCv { k, p } => (
            "FULL_OPENCV",
            with(&[k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5]]),
        ),
        Distortion::OpenCvFisheye { k } => ("OPENCV_FISHEYE", with(&k)),
        Distortion::ThinPrismFisheye { k, p, s } => (
            "THIN_PRISM_FISHEYE",
            with(&[k[0], k[1], p[0], p[1], k[2], k[3], s[0], s[1]]),
        ),
    }
}
