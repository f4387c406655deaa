use super::wall::{camera, frame, grey, pose, sparse};
use crate::stereo::patchmatch::Tones;
use crate::stereo::{
    DepthStore, InMemoryDepthStore, SelectOptions, Stage, StereoEngine, StereoOptions,
    StereoRequest, ViewOutcome, estimate_depths, select_sources,
};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};

fn frames(folder: &std::path::Path, count: usize) -> Vec<Frame> {
    (0..count)
        .map(|index| frame(folder, index, &grey(&pose(index))))
        .collect()
}

#[test]
fn sources_share_points_under_a_good_angle() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = frames(folder.path(), 4);
    // The third is at the position of the first: no angle.
    frames[2].camera = frames[0].camera;
    let sources = select_sources(
        &frames,
        &[0, 1, 2, 3],
        &sparse(&[0, 1, 2, 3]),
        &SelectOptions::default(),
    );
    let of_first: Vec<usize> = sources[0].iter().map(|source| source.frame).collect();
    // 7° and 13° to the side: the narrower is nearer to the best angle.
    assert_eq!(of_first, [1, 3]);
    assert!(sources[0].iter().all(|source| source.shared == 80));
    let none = select_sources(&frames, &[0, 1], &sparse(&[0]), &SelectOptions::default());
    assert!(none.iter().all(Vec::is_empty));
}

#[test]
fn views_without_sources_are_reported_and_the_rest_done() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = frames(folder.path(), 4);
    let (width, height) = (camera().width as usize, camera().height as usize);
    let flat = Tones {
        width,
        height,
        luma: vec![90.0; width * height],
        chroma: Vec::new(),
    };
    frames.push(frame(folder.path(), 4, &flat));
    frames.push(frame(folder.path(), 5, &flat));
    frames.push(Frame {
        camera: None,
        ..frames[0].clone()
    });
    std::fs::remove_file(folder.path().join("5.png")).unwrap();
    let sparse = sparse(&[0, 1, 2]);
    let views = [0, 1, 2, 3, 4, 5, 6];
    let request = StereoRequest {
        frames: &frames,
        views: &views,
        sparse: &sparse,
        mask: &|_, _| None,
        engine: &StereoEngine::Cpu,
    };
    let (store, depths) = (FrameStore::new(1 << 20), InMemoryDepthStore::default());
    let options = StereoOptions {
        max_side: 160,
        ..StereoOptions::default()
    };
    let outcomes =
        estimate_depths(&request, &store, &depths, &options, &Progress::default()).unwrap();
    for view in 0..3 {
        assert!(
            matches!(outcomes[&view], ViewOutcome::Done { pixels, .. } if pixels > 5000),
            "{:?}",
            outcomes[&view]
        );
        assert!(depths.load(view, Stage::Complete).unwrap().is_some());
    }
    assert_eq!(outcomes[&3], ViewOutcome::NothingShared { points: 0 });
    assert_eq!(outcomes[&4], ViewOutcome::Constant);
    assert!(matches!(outcomes[&5], ViewOutcome::Unreadable { .. }));
    assert_eq!(outcomes[&6], ViewOutcome::NoCamera);
}

#[test]
fn images_that_fail_when_they_are_read_cost_the_other_views_a_source_only() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = frames(folder.path(), 4);
    let (width, height) = (camera().width as usize, camera().height as usize);
    let flat = Tones {
        width,
        height,
        luma: vec![90.0; width * height],
        chroma: Vec::new(),
    };
    frames[2] = frame(folder.path(), 2, &flat);
    std::fs::remove_file(folder.path().join("1.png")).unwrap();
    // Points were seen in all of them.
    let sparse = sparse(&[0, 1, 2, 3]);
    let request = StereoRequest {
        frames: &frames,
        views: &[0, 1, 2, 3],
        sparse: &sparse,
        mask: &|_, _| None,
        engine: &StereoEngine::Cpu,
    };
    let (store, depths) = (FrameStore::new(1 << 20), InMemoryDepthStore::default());
    let options = StereoOptions {
        max_side: 160,
        ..StereoOptions::default()
    };
    let outcomes =
        estimate_depths(&request, &store, &depths, &options, &Progress::default()).unwrap();
    assert!(matches!(&outcomes[&1], ViewOutcome::Unreadable { why } if why.contains("1.png")));
    assert_eq!(outcomes[&2], ViewOutcome::Constant);
    for (view, other) in [(0, 3), (3, 0)] {
        let ViewOutcome::Done { pixels, sources } = &outcomes[&view] else {
            panic!("{:?}", outcomes[&view])
        };
        assert!(
            *pixels > 5000 && *sources == [other],
            "{pixels} from {sources:?}"
        );
        assert!(depths.load(view, Stage::Complete).unwrap().is_some());
    }
    for view in [1, 2] {
        assert!(depths.load(view, Stage::Complete).unwrap().is_none());
    }
}
