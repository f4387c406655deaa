use std::sync::Arc;

use super::wall::{image, images, task};
use super::{StereoEngine, assert_equal, card};
use crate::stereo::StereoError;
use crate::stereo::patchmatch::{PatchMatchOptions, PosedImage};
use ostra_core::job::Progress;

fn assert_same_search(card: &StereoEngine, images: &[Arc<PosedImage>], what: &str) {
    let (options, progress) = (PatchMatchOptions::default(), Progress::default());
    let task = task(images, None);
    let gpu = card.search(&task, &options, &progress).unwrap();
    assert_equal(
        card,
        &StereoEngine::Cpu
            .search(&task, &options, &progress)
            .unwrap(),
        &gpu,
        what,
    );
}

#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn sources_beyond_the_eighth_are_not_used() {
    let card = card();
    assert_same_search(&card, &images(11, (72, 55)), "ten sources");
}

#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn one_source_is_enough() {
    let card = card();
    assert_same_search(&card, &images(2, (97, 64)), "one source");
}

/// At the coarsest level only one of them can be compared; with a second that is smaller still, none.
#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn sources_of_other_sizes_are_compared_where_they_reach() {
    let card = card();
    let size = (170, 130);
    assert_same_search(
        &card,
        &[image(0, size), image(1, (83, 61)), image(2, size)],
        "a smaller source",
    );
    assert_same_search(
        &card,
        &[image(0, size), image(1, (83, 61)), image(2, (70, 50))],
        "smaller sources",
    );
}

#[test]
#[ignore = "needs a GPU adapter: add --include-ignored"]
fn stop_ends_the_search() {
    let card = card();
    let (progress, images) = (Progress::default(), images(2, (72, 55)));
    progress.stop();
    let stopped = card.search(
        &task(&images, None),
        &PatchMatchOptions::default(),
        &progress,
    );
    assert!(
        matches!(stopped, Err(StereoError::Stopped(_))),
        "{stopped:?}"
    );
}
