use super::*;

const PIXEL: PixelOf = PixelOf {
    frame: 0,
    index: 0,
    size: [1, 1],
};

#[test]
fn sample_of_all_frames_is_bounded_and_spread() {
    let mut thinned = Thinned::default();
    let side = 800;
    for at in 0..side * side {
        let position = Vec3::new((at % side) as f32, (at / side) as f32, 0.0) * 0.01;
        thinned.add(position, [0; 3], PIXEL, 0.01);
    }
    let kept = &thinned.kept.positions;
    assert!(
        (POINTS_OF_ALL / 3..=POINTS_OF_ALL).contains(&kept.len()),
        "{}",
        kept.len()
    );
    let half = side as f32 * 0.005;
    let left = kept.iter().filter(|x| x.x < half).count();
    assert!(
        (kept.len() * 4 / 10..kept.len() * 6 / 10).contains(&left),
        "{left}"
    );
    let before = kept.len();
    for _ in 0..3 {
        thinned.add(Vec3::new(1.0, 1.0, 0.0), [0; 3], PIXEL, 0.01);
        thinned.add(Vec3::NAN, [0; 3], PIXEL, 0.01);
    }
    assert!(
        thinned.kept.positions.len() <= before + 1,
        "one point in each cube"
    );
}

#[test]
fn points_of_other_cameras_are_not_shown_meanwhile() {
    let frames = [0, 1].map(|_| DepthFrames {
        frames: Arc::default(),
        has_stale_depths: false,
    });
    let key = |all: &DepthFrames, frame| FramePointsKey {
        all: all.clone(),
        frame,
    };
    assert!(
        key(&frames[0], 0).serves(&key(&frames[0], 5)),
        "another frame of the same cameras"
    );
    assert!(!key(&frames[0], 0).serves(&key(&frames[1], 0)));
    let all = |all: &DepthFrames| AllPointsKey { all: all.clone() };
    assert!(all(&frames[0]).is_obsolete(&all(&frames[1])));
}
