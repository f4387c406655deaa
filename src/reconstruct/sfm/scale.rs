use std::collections::BTreeMap;

use super::SfmError;
use ostra_cloud::fuse::naming;
use ostra_core::job::Progress;
use ostra_core::statistics::nth_smallest;
use ostra_frames::cameras::SparsePoints;
use ostra_frames::{Frame, FrameCamera, FrameError, FrameStore};

/// Scale of a model, and its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MetricScale {
    /// World units of the depth maps per unit of the model.
    pub factor: f64,
    /// Half the width, relative to the factor, of the band around it that holds two thirds of the
    /// samples within a factor of 2.
    pub spread: f64,
    /// Number of observations with depth that it was estimated from.
    pub samples: usize,
}

/// Points with a larger mean reprojection error, in pixels, are not used.
const MAX_ERROR_PX: f64 = 2.0;
/// With fewer observations with depth than this, there is no result.
const LEAST_SAMPLES: usize = 30;
/// Width of the kernel in natural logarithms of the scale.
const KERNEL: f64 = 0.01;

/// Mean-shift steps from the fullest bin to the densest position.
const MEAN_SHIFTS: usize = 20;

/// Estimates the scale at which the model agrees with the depth of its frames.
///
/// It is the mode, by kernel density, of depth / z over all observations of points (OSTRA's
/// ScaleCalculator: Xu, Zhao, Tang, Gan, "A One Stop 3D Target Reconstruction and multilevel
/// Segmentation Method"). `None` if too few observations have depth. A line that names the frames
/// with unreadable depth comes with it; these frames are left out.
///
/// # Errors
/// [`SfmError::Stopped`].
pub fn metric_scale(
    frames: &[Frame],
    cameras: &BTreeMap<usize, FrameCamera>,
    sparse: &SparsePoints,
    store: &FrameStore,
    progress: &Progress,
) -> Result<(Option<MetricScale>, Option<String>), SfmError> {
    let (mut logs, mut unreadable) = (Vec::new(), Vec::new());
    for (&number, keypoints) in &sparse.keypoints {
        progress.check()?;
        let frame = &frames[number];
        if !frame.has_sensor_depth() {
            continue;
        }
        let Some(pose) = cameras
            .get(&number)
            .and_then(|camera| camera.camera_from_world)
        else {
            continue;
        };
        let depth = match store.depth(frame) {
            Ok(Some(depth)) => depth,
            Ok(None) => continue,
            Err(FrameError::Stopped(stopped)) => return Err(stopped.into()),
            Err(_) => {
                unreadable.push(frame.name.as_str());
                continue;
            }
        };
        for keypoint in keypoints {
            let Some(point) = keypoint.point.map(|point| &sparse.points[point as usize]) else {
                continue;
            };
            let z = pose.transform(point.position).z;
            let (x, y) = (keypoint.at_px.x as u32, keypoint.at_px.y as u32);
            let known = x < depth.width && y < depth.height && depth.at(x, y) > 0.0 && z > 0.0;
            if known && point.error_px.is_none_or(|error| error <= MAX_ERROR_PX) {
                logs.push((f64::from(depth.at(x, y)) / z).ln());
            }
        }
    }
    let warning = naming(
        [
            "has a depth that cannot be read and does not count for the scale; check its file",
            "have a depth that cannot be read and do not count for the scale; check their files",
        ],
        &unreadable,
    );
    Ok((mode(logs), warning))
}

/// Returns the densest position among logarithms of the scale.
fn mode(mut logs: Vec<f64>) -> Option<MetricScale> {
    if logs.len() < LEAST_SAMPLES {
        return None;
    }
    logs.sort_unstable_by(f64::total_cmp);
    let near = |at: f64, width: f64| {
        let from = logs.partition_point(|&log| log < at - width);
        let to = logs.partition_point(|&log| log <= at + width);
        &logs[from..to]
    };
    let mut at = logs
        .iter()
        .map(|&at| (near(at, KERNEL).len(), at))
        .max_by_key(|&(count, _)| count)?
        .1;
    for _ in 0..MEAN_SHIFTS {
        let weights: Vec<(f64, f64)> = near(at, 4.0 * KERNEL)
            .iter()
            .map(|&log| (kernel((log - at) / KERNEL), log))
            .collect();
        let total: f64 = weights.iter().map(|(weight, _)| weight).sum();
        at = weights
            .iter()
            .map(|(weight, log)| weight * log)
            .sum::<f64>()
            / total;
    }
    let mut distances: Vec<f64> = near(at, 2f64.ln())
        .iter()
        .map(|log| (log - at).abs())
        .collect();
    let place = distances.len() * 2 / 3;
    let spread = nth_smallest(&mut distances, place)?.exp_m1();
    Some(MetricScale {
        factor: at.exp(),
        spread,
        samples: logs.len(),
    })
}

fn kernel(distance: f64) -> f64 {
    (-0.5 * distance * distance).exp()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::{DVec2, DVec3};

    use super::*;
    use ostra_frames::cameras::{SparseKeypoint, SparsePoint};
    use ostra_frames::{DepthSource, ImageSource, Orientation};
    use ostra_geometry::{Camera, Pose};

    /// Returns a frame of 8 × 6 pixels with a depth of 2 m everywhere.
    fn frame(folder: &Path, number: usize) -> Frame {
        let depth =
            image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_pixel(8, 6, image::Luma([2000]));
        let (path, orientation) = (
            folder.join(format!("d{number}.png")),
            Orientation::default(),
        );
        depth.save(&path).unwrap();
        let image = ImageSource::File {
            path: folder.join(format!("c{number}.png")),
            orientation,
        };
        let depth = Some(DepthSource::Sensor {
            path,
            unit: 0.001,
            orientation,
            camera: None,
        });
        Frame {
            name: format!("c{number}.png"),
            width: 8,
            height: 6,
            image,
            depth,
            camera: None,
        }
    }

    #[test]
    fn unreadable_depth_is_named_and_the_others_give_the_scale() {
        let folder = tempfile::tempdir().unwrap();
        let frames: Vec<Frame> = (0..3).map(|number| frame(folder.path(), number)).collect();
        std::fs::write(folder.path().join("d1.png"), "").unwrap();
        let camera = FrameCamera::given(
            Camera::pinhole(8, 6, [8.0, 8.0], [4.0, 3.0]),
            Some(Pose::IDENTITY),
        );
        let point = SparsePoint {
            position: DVec3::Z,
            color: [0; 3],
            error_px: None,
        };
        let seen = vec![
            SparseKeypoint {
                at_px: DVec2::new(4.0, 3.0),
                point: Some(0)
            };
            LEAST_SAMPLES
        ];
        let sparse = SparsePoints {
            points: vec![point],
            keypoints: (0..3).map(|at| (at, seen.clone())).collect(),
        };
        let cameras: BTreeMap<usize, FrameCamera> = (0..3).map(|number| (number, camera)).collect();
        let store = FrameStore::new(1 << 20);
        let (scale, warning) =
            metric_scale(&frames, &cameras, &sparse, &store, &Progress::default()).unwrap();
        let scale = scale.unwrap();
        assert!(
            (scale.factor - 2.0).abs() < 1e-6 && scale.samples == 2 * LEAST_SAMPLES,
            "{scale:?}"
        );
        assert!(warning.is_some_and(
            |line| line.starts_with("1 frame has a depth") && line.ends_with(": c1.png")
        ));
    }

    #[test]
    fn mode_is_found_among_outliers() {
        // Two thirds agree on 2.5 within 1 %; a third is spread widely (depth behind or in front of
        // the point).
        let logs = (0..300).map(|i| {
            let spread = f64::from(i % 100) / 50.0 - 1.0;
            2.5f64.ln()
                + if i % 3 < 2 {
                    0.01 * spread
                } else {
                    0.5 + 0.4 * spread
                }
        });
        let scale = mode(logs.collect()).unwrap();
        assert!((scale.factor / 2.5 - 1.0).abs() < 3e-3, "{scale:?}");
        assert_eq!(scale.samples, 300);
    }

    #[test]
    fn too_few_samples_give_no_scale() {
        assert_eq!(mode(vec![0.3; LEAST_SAMPLES - 1]), None);
    }
}
