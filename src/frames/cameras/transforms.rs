use std::path::Path;

use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::lines::{TextFile, invalid, pose_from_rows};
use super::{CameraKey, Focal, GivenCamera, GivenIntrinsics};
use crate::frames::FrameError;
use crate::geometry::{Distortion, GeometryError, Pose};

/// `transforms.json` of nerfstudio and instant-ngp: camera-to-world with OpenGL axes (y up, looking along −z).
#[derive(Debug, Deserialize)]
struct Transforms {
    frames: Vec<TransformsFrame>,
    #[serde(flatten)]
    lens: Lens,
}

#[derive(Debug, Deserialize)]
struct TransformsFrame {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    lens: Lens,
}

/// Intrinsics, for all frames or for one of them.
#[derive(Debug, Clone, Default, Deserialize)]
struct Lens {
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    camera_angle_x: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
}

/// Reads a `transforms.json`.
pub fn read(path: &Path) -> Result<Vec<GivenCamera>, FrameError> {
    let file = TextFile::read(path)?;
    let transforms: Transforms = serde_json::from_str(&file.text)
        .map_err(|error| invalid(path, format!("is no transforms.json that can be read ({error}); check the file")))?;
    let one = |frame: &TransformsFrame| {
        read_frame(frame, &transforms.lens).map_err(|what| invalid(path, format!("{}: {what}", frame.file_path)))
    };
    transforms.frames.iter().map(one).collect()
}

fn read_frame(frame: &TransformsFrame, shared: &Lens) -> Result<GivenCamera, String> {
    let rows: Vec<f64> = frame.transform_matrix.concat();
    if frame.transform_matrix.iter().any(|row| row.len() != 4) || !matches!(rows.len(), 12 | 16) {
        return Err("its transform_matrix is not 4x4; check the file".into());
    }
    let pose = pose_from_opengl(&rows).map_err(|error| error.to_string())?;
    let name = frame.file_path.replace('\\', "/");
    let key = CameraKey::Name(name.trim_start_matches("./").to_owned());
    Ok(GivenCamera { key, intrinsics: frame.lens.or(shared).intrinsics()?, camera_from_world: pose })
}

/// `camera_from_world` with OpenCV axes from a camera-to-world matrix with OpenGL axes.
fn pose_from_opengl(rows: &[f64]) -> Result<Pose, GeometryError> {
    let world_from_camera = pose_from_rows(rows)?;
    let half_turn = glam::DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    Ok(world_from_camera.compose(&Pose { rotation: half_turn, translation: DVec3::ZERO }).inverse())
}

impl Lens {
    /// What this one says, and where it is silent what `shared` says.
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
            camera_model: self.camera_model.clone().or_else(|| shared.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(shared.is_fisheye),
        }
    }

    /// `None` where no focal length is given.
    fn intrinsics(&self) -> Result<Option<GivenIntrinsics>, String> {
        let focal = match (self.fl_x, self.camera_angle_x) {
            (Some(fx), _) => Focal::Pixels(DVec2::new(fx, self.fl_y.unwrap_or(fx))),
            (None, Some(angle)) => Focal::AngleX(angle),
            (None, None) => return Ok(None),
        };
        let size = self.w.zip(self.h).map(|(w, h)| [w as u32, h as u32]);
        let principal_px = self.cx.zip(self.cy).map(|(cx, cy)| DVec2::new(cx, cy));
        Ok(Some(GivenIntrinsics { size, focal, principal_px, distortion: self.distortion()? }))
    }

    fn distortion(&self) -> Result<Distortion, String> {
        let k = [self.k1, self.k2, self.k3, self.k4].map(Option::unwrap_or_default);
        let p = [self.p1, self.p2].map(Option::unwrap_or_default);
        if k.iter().chain(&p).any(|v| !v.is_finite()) {
            return Err("a distortion parameter is not a finite number; remove or repair it".into());
        }
        let fisheye = match self.camera_model.as_deref() {
            None => self.is_fisheye == Some(true),
            Some("OPENCV_FISHEYE") => true,
            Some(
                "OPENCV" | "FULL_OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "PERSPECTIVE",
            ) => false,
            Some(other) => {
                return Err(format!("camera model {other} is not supported; undistort the pictures or use OPENCV"));
            }
        };
        match (fisheye, k, p) {
            (true, _, _) => Ok(Distortion::OpenCvFisheye { k }),
            (false, [0.0, 0.0, 0.0, 0.0], [0.0, 0.0]) => Ok(Distortion::None),
            (false, [k1, k2, 0.0, 0.0], _) => Ok(Distortion::OpenCv { k: [k1, k2], p }),
            (false, [k1, k2, k3, 0.0], _) => Ok(Distortion::FullOpenCv { k: [k1, k2, k3, 0.0, 0.0, 0.0], p }),
            _ => Err("k4 fits only a fisheye lens; undistort the pictures or set camera_model".into()),
        }
    }
}
