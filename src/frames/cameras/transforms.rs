use std::path::Path;

use glam::{DVec2, DVec3};
use serde::Deserialize;
use serde_json::Value;

use super::lines::{TextFile, invalid, pose_from_rows, usual_spelling};
use super::{CameraKey, Focal, GivenCamera, GivenIntrinsics};
use crate::FrameError;
use ostra_geometry::{Distortion, GeometryError, Pose};

/// `transforms.json` of nerfstudio and instant-ngp.
///
/// Poses are camera-to-world with OpenGL axes (y up, looking along −z).
#[derive(Debug, Deserialize)]
struct Transforms {
    frames: Vec<TransformsFrame>,
    #[serde(flatten)]
    lens: Lens,
}

#[derive(Debug, Deserialize)]
struct TransformsFrame {
    file_path: String,
    transform_matrix: Vec<Vec<Number>>,
    #[serde(flatten)]
    lens: Lens,
}

/// Intrinsics for all frames or for one of them.
#[derive(Debug, Clone, Default, Deserialize)]
struct Lens {
    w: Option<Number>,
    h: Option<Number>,
    fl_x: Option<Number>,
    fl_y: Option<Number>,
    cx: Option<Number>,
    cy: Option<Number>,
    camera_angle_x: Option<Number>,
    k1: Option<Number>,
    k2: Option<Number>,
    k3: Option<Number>,
    k4: Option<Number>,
    p1: Option<Number>,
    p2: Option<Number>,
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
}

/// A number, or a number written as a string; `NaN` and `Infinity` are allowed, too.
///
/// JavaScript writes `null` for NaN.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "Value")]
struct Number(f64);

impl TryFrom<Value> for Number {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let number = match &value {
            Value::String(text) => usual_spelling(text.trim()).parse().ok(),
            Value::Null => Some(f64::NAN),
            value => value.as_f64(),
        };
        number
            .map(Self)
            .ok_or_else(|| format!("{value} is not a number"))
    }
}

/// Puts quotes around `NaN`, `-Infinity` and other spellings of non-finite numbers.
///
/// Python and C++ programs write them into JSON, which does not have such numbers.
fn with_quoted_numbers(json: &str) -> String {
    let mut quoted = String::with_capacity(json.len());
    let (mut rest, mut in_string) = (json, false);
    while let Some(first) = rest.chars().next() {
        let word = if in_string {
            ""
        } else {
            rest.split(is_between_words).next().unwrap_or_default()
        };
        let is_special = usual_spelling(word)
            .parse::<f64>()
            .is_ok_and(|number| !number.is_finite());
        let length = match first {
            '\\' if in_string => 1 + rest.chars().nth(1).map_or(0, char::len_utf8),
            _ if word.is_empty() => first.len_utf8(),
            _ => word.len(),
        };
        in_string ^= first == '"';
        let (taken, after) = rest.split_at(length);
        if is_special {
            quoted.extend(["\"", taken, "\""]);
        } else {
            quoted.push_str(taken);
        }
        rest = after;
    }
    quoted
}

fn is_between_words(c: char) -> bool {
    c.is_whitespace() || matches!(c, ',' | ':' | '[' | ']' | '{' | '}' | '"')
}

/// Reads a `transforms.json`.
pub fn read(path: &Path) -> Result<Vec<GivenCamera>, FrameError> {
    let file = TextFile::read(path)?;
    let transforms: Transforms =
        serde_json::from_str(&with_quoted_numbers(&file.text)).map_err(|error| {
            invalid(
                path,
                format!("cannot be read as transforms.json ({error}); check the file"),
            )
        })?;
    let one = |frame: &TransformsFrame| {
        read_frame(frame, &transforms.lens)
            .map_err(|what| invalid(path, format!("{}: {what}", frame.file_path)))
    };
    transforms.frames.iter().map(one).collect()
}

fn number_or_zero(number: Option<Number>) -> f64 {
    number.map_or(0.0, |Number(number)| number)
}

fn read_frame(frame: &TransformsFrame, shared: &Lens) -> Result<GivenCamera, String> {
    let rows: Vec<f64> = frame
        .transform_matrix
        .concat()
        .into_iter()
        .map(|Number(number)| number)
        .collect();
    if frame.transform_matrix.iter().any(|row| row.len() != 4) || !matches!(rows.len(), 12 | 16) {
        return Err("its transform_matrix is not 4x4; check the file".into());
    }
    let pose = pose_from_opengl(&rows).map_err(|error| format!("{}: {error}", frame.file_path));
    let name = frame.file_path.replace('\\', "/");
    let key = CameraKey::Name(name.trim_start_matches("./").to_owned());
    // An unusable lens only affects its own frame.
    let (intrinsics, camera_from_world) = match frame.lens.or(shared).intrinsics() {
        Ok(intrinsics) => (intrinsics, pose),
        Err(what) => (None, Err(format!("{}: {what}", frame.file_path))),
    };
    Ok(GivenCamera {
        key,
        intrinsics,
        camera_from_world,
    })
}

/// Returns `camera_from_world` with OpenCV axes for a camera-to-world matrix with OpenGL axes.
fn pose_from_opengl(rows: &[f64]) -> Result<Pose, GeometryError> {
    let world_from_camera = pose_from_rows(rows)?;
    let half_turn = glam::DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    Ok(world_from_camera
        .compose(&Pose {
            rotation: half_turn,
            translation: DVec3::ZERO,
        })
        .inverse())
}

impl Lens {
    /// Returns these values, and those of `shared` where they are missing.
    fn or(&self, shared: &Self) -> Self {
        Self {
            w: self.w.or(shared.w),
            h: self.h.or(shared.h),
            fl_x: self.fl_x.or(shared.fl_x),
            fl_y: self.fl_y.or(shared.fl_y),
            cx: self.cx.or(shared.cx),
            cy: self.cy.or(shared.cy),
            camera_angle_x: self.camera_angle_x.or(shared.camera_angle_x),
            k1: self.k1.or(shared.k1),
            k2: self.k2.or(shared.k2),
            k3: self.k3.or(shared.k3),
            k4: self.k4.or(shared.k4),
            p1: self.p1.or(shared.p1),
            p2: self.p2.or(shared.p2),
            camera_model: self
                .camera_model
                .clone()
                .or_else(|| shared.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(shared.is_fisheye),
        }
    }

    /// Returns the intrinsics; `None` if no focal length is given.
    fn intrinsics(&self) -> Result<Option<GivenIntrinsics>, String> {
        let focal = match (self.fl_x, self.camera_angle_x) {
            (Some(fx), _) => Focal::Pixels(DVec2::new(fx.0, self.fl_y.unwrap_or(fx).0)),
            (None, Some(angle)) => Focal::AngleX(angle.0),
            (None, None) => return Ok(None),
        };
        let size = self.w.zip(self.h).map(|(w, h)| [w.0 as u32, h.0 as u32]);
        let principal_px = self.cx.zip(self.cy).map(|(cx, cy)| DVec2::new(cx.0, cy.0));
        Ok(Some(GivenIntrinsics {
            size,
            focal,
            principal_px,
            distortion: self.distortion()?,
        }))
    }

    fn distortion(&self) -> Result<Distortion, String> {
        let k = [self.k1, self.k2, self.k3, self.k4].map(number_or_zero);
        let p = [self.p1, self.p2].map(number_or_zero);
        if k.iter().chain(&p).any(|v| !v.is_finite()) {
            return Err(
                "a distortion parameter is not a finite number; remove or repair it".into(),
            );
        }
        let fisheye = match self.camera_model.as_deref() {
            None => self.is_fisheye == Some(true),
            Some("OPENCV_FISHEYE") => true,
            Some(
                "OPENCV" | "FULL_OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL"
                | "RADIAL" | "PERSPECTIVE",
            ) => false,
            Some(other) => {
                return Err(format!(
                    "camera model {other} is not supported; undistort the images or use OPENCV"
                ));
            }
        };
        match (fisheye, k, p) {
            (true, _, _) => Ok(Distortion::OpenCvFisheye { k }),
            (false, [0.0, 0.0, 0.0, 0.0], [0.0, 0.0]) => Ok(Distortion::None),
            (false, [k1, k2, 0.0, 0.0], _) => Ok(Distortion::OpenCv { k: [k1, k2], p }),
            (false, [k1, k2, k3, 0.0], _) => Ok(Distortion::FullOpenCv {
                k: [k1, k2, k3, 0.0, 0.0, 0.0],
                p,
            }),
            _ => {
                Err("k4 fits only a fisheye lens; undistort the images or set camera_model".into())
            }
        }
    }
}
