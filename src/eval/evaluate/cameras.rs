use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, bail};
use serde::Serialize;

use ostra_frames::cameras::{CameraKey, GivenCamera, GivenCameras};
use ostra_geometry::{Alignment, Pose, TrajectoryMetrics};

/// Errors of estimated cameras with respect to the ground truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraScore {
    /// Number of ground truth cameras.
    pub truth: usize,
    /// Number of cameras in the result.
    pub result: usize,
    /// Names of the ground truth cameras that the result lacks.
    pub missing: Vec<String>,
    /// Errors over the cameras that both have.
    pub error: TrajectoryMetrics,
    /// Root mean square of the centre errors, in per cent of the extent of the ground truth.
    ///
    /// The extent is the largest distance of a ground truth centre from the centroid.
    pub centre_percent: f64,
}

/// Compares two sets of cameras in any readable format.
///
/// Cameras are matched by image name without extension, otherwise by file name, number or time.
/// With `turns`, the alignment uses the orientations in addition to the centres.
///
/// # Errors
/// Returns an error if a file cannot be read, if no camera matches, or if too few match for the
/// alignment.
pub fn score_cameras(
    truth: &Path,
    result: &Path,
    alignment: Alignment,
    turns: bool,
) -> Result<CameraScore> {
    let posed = |path: &Path| -> Result<Vec<GivenCamera>> {
        let all = GivenCameras::read(path)?.cameras.into_iter();
        Ok(all
            .filter(|camera| camera.camera_from_world.is_ok())
            .collect())
    };
    let (truth_cameras, result_cameras) = (posed(truth)?, posed(result)?);
    let found = index(&result_cameras, full_key);
    let found_by_file = index(&result_cameras, file_key);
    let mut pairs: Vec<(Pose, Pose)> = Vec::new();
    let mut missing = Vec::new();
    for camera in &truth_cameras {
        let partner = found
            .get(&full_key(&camera.key))
            .or_else(|| found_by_file.get(&file_key(&camera.key)));
        match partner.copied().flatten() {
            Some(GivenCamera {
                camera_from_world: Ok(other),
                ..
            }) => {
                pairs.extend(camera.camera_from_world.iter().map(|pose| (*other, *pose)));
            }
            _ => missing.push(full_key(&camera.key)),
        }
    }
    if pairs.is_empty() {
        bail!(
            "no camera of {} is in {} ({} and {}, for example); give cameras of the same images",
            truth.display(),
            result.display(),
            full_key(&truth_cameras[0].key),
            full_key(&result_cameras[0].key)
        );
    }
    let (result_poses, truth_poses): (Vec<Pose>, Vec<Pose>) = pairs.into_iter().unzip();
    let between = if turns {
        TrajectoryMetrics::between_poses
    } else {
        TrajectoryMetrics::between
    };
    let error = between(&result_poses, &truth_poses, alignment)?;
    let centre_percent = 100.0 * error.centre.rmse / error.extent.max(f64::MIN_POSITIVE);
    Ok(CameraScore {
        truth: truth_cameras.len(),
        result: result_cameras.len(),
        missing,
        error,
        centre_percent,
    })
}

/// Indexes cameras by key; the entry is `None` if several cameras share the key.
fn index(
    cameras: &[GivenCamera],
    key: impl Fn(&CameraKey) -> String,
) -> BTreeMap<String, Option<&GivenCamera>> {
    let mut found = BTreeMap::new();
    for camera in cameras {
        found
            .entry(key(&camera.key))
            .and_modify(|entry| *entry = None)
            .or_insert(Some(camera));
    }
    found
}

/// Returns the name without extension, the number, or the time to the microsecond.
fn full_key(key: &CameraKey) -> String {
    match key {
        CameraKey::Name(name) => {
            let file_at = name.rfind('/').map_or(0, |at| at + 1);
            let stem_end = name[file_at..]
                .rfind('.')
                .filter(|&at| at > 0)
                .map_or(name.len(), |at| file_at + at);
            name[..stem_end].to_owned()
        }
        CameraKey::Index(number) => number.to_string(),
        CameraKey::Time(time) => format!("{time:.6}"),
    }
}

/// Returns the file name without folder and extension.
///
/// Leading zeros of numbers are removed, so that they match formats with camera indices.
fn file_key(key: &CameraKey) -> String {
    let full = full_key(key);
    let file = full.rsplit('/').next().unwrap_or_default();
    file.parse::<u64>()
        .map_or_else(|_| file.to_owned(), |number| number.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_match_across_folders_extensions_and_numbers() {
        let name = |text: &str| CameraKey::Name(text.into());
        assert_eq!(full_key(&name("a/b.c.png")), "a/b.c");
        assert_eq!(full_key(&name("a.b/c")), "a.b/c");
        assert_eq!(
            file_key(&name("color/000012.png")),
            file_key(&CameraKey::Index(12))
        );
    }
}
