use glam::{DMat3, DQuat, DVec3};
use image::GrayImage;
use tempfile::TempDir;

use super::search::extended;
use super::tilted::{Retry, under_promising_tilts};
use super::*;
use crate::sfm::asift::Tilt;
use crate::sfm::matching::NearestMatcher;
use crate::sfm::pair_selection::match_images;
use crate::sfm::request::SfmRequest;
use crate::sfm::{
    CameraGroups, Features, MapImage, MapProblem, MapperOptions, MatchedImages, PairOptions, Sift,
    map,
};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameCamera, FrameStore, OpenRequest, open};
use ostra_geometry::{Alignment, Camera, Pose, TrajectoryMetrics};

const WIDTH: u32 = 480;
const HEIGHT: u32 = 360;
const FOCAL: f64 = 450.0;

/// Returns a camera above a carpet that faces its middle; angles in degrees.
fn view(azimuth: f64, elevation: f64, distance: f64) -> Pose {
    let (around, up) = (azimuth.to_radians(), elevation.to_radians());
    let centre = distance * DVec3::new(around.sin() * up.cos(), -around.cos() * up.cos(), up.sin());
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let rotation =
        DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward).transpose());
    Pose {
        rotation,
        translation: -(rotation * centre),
    }
}

fn camera() -> Camera {
    Camera::pinhole(
        WIDTH,
        HEIGHT,
        [FOCAL, FOCAL],
        [f64::from(WIDTH) / 2.0, f64::from(HEIGHT) / 2.0],
    )
}

/// Returns the shade of a speckled surface, 0–1.
fn speckles(x: f64, y: f64, seed: i64) -> f64 {
    let corner = |x: f64, y: f64| {
        let mut mixed = (x as i64).wrapping_mul(0x9E37_79B9)
            ^ (y as i64).wrapping_mul(0x85EB_CA6B)
            ^ seed.wrapping_mul(77);
        mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2C1B_3C6D);
        mixed = (mixed ^ (mixed >> 12)).wrapping_mul(0x297A_2D39);
        ((mixed ^ (mixed >> 15)) & 0xffff) as f64 / 65535.0
    };
    let octave = |scale: f64| {
        let (x, y) = (x * scale + 1000.0, y * scale + 1000.0);
        let (u, v) = (x.fract(), y.fract());
        let (u, v) = (u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v));
        let row = |y: f64| corner(x.floor(), y) * (1.0 - u) + corner(x.floor() + 1.0, y) * u;
        row(y.floor()) * (1.0 - v) + row(y.floor() + 1.0) * v
    };
    0.4 * octave(5.0) + 0.6 * octave(13.0)
}

/// Returns the shade of a carpet with a square sheet above its middle.
fn shade(from: DVec3, along: DVec3, seed: i64) -> f64 {
    let at = |height: f64| from + along * ((height - from.z) / along.z);
    let sheet = at(0.4);
    if along.z >= 0.0 {
        0.5
    } else if sheet.x.abs().max(sheet.y.abs()) < 0.6 {
        speckles(sheet.x + 40.0, sheet.y, seed)
    } else {
        speckles(at(0.0).x, at(0.0).y, seed)
    }
}

fn photo(pose: &Pose, seed: i64) -> GrayImage {
    let (camera, back, from) = (camera(), pose.rotation.inverse(), pose.centre());
    GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let offsets = (0..9).map(|i| {
            [
                f64::from(i % 3) / 3.0 + 1.0 / 6.0,
                f64::from(i / 3) / 3.0 + 1.0 / 6.0,
            ]
        });
        let samples = offsets.map(|[dx, dy]| {
            let ray = camera.unproject(glam::DVec2::new(f64::from(x) + dx, f64::from(y) + dy));
            shade(from, back * ray.extend(1.0), seed)
        });
        image::Luma([(255.0 * samples.sum::<f64>() / 9.0).round() as u8])
    })
}

/// Photos of a carpet from above, and one more.
struct Photos {
    _dir: TempDir,
    frames: Vec<Frame>,
    poses: Vec<Pose>,
}

impl Photos {
    fn new(last: Pose, seed_of_last: i64) -> Self {
        let dir = TempDir::new().unwrap();
        let mut poses: Vec<Pose> = (0..5)
            .map(|i| view(14.0 * f64::from(i), 62.0, 3.6))
            .collect();
        poses.push(last);
        for (number, pose) in poses.iter().enumerate() {
            let seed = if number + 1 == poses.len() {
                seed_of_last
            } else {
                1
            };
            photo(pose, seed)
                .save(dir.path().join(format!("{number}.png")))
                .unwrap();
        }
        let request = OpenRequest {
            sources: vec![dir.path().to_path_buf().into()],
            ..OpenRequest::default()
        };
        let mut frames = open(&request, &Progress::default()).unwrap().frames;
        frames
            .iter_mut()
            .for_each(|frame| frame.camera = Some(FrameCamera::given(camera(), None)));
        Self {
            _dir: dir,
            frames,
            poses,
        }
    }

    /// Returns the request to reconstruct them.
    fn request<'a>(&'a self, sift: &'a Sift, nearest: &'a NearestMatcher) -> SfmRequest<'a> {
        SfmRequest {
            frames: &self.frames,
            mapped: &[0, 1, 2, 3, 4, 5],
            located: &[],
            keep_poses: false,
            allowed: &|_| None,
            extractor: sift,
            cached: None,
            matcher: nearest,
            pairs: PairOptions::default(),
            mapper: MapperOptions::default(),
        }
    }

    /// Returns the numbers of the images placed in the first and after the second attempt, and the
    /// error of their centres.
    fn placed(&self, progress: &Progress) -> (Vec<u32>, Vec<u32>, f64) {
        let (store, sift, nearest) = (
            FrameStore::new(16 << 20),
            Sift::default(),
            NearestMatcher::for_bytes(),
        );
        let request = self.request(&sift, &nearest);
        let first = attempt(&request, &store);
        let placed = |attempt: &Attempt| attempt.models[0].model.placed().collect::<Vec<u32>>();
        let before = placed(&first);
        let after = retry_unregistered(first, &request, &store, progress).unwrap();
        let model = &after.models[0].model;
        let found: Vec<Pose> = model.poses.iter().flatten().copied().collect();
        let truth: Vec<Pose> = model
            .placed()
            .map(|image| self.poses[image as usize])
            .collect();
        let error = TrajectoryMetrics::between(&found, &truth, Alignment::Sim3).unwrap();
        for (extracted, image) in after.images.iter().zip(&after.problem.images) {
            assert_eq!(extracted.features.keypoints, image.keypoints);
            assert_eq!(extracted.colors.len(), image.keypoints.len());
        }
        (before, placed(&after), error.centre.max / error.extent)
    }
}

fn attempt(request: &SfmRequest<'_>, store: &FrameStore) -> Attempt {
    let progress = Progress::default();
    let images = request
        .frame_extractor(store)
        .of_frames(request.mapped, &progress)
        .unwrap();
    let groups = CameraGroups::new(&request.frames.iter().collect::<Vec<_>>());
    let features: Vec<&Features> = images.iter().map(|extracted| &extracted.features).collect();
    let cameras: Vec<_> = groups
        .camera_of
        .iter()
        .map(|&camera| groups.cameras[camera])
        .collect();
    let matched = MatchedImages {
        features: &features,
        cameras: &cameras,
        cache: None,
    };
    let options = &request.pairs;
    let tried = match_images(matched, &[], options, request.matcher, 0, &progress).unwrap();
    let image = |features: &&Features| MapImage {
        camera: 0,
        keypoints: features.keypoints.clone(),
        given: None,
    };
    let problem = MapProblem {
        cameras: groups.cameras,
        images: features.iter().map(image).collect(),
        pairs: tried
            .iter()
            .filter_map(|pair| pair.verified.clone())
            .collect(),
    };
    let models = map(&problem, &request.mapper, &progress).unwrap();
    Attempt {
        problem,
        images,
        tried,
        models,
    }
}

#[test]
fn grazing_view_is_placed_by_simulated_tilts() {
    let photos = Photos::new(view(30.0, 15.0, 2.6), 1);
    let (before, after, error) = photos.placed(&Progress::default());
    assert_eq!(
        (before, after),
        (vec![0, 1, 2, 3, 4], vec![0, 1, 2, 3, 4, 5])
    );
    assert!(error < 0.005, "{error:.4}");
}

/// Runs the first attempt, which leaves the last image out, and passes it on.
fn after_first_attempt(
    photos: &Photos,
    check: impl FnOnce(&Attempt, &SfmRequest<'_>, &FrameStore, &Progress),
) {
    let store = FrameStore::new(16 << 20);
    let (sift, nearest) = (Sift::default(), NearestMatcher::for_bytes());
    let request = photos.request(&sift, &nearest);
    let attempt = attempt(&request, &store);
    check(&attempt, &request, &store, &Progress::default());
}

#[test]
fn promising_tilts_place_a_grazing_view() {
    let photos = Photos::new(view(30.0, 15.0, 2.6), 1);
    after_first_attempt(&photos, |attempt, request, store, progress| {
        let gains = under_promising_tilts(attempt, request, store, progress).unwrap();
        let extended = extended(attempt, gains, request, progress).unwrap();
        assert_eq!(extended.unwrap().model.model.placed().count(), 6);
    });
}

#[test]
fn tilts_that_make_up_for_the_view_come_first() {
    // Near the ground, it appears compressed from top to bottom: the tilts compress along the rows.
    let photos = Photos::new(view(30.0, 15.0, 2.6), 1);
    after_first_attempt(&photos, |attempt, request, store, progress| {
        let retry = Retry {
            attempt,
            model: &attempt.models[0].model,
            image: 5,
            seed: request.mapper.seed,
            enough: request.mapper.pose_inliers,
            cached: None,
            progress,
        };
        let views = |tilts: &[Tilt], max_side| {
            let extractor = request.frame_extractor(store);
            extractor.tilted(5, tilts, max_side, progress)
        };
        let ranked = retry.ranked_tilts(&views).unwrap();
        let along_rows = |tilt: &Tilt| tilt.along.min(std::f64::consts::PI - tilt.along) < 0.5;
        let first = &ranked[..3];
        assert!(first.iter().all(along_rows), "{first:?}");
        assert!(first[0].by > 2.0, "{first:?}");
    });
}

#[test]
fn image_of_another_carpet_is_not_placed() {
    let photos = Photos::new(view(30.0, 30.0, 2.6), 2);
    let progress = Progress::default();
    let (before, after, _) = photos.placed(&progress);
    assert_eq!((&before, &after), (&vec![0, 1, 2, 3, 4], &before));
    // It agrees with none of the others under the promising tilts, so the other tilts are not tried.
    let steps = progress.overview().steps;
    let titles: Vec<&str> = steps.iter().map(|step| step.title.as_str()).collect();
    assert_eq!(titles.first(), Some(&"Match left-over images again"));
    assert!(
        !titles.contains(&"Match left-over images under all tilts"),
        "{titles:?}"
    );
}

#[test]
fn stopped_run_keeps_the_first_attempt() {
    let photos = Photos::new(view(30.0, 15.0, 2.6), 1);
    let progress = Progress::default();
    progress.stop();
    let (before, after, _) = photos.placed(&progress);
    assert_eq!((&before, &after), (&vec![0, 1, 2, 3, 4], &before));
}
