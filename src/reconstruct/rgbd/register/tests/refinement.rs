use glam::{DQuat, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::room::{SyntheticRoom, VOXEL, error, moved};
use crate::rgbd::register::{OrientedCloud, RefineOptions, Refined, refine_registration};
use ostra_core::job::Progress;
use ostra_geometry::Pose;

const OPTIONS: RefineOptions = RefineOptions {
    voxel: VOXEL,
    lambda_geometric: 0.968,
};

fn refine(clouds: [&OrientedCloud; 2], start: &Pose, options: &RefineOptions) -> Option<Refined> {
    refine_registration(clouds[0], clouds[1], start, options, &Progress::default()).unwrap()
}

/// Returns a pose with the error that a global alignment may have.
fn off(truth: &Pose, degrees: f64, shift: f64) -> Pose {
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, -0.48, 0.64), degrees.to_radians());
    let middle = DVec3::new(2.1, 1.5, 0.9);
    let translation = middle - turn * middle + shift * DVec3::new(0.48, 0.6, 0.64);
    Pose {
        rotation: turn,
        translation,
    }
    .compose(truth)
}

#[test]
fn rough_pose_becomes_exact_with_and_without_brightness() {
    for seed in 0..4 {
        let (source, target, truth) = SyntheticRoom::pair(seed, 2500.0);
        for lambda_geometric in [1.0, 0.968] {
            let options = RefineOptions {
                lambda_geometric,
                ..OPTIONS
            };
            let found = refine([&source, &target], &off(&truth, 2.0, 0.06), &options).unwrap();
            let (turn, shift) = error(&found.target_from_source, &truth);
            assert!(
                turn < 0.05 && shift < 1e-3,
                "{seed} {lambda_geometric}: {turn}° {shift} m"
            );
            assert!(
                (0.45..0.65).contains(&found.fitness) && found.rmse < 0.008,
                "{found:?}"
            );
            assert!(
                found.observability > 0.04 && found.correlation.unwrap() > 0.95,
                "{found:?}"
            );
        }
    }
}

/// Returns a wall of 3 m × 3 m with different points for each seed.
fn wall(seed: u64, brightness: impl Fn(Vec3) -> f32) -> OrientedCloud {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut cloud = OrientedCloud::default();
    for _ in 0..20_000 {
        let [x, y] = [0, 1].map(|_| random.random_range(0.0..3.0f32));
        cloud
            .positions
            .push(Vec3::new(x, y, random.random_range(-1e-3..1e-3)));
        cloud
            .intensities
            .push(brightness(cloud.positions[cloud.positions.len() - 1]));
    }
    cloud.normals = vec![Vec3::Z; 20_000];
    cloud
}

fn pattern(place: Vec3) -> f32 {
    0.5 + 0.2 * (place.x * 5.0).sin() + 0.2 * (place.y * 6.0 + 1.0).sin()
}

#[test]
fn wall_slides_unless_brightness_constrains_it() {
    let [source, target] = [1, 2].map(|seed| wall(seed, pattern));
    let start = Pose {
        rotation: DQuat::from_rotation_z(0.01),
        translation: DVec3::new(0.04, -0.03, 0.03),
    };
    let plain = refine(
        [&source, &target],
        &start,
        &RefineOptions {
            lambda_geometric: 1.0,
            ..OPTIONS
        },
    )
    .unwrap();
    assert!(
        plain.target_from_source.translation.x > 0.02 && plain.observability < 1e-3,
        "{plain:?}"
    );
    let found = refine([&source, &target], &start, &OPTIONS).unwrap();
    let moved = found.target_from_source;
    assert!(
        moved.translation.length() < 2e-3 && moved.rotation.to_scaled_axis().length() < 1e-3,
        "{found:?}"
    );
    assert!(found.correlation.unwrap() > 0.99 && found.correlation > plain.correlation);
}

#[test]
fn misaligned_brightness_does_no_harm() {
    let (mut source, target, truth) = SyntheticRoom::pair(2, 2500.0);
    let shift = Pose {
        translation: DVec3::new(0.05, 0.02, -0.04),
        ..Pose::IDENTITY
    };
    let adjacent = moved(&target, &shift);
    let tree = ostra_cloud::points::Neighbours::new(&adjacent.positions).unwrap();
    for (place, intensity) in source.positions.iter().zip(&mut source.intensities) {
        *intensity =
            adjacent.intensities[tree.nearest(truth.transform(place.as_dvec3()).as_vec3()).0];
    }
    let found = refine([&source, &target], &off(&truth, 1.0, 0.03), &OPTIONS).unwrap();
    let (turn, shift) = error(&found.target_from_source, &truth);
    assert!(turn < 0.3 && shift < 0.02, "{turn}° {shift} m {found:?}");
}

#[test]
fn information_is_the_sum_of_squared_point_motions() {
    let (source, target, truth) = SyntheticRoom::pair(4, 300.0);
    let found = refine([&source, &target], &truth, &OPTIONS).unwrap();
    let count = found.information[3][3];
    assert_eq!(
        count,
        (found.fitness * source.thinned(VOXEL / 4.0).positions.len() as f64).round()
    );
    for row in 0..6 {
        for column in 0..6 {
            assert!((found.information[row][column] - found.information[column][row]).abs() < 1e-6);
        }
    }
    // d(moved)/d(turn) · d(moved)/d(shift): a rotation about z moves x by -y.
    let mean_y = -found.information[2][3] / count;
    assert!((0.5..2.5).contains(&mean_y), "{mean_y}");
    assert_eq!(found.information[4][3], 0.0);
}

#[test]
fn refinement_does_not_depend_on_the_number_of_threads() {
    let (source, target, truth) = SyntheticRoom::pair(6, 400.0);
    let run = || refine([&source, &target], &off(&truth, 1.0, 0.03), &OPTIONS);
    let alone = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap()
        .install(run);
    assert_eq!(
        alone,
        rayon::ThreadPoolBuilder::new()
            .num_threads(5)
            .build()
            .unwrap()
            .install(run)
    );
}

#[test]
fn nan_brightness_is_ignored() {
    let (mut source, mut target, truth) = SyntheticRoom::pair(3, 400.0);
    for intensities in [&mut source.intensities, &mut target.intensities] {
        intensities
            .iter_mut()
            .step_by(7)
            .for_each(|intensity| *intensity = f32::NAN);
    }
    let found = refine([&source, &target], &off(&truth, 1.0, 0.03), &OPTIONS).unwrap();
    let (turn, shift) = error(&found.target_from_source, &truth);
    assert!(
        turn < 0.2 && shift < 0.005 && found.correlation.is_none(),
        "{turn}° {shift} m {found:?}"
    );
}

#[test]
fn missing_partners_give_none_and_invalid_input_is_refused() {
    let (source, target, truth) = SyntheticRoom::pair(1, 100.0);
    let far = Pose {
        translation: truth.translation + DVec3::splat(90.0),
        ..truth
    };
    assert_eq!(refine([&source, &target], &far, &OPTIONS), None);
    assert_eq!(
        refine([&OrientedCloud::default(), &target], &truth, &OPTIONS),
        None
    );
    assert_eq!(
        refine([&source, &OrientedCloud::default()], &truth, &OPTIONS),
        None
    );
    let run = |options: RefineOptions| {
        refine_registration(&source, &target, &truth, &options, &Progress::default())
    };
    assert!(
        run(RefineOptions {
            voxel: f32::NAN,
            ..OPTIONS
        })
        .is_err()
    );
    assert!(
        run(RefineOptions {
            lambda_geometric: -0.1,
            ..OPTIONS
        })
        .is_err()
    );
    let stopped = Progress::default();
    stopped.stop();
    assert!(refine_registration(&source, &target, &truth, &OPTIONS, &stopped).is_err());
}
