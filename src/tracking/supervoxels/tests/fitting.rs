//! Tests of the choice between geometry and the segmenter for single images.

use super::*;
use crate::supervoxels::{FittingSegmenter, unfit};
use ostra_masks::{AnswerSize, AnswerSource, PxBox};

const SOLID: AnswerSource = AnswerSource {
    segmenter: "geometry",
    reason: "a solid object with depth",
};

fn frames(folder: &Path) -> Vec<Frame> {
    let asides = [0.0, -0.25, -0.12, 0.12, 0.25].into_iter().enumerate();
    asides
        .map(|(number, aside)| recorded(folder, number, aside))
        .collect()
}

/// Returns a frame over the answers of [`Pixels`], and the ids of its objects.
fn fitting(frames: Vec<Frame>) -> (Arc<dyn PreparedFrame>, Vec<u8>) {
    let store = Arc::new(FrameStore::new(16 << 20));
    let first = frames[0].clone();
    let geometry = GeometrySegmenter::new(Arc::new(frames), store, Arc::new(Pixels));
    let (_, image, ids) = view(0.0);
    let prepared = FittingSegmenter(Arc::new(geometry))
        .prepare_frame(&first, &image, None, &Progress::default())
        .unwrap();
    (prepared, ids)
}

/// Returns who answers a prompt, with the answer.
fn answer(
    frame: &dyn PreparedFrame,
    prompt: &Prompt,
    previous: Option<&Region>,
) -> (AnswerSource, Region) {
    let request = SegmentRequest {
        prompt,
        previous,
        taken: None,
    };
    let answer = frame.segment(&request, &Progress::default()).unwrap();
    (frame.source(&request).unwrap(), answer)
}

fn clicks(clicks: &[Click]) -> Prompt {
    Prompt {
        clicks: clicks.to_vec(),
        ..Prompt::default()
    }
}

/// Returns the source of an answer by the segmenter for single images.
fn by_pixels(reason: &'static str) -> AnswerSource {
    AnswerSource {
        segmenter: "pixels",
        reason,
    }
}

#[test]
fn geometry_answers_for_solid_objects_and_the_image_for_others() {
    let folder = tempfile::tempdir().unwrap();
    let (frame, ids) = fitting(frames(folder.path()));
    let (left, wire) = (region_of(&ids, 2), region_of(&ids, 4));
    let (source, answered) = answer(&*frame, &clicks(&[click(&left, true)]), None);
    assert_eq!(source, SOLID);
    assert!(answered.iou(&left) > 0.8, "{}", answered.iou(&left));
    let (source, answered) = answer(&*frame, &clicks(&[click(&wire, true)]), None);
    assert_eq!(source, by_pixels("a thin or small object"));
    assert_eq!(answered.area(), 1);
    let boxed = Prompt {
        boxes: vec![PxBox {
            min_px: DVec2::new(2.0, 2.0),
            max_px: DVec2::new(20.0, 20.0),
        }],
        ..clicks(&[click(&left, true)])
    };
    assert_eq!(answer(&*frame, &boxed, None).0, by_pixels("a box"));
    let correction = Prompt {
        corrects: true,
        ..clicks(&[click(&left, true)])
    };
    let (source, _) = answer(&*frame, &correction, Some(&left));
    assert_eq!(source, by_pixels("a mask without clicks is corrected"));
}

#[test]
fn whoever_made_the_mask_so_far_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let (frame, ids) = fitting(frames(folder.path()));
    let (left, right) = (region_of(&ids, 2), region_of(&ids, 3));
    let both = clicks(&[click(&left, true), click(&right, true)]);
    let (_, first) = answer(&*frame, &clicks(&[click(&left, true)]), None);
    let (source, second) = answer(&*frame, &both, Some(&first));
    assert_eq!(source, SOLID);
    assert!(second.area() > first.area() + right.area() / 2);
    let other = by_pixels("the mask so far is not from geometry");
    let mut pixel = Region::empty(SIZE.0, SIZE.1);
    pixel.inside[click(&left, true).pixel_in(SIZE.0, SIZE.1).unwrap()] = true;
    assert_eq!(answer(&*frame, &both, Some(&pixel)).0, other);
    // The mask has an error that the answer of geometry does not have.
    let mut leaked = first.clone();
    leaked.unite(&right);
    let excluded = clicks(&[click(&left, true), click(&right, false)]);
    assert_eq!(answer(&*frame, &excluded, Some(&leaked)).0, other);
}

#[test]
fn clicks_given_together_are_answered_by_whoever_answers_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let (frame, ids) = fitting(frames(folder.path()));
    let (left, wire) = (region_of(&ids, 2), region_of(&ids, 4));
    let together = |of: [&Region; 2]| clicks(&of.map(|region| click(region, true)));
    // Both together are broad.
    let (source, _) = answer(&*frame, &together([&wire, &left]), None);
    assert_eq!(source, by_pixels("a thin or small object"));
    let (source, _) = answer(&*frame, &together([&left, &wire]), None);
    assert_eq!(source, SOLID);
}

#[test]
fn smaller_answer_than_that_of_geometry_is_from_the_image() {
    let folder = tempfile::tempdir().unwrap();
    let (frame, ids) = fitting(frames(folder.path()));
    let left = region_of(&ids, 2);
    let sized = |size| {
        let prompt = Prompt {
            size,
            ..clicks(&[click(&left, true)])
        };
        answer(&*frame, &prompt, None)
    };
    let (_, automatic) = sized(AnswerSize::Automatic);
    let (source, smaller) = sized(AnswerSize::Smaller);
    assert_eq!(source, by_pixels("another size of the answer"));
    assert_eq!(smaller.area(), 1);
    let (_, larger) = sized(AnswerSize::Larger);
    assert!(larger == automatic, "the image has no larger answer");
}

#[test]
fn geometry_fits_only_recordings_with_depth_and_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = frames(folder.path());
    let reason = |frames: &[Frame]| unfit(frames, &frames[0]);
    assert_eq!(reason(&frames), None);
    let few = reason(&frames[..2]).unwrap();
    assert_eq!(few, "fewer than three frames have depth and a camera");
    let camera = frames[0].camera.take();
    assert_eq!(reason(&frames), Some("the frame has no camera"));
    frames[0].camera = camera;
    frames[0].depth = Some(DepthSource::Estimated {
        made: "d0.tif".into(),
        scale: 1.0,
    });
    assert_eq!(
        reason(&frames),
        Some("the depth of the frame is from stereo")
    );
    frames[0].depth = None;
    assert_eq!(reason(&frames), Some("the frame has no depth"));
    let (frame, ids) = fitting(frames);
    let left = region_of(&ids, 2);
    let (source, _) = answer(&*frame, &clicks(&[click(&left, true)]), None);
    assert_eq!(source, by_pixels("the frame has no depth"));
}
