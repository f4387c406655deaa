use std::collections::{BTreeMap, BTreeSet};

use super::given::shown_camera;
use super::lines::invalid;
use super::tum::TUM_TOLERANCE_S;
use super::{CameraKey, GivenCameras};
use crate::error::first_of;
use crate::name_parts::{file_of, without_ending};
use crate::{Frame, FrameError, ImageSource};

impl GivenCameras {
    /// Gives each frame its camera, rotated like the frame's image, and returns warnings.
    ///
    /// Cameras are matched in these ways, according to their key:
    ///
    /// - by full name, then by file name only where that is unique, both with and without
    ///   extension,
    /// - by number in the name or order,
    /// - by time.
    ///
    /// Pass all frames of the source before some are left out, because trajectories without names
    /// count them. Poses without intrinsics are combined with those of the frame. One warning names
    /// the frames without a camera. On an error no frame is changed.
    ///
    /// # Errors
    ///
    /// [`FrameError::Invalid`] if no frame has a camera; [`FrameError::NotFound`], naming the
    /// frame, for a camera of another size, missing intrinsics or a mirrored image.
    pub fn match_to(&self, frames: &mut [Frame]) -> Result<Vec<String>, FrameError> {
        let assigned = self.assign(frames);
        if assigned.iter().all(Option::is_none) && !frames.is_empty() {
            return Err(invalid(&self.path, self.no_match(frames)));
        }
        let mut cameras = Vec::with_capacity(frames.len());
        for (frame, camera) in frames.iter().zip(&assigned) {
            let given = camera.map(|i| &self.cameras[i]);
            let posed =
                given.and_then(|camera| Some((camera, camera.camera_from_world.as_ref().ok()?)));
            let shown = posed
                .map(|(camera, pose)| shown_camera(frame, camera.intrinsics.as_ref(), Some(pose)));
            cameras.push(shown.transpose()?);
        }
        if cameras.iter().all(Option::is_none) && !frames.is_empty() {
            return Err(invalid(
                &self.path,
                "no frame has a camera with a pose; give the cameras of these images",
            ));
        }
        let warnings = self.warn_of(frames, &assigned);
        for (frame, camera) in frames.iter_mut().zip(cameras) {
            frame.camera = camera.or(frame.camera);
        }
        Ok(warnings)
    }

    /// Returns warnings about frames without a camera, and frames whose camera is unusable.
    fn warn_of(&self, frames: &[Frame], assigned: &[Option<usize>]) -> Vec<String> {
        let (mut missing, mut unusable, mut first_reason) = (Vec::new(), Vec::new(), None);
        for (frame, camera) in frames.iter().zip(assigned) {
            match camera.map(|i| &self.cameras[i].camera_from_world) {
                None => missing.push(frame.name.as_str()),
                Some(Err(reason)) => {
                    unusable.push(frame.name.as_str());
                    first_reason.get_or_insert(reason);
                }
                Some(Ok(_)) => {}
            }
        }
        let (count, path) = (frames.len(), self.path.display());
        let mut warnings = Vec::new();
        if !missing.is_empty() {
            let names = first_of(missing.iter(), ", ");
            warnings.push(format!(
                "{} of {count} frames have no camera in {path}: {names}",
                missing.len()
            ));
        }
        if let Some(reason) = first_reason {
            let (number, names) = (unusable.len(), first_of(unusable.iter(), ", "));
            warnings.push(format!(
                "{number} of {count} frames have no usable camera in {path} and are left without one: {names} ({reason})"
            ));
        }
        warnings
    }

    /// Returns the index of each frame's camera.
    fn assign(&self, frames: &[Frame]) -> Vec<Option<usize>> {
        match self.cameras.first().map(|camera| &camera.key) {
            None => vec![None; frames.len()],
            Some(CameraKey::Name(_)) => by_name(
                &self.keys(|key| match key {
                    CameraKey::Name(name) => Some(name.as_str()),
                    _ => None,
                }),
                frames,
            ),
            Some(CameraKey::Index(_)) => by_number(
                &self.keys(|key| match key {
                    CameraKey::Index(index) => Some(*index),
                    _ => None,
                }),
                frames,
            ),
            Some(CameraKey::Time(_)) => by_time(
                &self.keys(|key| match key {
                    CameraKey::Time(time) => Some(*time),
                    _ => None,
                }),
                frames,
            ),
        }
    }

    fn keys<'a, K>(&'a self, key: impl Fn(&'a CameraKey) -> Option<K>) -> Vec<K> {
        self.cameras
            .iter()
            .filter_map(|camera| key(&camera.key))
            .collect()
    }

    fn no_match(&self, frames: &[Frame]) -> String {
        let keys = self.cameras.iter().map(|camera| match &camera.key {
            CameraKey::Name(name) => name.clone(),
            CameraKey::Index(index) => format!("number {index}"),
            CameraKey::Time(time) => format!("time {time}"),
        });
        let keys = first_of(keys, ", ");
        let names = first_of(frames.iter().map(|frame| &frame.name), ", ");
        format!(
            "no camera belongs to a frame: the cameras are {keys}, the frames {names}; give the cameras of these images"
        )
    }
}

/// Keys of a name, from the most to the least specific; each is used only where it is unique.
const LEVELS: [fn(&str) -> Option<&str>; 6] = [
    whole_name, path_alone, last_two, file_alone, stem, first_part,
];

fn whole_name(name: &str) -> Option<&str> {
    Some(name)
}

fn path_alone(name: &str) -> Option<&str> {
    Some(without_ending(name))
}

/// Returns the folder and file, if there is a folder.
fn last_two(name: &str) -> Option<&str> {
    let mut slashes = name.rmatch_indices('/').map(|(at, _)| at);
    slashes.next()?;
    Some(without_ending(
        slashes.next().map_or(name, |at| &name[at + 1..]),
    ))
}

fn file_alone(name: &str) -> Option<&str> {
    Some(file_of(name))
}

fn stem(name: &str) -> Option<&str> {
    Some(without_ending(file_of(name)))
}

/// Returns `frame-000123` for `frame-000123.color.png`.
fn first_part(name: &str) -> Option<&str> {
    file_of(name).split('.').next()
}

fn by_name(names: &[&str], frames: &[Frame]) -> Vec<Option<usize>> {
    let mut assigned = vec![None; frames.len()];
    for level in LEVELS {
        let cameras = unique(names.iter().map(|name| level(name)));
        let of_frames = unique(frames.iter().map(|frame| level(&frame.name)));
        for (key, frame) in of_frames {
            if assigned[frame].is_none() {
                assigned[frame] = cameras.get(key).copied();
            }
        }
    }
    assigned
}

/// Returns the position of each key that occurs once.
fn unique<'a>(keys: impl Iterator<Item = Option<&'a str>>) -> BTreeMap<&'a str, usize> {
    let mut places: BTreeMap<&str, Option<usize>> = BTreeMap::new();
    for (place, key) in keys
        .enumerate()
        .filter_map(|(place, key)| Some((place, key?)))
    {
        places
            .entry(key)
            .and_modify(|at| *at = None)
            .or_insert(Some(place));
    }
    places
        .into_iter()
        .filter_map(|(key, place)| Some((key, place?)))
        .collect()
}

/// Matches by number, in the first way that works:
///
/// - numbers in names, if they cover all frames,
/// - one camera per frame in order, if there are equally many,
/// - numbers in names counted from another start,
/// - numbers in names, as many as match,
/// - the order of frames.
fn by_number(indices: &[u64], frames: &[Frame]) -> Vec<Option<usize>> {
    let place: BTreeMap<u64, usize> = indices
        .iter()
        .enumerate()
        .map(|(place, &index)| (index, place))
        .collect();
    let numbers = numbers_in_names(frames, &place);
    let shifted = |shift: i64| -> Vec<Option<usize>> {
        let at = |n: &u64| place.get(&n.checked_add_signed(shift)?).copied();
        numbers.as_ref().map_or_else(
            || vec![None; frames.len()],
            |numbers| numbers.iter().map(at).collect(),
        )
    };
    let whole =
        |shift: i64| Some(shifted(shift)).filter(|assigned| assigned.iter().all(Option::is_some));
    let in_order =
        || (frames.len() == place.len()).then(|| place.values().copied().map(Some).collect());
    let some = || Some(shifted(0)).filter(|assigned| assigned.iter().any(Option::is_some));
    let counted = || {
        (0..frames.len() as u64)
            .map(|n| place.get(&n).copied())
            .collect()
    };
    whole(0)
        .or_else(in_order)
        .or_else(|| whole(1))
        .or_else(|| whole(-1))
        .or_else(some)
        .unwrap_or_else(counted)
}

/// Returns the first or the last number of each frame's file name.
///
/// The numbers must all be different; the choice with more matching cameras wins.
fn numbers_in_names(frames: &[Frame], place: &BTreeMap<u64, usize>) -> Option<Vec<u64>> {
    let first = |name: &str| numbers_of(name).next();
    let last = |name: &str| numbers_of(name).last();
    let all = |pick: &dyn Fn(&str) -> Option<u64>| -> Option<Vec<u64>> {
        let numbers: Vec<u64> = frames
            .iter()
            .map(|f| pick(file_of(&f.name)))
            .collect::<Option<_>>()?;
        (numbers.iter().collect::<BTreeSet<_>>().len() == numbers.len()).then_some(numbers)
    };
    let fitting = |numbers: &Vec<u64>| numbers.iter().filter(|n| place.contains_key(n)).count();
    [all(&last), all(&first)]
        .into_iter()
        .flatten()
        .max_by_key(fitting)
}

fn numbers_of(file: &str) -> impl Iterator<Item = u64> {
    without_ending(file)
        .split(|c: char| !c.is_ascii_digit())
        .filter_map(|digits| digits.parse().ok())
}

fn by_time(times: &[f64], frames: &[Frame]) -> Vec<Option<usize>> {
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by(|&a, &b| times[a].total_cmp(&times[b]));
    let nearest = |time: f64| {
        let after = order.partition_point(|&i| times[i] < time);
        let around = [after.checked_sub(1), Some(after)];
        let near = around
            .into_iter()
            .flatten()
            .filter_map(|at| order.get(at).copied());
        near.min_by(|&a, &b| (times[a] - time).abs().total_cmp(&(times[b] - time).abs()))
            .filter(|&i| (times[i] - time).abs() <= TUM_TOLERANCE_S)
    };
    frames
        .iter()
        .map(|frame| time_of(frame).and_then(nearest))
        .collect()
}

/// Returns the time at the end of a frame's name, or its time in a video.
fn time_of(frame: &Frame) -> Option<f64> {
    if let ImageSource::Video { time_s, .. } = frame.image {
        return Some(time_s);
    }
    let name = without_ending(file_of(&frame.name));
    name.rsplit(|c: char| !(c.is_ascii_digit() || c == '.'))
        .next()?
        .parse()
        .ok()
}
