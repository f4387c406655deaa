use crate::SegmenterId;
use std::sync::Mutex;

use glam::DVec2;

use super::*;
use crate::testing::{keyframe, project, tracked};
use ostra_masks::MaskError;

const LEAF: LabelId = LabelId(1);
const STEM: LabelId = LabelId(2);

/// Test segmenter that answers with the rows of all including clicks and records its requests.
#[derive(Default)]
struct RowSegmenter {
    requested: Mutex<Vec<Asked>>,
}

struct Asked {
    prompt: Prompt,
    previous: Option<Region>,
    taken: Option<Region>,
}

impl PreparedFrame for RowSegmenter {
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        _progress: &Progress,
    ) -> Result<Region, MaskError> {
        self.requested.lock().unwrap().push(Asked {
            prompt: request.prompt.clone(),
            previous: request.previous.cloned(),
            taken: request.taken.cloned(),
        });
        let includes = request.prompt.clicks.iter().filter(|click| click.include);
        let rows: Vec<usize> = includes.map(|click| click.at_px.y as usize).collect();
        Ok(Region {
            width: 4,
            height: 3,
            inside: (0..12).map(|at| rows.contains(&(at / 4))).collect(),
        })
    }

    fn bytes(&self) -> usize {
        0
    }
}

/// Segments on an image of one colour.
fn segment(meaning: &PromptMeaning, segmenter: &RowSegmenter) -> Region {
    let image = Image {
        width: 4,
        height: 3,
        pixels: vec![[90; 3]; 12],
    };
    let answer = meaning.segment(segmenter, &image, &Progress::default());
    answer.unwrap()
}

fn with_mask(ids: [u16; 3]) -> Project {
    let mut project = project();
    let edit = Edit::SetMask {
        frame: 0,
        mask: Some(keyframe(ids)),
    };
    project.apply(edit).unwrap();
    project
}

fn request(label: LabelId, clicks: &[(f64, f64, bool)]) -> PromptRequest {
    let click = |&(x, y, include): &(f64, f64, bool)| Click {
        at_px: DVec2::new(x, y),
        include,
    };
    PromptRequest {
        frame: 0,
        label,
        prompt: Prompt {
            clicks: clicks.iter().map(click).collect(),
            ..Prompt::default()
        },
        segmenter: SegmenterId::Builtin,
    }
}

#[test]
fn each_new_click_on_a_mask_refines_the_previous_answer() {
    let project = with_mask([1, 0, 0]);
    let request = request(LEAF, &[(0.5, 1.5, true), (0.5, 2.5, true)]);
    let meaning = PromptMeaning::new(&project, &request).unwrap();
    let segmenter = RowSegmenter::default();
    let region = segment(&meaning, &segmenter);
    let requested = segmenter.requested.into_inner().unwrap();
    assert_eq!(requested.len(), 2);
    assert!(requested.iter().all(|requested| requested.prompt.corrects));
    assert_eq!(
        requested[0].previous,
        Some(keyframe([1, 0, 0]).runs.region(LEAF)),
        "the mask that is corrected"
    );
    assert_eq!(
        requested[1].previous.as_ref().map(Region::area),
        Some(4),
        "the answer to the first click"
    );
    let edits = meaning.edits(&project, &region).unwrap();
    let Edit::SetPrompt {
        prompt: Some(stored),
        ..
    } = &edits[0]
    else {
        panic!("{edits:?}")
    };
    assert!(stored.corrects && stored.gives_as(&request.prompt));
}

#[test]
fn label_under_the_newest_click_gives_way_if_the_click_includes() {
    let project = with_mask([0, 2, 2]);
    let taken = |include: bool| {
        let request = request(LEAF, &[(0.5, 0.5, true), (0.5, 1.5, include)]);
        let meaning = PromptMeaning::new(&project, &request).unwrap();
        let segmenter = RowSegmenter::default();
        let region = segment(&meaning, &segmenter);
        let requested = segmenter.requested.into_inner().unwrap();
        let mask = meaning.compose(&project, &region).unwrap();
        (
            requested.last().unwrap().taken.as_ref().map(Region::area),
            mask.region(STEM).area(),
        )
    };
    assert_eq!(taken(true), (None, 4), "one row of the stem is given up");
    assert_eq!(taken(false), (Some(8), 8), "the stem keeps its pixels");
}

#[test]
fn clicks_of_other_labels_exclude() {
    let mut project = with_mask([0, 0, 2]);
    let given = request(STEM, &[(2.5, 2.5, true)]);
    project
        .apply(Edit::SetPrompt {
            frame: 0,
            label: STEM,
            prompt: Some(given.prompt),
        })
        .unwrap();
    let meaning = PromptMeaning::new(&project, &request(LEAF, &[(0.5, 0.5, true)])).unwrap();
    let requested: Vec<bool> = meaning.queries[0]
        .prompt
        .clicks
        .iter()
        .map(|click| click.include)
        .collect();
    assert_eq!(requested, [false, true]);
}

#[test]
fn preview_and_click_ask_the_same_and_change_the_same_pixels() {
    let project = with_mask([1, 2, 0]);
    let request = request(LEAF, &[(0.5, 1.5, true)]);
    let answer = || {
        let meaning = PromptMeaning::new(&project, &request).unwrap();
        let segmenter = RowSegmenter::default();
        let region = segment(&meaning, &segmenter);
        (meaning, region)
    };
    let (_, preview) = answer();
    let (clicked, region) = answer();
    assert_eq!(preview, region);
    let mask = clicked.compose(&project, &region).unwrap();
    assert_eq!(mask.region(LEAF), preview);
}

#[test]
fn meaning_is_valid_until_the_frame_or_a_label_changes() {
    let mut project = with_mask([1, 0, 0]);
    let meaning = PromptMeaning::new(&project, &request(LEAF, &[(0.5, 1.5, true)])).unwrap();
    let set = |frame| Edit::SetMask {
        frame,
        mask: Some(tracked([1, 1, 0])),
    };
    project.apply(set(1)).unwrap();
    assert!(meaning.is_of(&project), "another frame");
    project.apply(set(0)).unwrap();
    assert!(!meaning.is_of(&project));
}
