use std::sync::Arc;

use super::wall::{found, images, partly_flat, task};
use super::{StereoEngine, assert_equal, card};
use crate::stereo::patchmatch::{PatchMatchOptions, PlaneMap, PosedImage, Round};
use ostra_core::job::Progress;

/// An odd width and height.
const SIZE: (u32, u32) = (141, 101);

#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn search_equals_the_processor() {
    let card = card();
    let images = images(4, SIZE);
    let (options, progress) = (PatchMatchOptions::default(), Progress::default());
    let task = task(&images, None);
    let gpu = card.search(&task, &options, &progress).unwrap();
    assert_equal(
        &card,
        &StereoEngine::Cpu
            .search(&task, &options, &progress)
            .unwrap(),
        &gpu,
        "search",
    );
}

#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn parallel_searches_equal_single_ones() {
    let card = card();
    let (options, progress) = (PatchMatchOptions::default(), Progress::default());
    let tasks =
        [(4, SIZE), (3, SIZE), (3, (64, 90)), (4, SIZE)].map(|(count, size)| images(count, size));
    let search = |images: &Vec<Arc<PosedImage>>| {
        let task = task(images, None);
        let first = card.search(&task, &options, &progress).unwrap();
        let others = vec![Some(Arc::new(first.clone())); images.len() - 1];
        let round = Round {
            start: &first,
            others: &others,
            before: 0,
        };
        let again = card
            .search_consistent(&task, &round, &options, &progress)
            .unwrap();
        (first, again)
    };
    let alone = tasks.each_ref().map(search);
    let at_once = std::thread::scope(|scope| {
        let threads = tasks
            .each_ref()
            .map(|images| scope.spawn(|| search(images)));
        threads.map(|thread| thread.join().unwrap())
    });
    assert!(alone == at_once);
}

#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn masked_search_equals_the_processor() {
    let card = card();
    let images = images(3, SIZE);
    let (options, progress) = (
        PatchMatchOptions {
            seed: 7,
            ..PatchMatchOptions::default()
        },
        Progress::default(),
    );
    let allowed: Vec<bool> = (0..SIZE.0 * SIZE.1)
        .map(|at| (at % SIZE.0 / 20).is_multiple_of(2) && at / SIZE.0 > 15)
        .collect();
    let task = task(&images, Some(&allowed));
    let gpu = card.search(&task, &options, &progress).unwrap();
    assert_equal(
        &card,
        &StereoEngine::Cpu
            .search(&task, &options, &progress)
            .unwrap(),
        &gpu,
        "masked",
    );
    assert!(
        gpu.planes
            .iter()
            .zip(&allowed)
            .all(|(plane, &allowed)| allowed || plane.inverse_depth == 0.0)
    );
}

#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn consistent_rounds_equal_the_processor() {
    let card = card();
    let images = images(4, SIZE);
    let (options, progress) = (PatchMatchOptions::default(), Progress::default());
    let first = found(&images);
    let known: Vec<Option<Arc<PlaneMap>>> = first[1..]
        .iter()
        .map(|found| Some(Arc::clone(found)))
        .collect();
    let partly = vec![None, known[1].clone(), None];
    let allowed: Vec<bool> = (0..SIZE.0 * SIZE.1).map(|at| at % SIZE.0 > 60).collect();
    let cases = [
        ("all known", &known, None),
        ("some known", &partly, None),
        ("masked", &known, Some(&allowed[..])),
    ];
    for (what, others, allowed) in cases {
        let task = task(&images, allowed);
        for before in 0..2 {
            let round = Round {
                start: &first[0],
                others,
                before,
            };
            let gpu = card
                .search_consistent(&task, &round, &options, &progress)
                .unwrap();
            let cpu = StereoEngine::Cpu
                .search_consistent(&task, &round, &options, &progress)
                .unwrap();
            assert_equal(
                &card,
                &cpu,
                &gpu,
                &format!("consistent round {before}, {what}"),
            );
        }
    }
}

/// Where there is no texture, both are pulled to the same surrounding surface.
#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn flat_parts_equal_the_processor() {
    let card = card();
    let images: Vec<_> = (0..3)
        .map(|index| partly_flat(index, SIZE, |x| (x.x - 0.75).abs() < 0.2 && x.y.abs() < 0.4))
        .collect();
    let (progress, options) = (Progress::default(), PatchMatchOptions::default());
    let task = task(&images, None);
    let cpu = StereoEngine::Cpu
        .search(&task, &options, &progress)
        .unwrap();
    assert_equal(
        &card,
        &cpu,
        &card.search(&task, &options, &progress).unwrap(),
        "flat",
    );
    let without = PatchMatchOptions {
        prior_weight: 0.0,
        ..options.clone()
    };
    let alone = StereoEngine::Cpu
        .search(&task, &without, &progress)
        .unwrap();
    assert!(cpu.planes != alone.planes, "it pulls somewhere");
    let known: Vec<Option<Arc<PlaneMap>>> = found(&images)[1..]
        .iter()
        .map(|found| Some(Arc::clone(found)))
        .collect();
    let round = Round {
        start: &cpu,
        others: &known,
        before: 0,
    };
    let again = StereoEngine::Cpu
        .search_consistent(&task, &round, &options, &progress)
        .unwrap();
    let gpu = card
        .search_consistent(&task, &round, &options, &progress)
        .unwrap();
    assert_equal(&card, &again, &gpu, "flat, consistent");
}
