use super::room::{SyntheticRoom, VOXEL, error};
use crate::rgbd::register::{
    DescribedCloud, GlobalAlignment, GlobalOptions, GlobalRegistration, OrientedCloud,
    register_globally,
};
use ostra_core::job::Progress;

const METHODS: [GlobalRegistration; 2] = [GlobalRegistration::Fgr, GlobalRegistration::Ransac];

fn described(cloud: &OrientedCloud) -> DescribedCloud {
    DescribedCloud::new(cloud, VOXEL, &Progress::default()).unwrap()
}

fn register(
    source: &DescribedCloud,
    target: &DescribedCloud,
    options: GlobalOptions,
) -> Option<GlobalAlignment> {
    register_globally(source, target, &options, &Progress::default()).unwrap()
}

#[test]
fn both_methods_recover_any_pose() {
    for seed in 0..20 {
        let (source, target, truth) = SyntheticRoom::pair(seed, 250.0);
        let [source, target] = [described(&source), described(&target)];
        for method in METHODS {
            let found = register(
                &source,
                &target,
                GlobalOptions {
                    method,
                    seed,
                    ..GlobalOptions::default()
                },
            )
            .unwrap();
            let (turn, shift) = error(&found.target_from_source, &truth);
            assert!(
                turn < 5.0 && shift < 2.0 * f64::from(VOXEL),
                "{seed} {method:?}: {turn}° {shift} m {found:?}"
            );
            assert!(
                found.agreeing > 60 && found.agreeing <= found.matches,
                "{seed} {method:?}: {found:?}"
            );
        }
    }
}

#[test]
fn different_rooms_are_refused() {
    for seed in 0..6 {
        let [source, target] = [seed, seed + 100]
            .map(|seed| described(&SyntheticRoom::new(seed).scan(0.0, 0.7, 250.0)));
        for method in METHODS {
            let found = register(
                &source,
                &target,
                GlobalOptions {
                    method,
                    seed,
                    ..GlobalOptions::default()
                },
            );
            assert_eq!(found, None, "{seed} {method:?}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_number_of_threads() {
    let (source, target, _) = SyntheticRoom::pair(5, 250.0);
    for method in METHODS {
        let options = GlobalOptions {
            method,
            seed: 9,
            ..GlobalOptions::default()
        };
        let run = || register(&described(&source), &described(&target), options);
        let alone = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .unwrap()
            .install(run);
        let many = rayon::ThreadPoolBuilder::new()
            .num_threads(5)
            .build()
            .unwrap()
            .install(run);
        assert_eq!(alone, many);
        assert!(alone.is_some());
    }
}

#[test]
fn empty_clouds_give_none_and_invalid_requests_are_errors() {
    let (source, target, _) = SyntheticRoom::pair(1, 100.0);
    let nothing = described(&OrientedCloud::default());
    for method in METHODS {
        let options = GlobalOptions {
            method,
            ..GlobalOptions::default()
        };
        assert_eq!(register(&nothing, &described(&target), options), None);
        assert_eq!(register(&described(&source), &nothing, options), None);
    }
    let coarse = DescribedCloud::new(&source, 2.0 * VOXEL, &Progress::default()).unwrap();
    let run = |options: &GlobalOptions| {
        register_globally(&coarse, &described(&target), options, &Progress::default())
    };
    assert!(run(&GlobalOptions::default()).is_err());
    assert!(
        run(&GlobalOptions {
            min_share: 1.5,
            ..GlobalOptions::default()
        })
        .is_err()
    );
    let stopped = Progress::default();
    stopped.stop();
    let described = [&source, &target].map(described);
    assert!(
        register_globally(
            &described[0],
            &described[1],
            &GlobalOptions::default(),
            &stopped
        )
        .is_err()
    );
}
