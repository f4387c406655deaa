use super::wall::{frame, grey, pose, seen};
use crate::sfm::{Sift, matching::NearestMatcher};
use crate::stereo::{SparseOptions, SparseRequest, sparse_from_cameras};
use ostra_core::job::Progress;
use ostra_frames::FrameStore;

/// Points of matches lie on the wall, and are the same, in the same order, for any number of threads.
#[test]
fn sparse_points_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<_> = (0..4)
        .map(|index| frame(folder.path(), index, &grey(&pose(index))))
        .collect();
    let (store, extractor, matcher) = (
        FrameStore::new(1 << 20),
        Sift::default(),
        NearestMatcher::for_bytes(),
    );
    let request = SparseRequest {
        frames: &frames,
        views: &[0, 1, 2, 3],
        extractor: &extractor,
        matcher: &matcher,
    };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let (options, progress) = (SparseOptions::default(), Progress::default());
        pool.install(|| sparse_from_cameras(&request, &store, &options, &progress).unwrap())
    };
    let (one, three) = (with(1), with(3));
    assert!(one == three);
    let on_the_wall = one.keypoints[&0].iter().filter(|keypoint| {
        let truth = seen(&pose(0), keypoint.at_px).0;
        (one.points[keypoint.point.unwrap() as usize].position - truth).length() < 0.03
    });
    let (right, all) = (on_the_wall.count(), one.keypoints[&0].len());
    assert!(all > 30 && right * 10 > all * 9, "{right} of {all}");
}
