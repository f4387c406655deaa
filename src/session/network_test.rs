//! Questions with known answers for installed networks.
//!
//! A file can load and have the expected inputs and outputs, and still answer nonsense: the weights
//! may be others, or the export may expect another preprocessing. The questions use synthetic images
//! that every network of its kind answers.

use std::path::Path;
use std::sync::Arc;

use glam::DVec2;

use crate::synthetic_images::{Grey, clock_image, disc_image, noise};
use crate::tracker_test::tracked_disc_iou;
use ostra_compute::nn::{NnError, TestResult};
use ostra_core::job::Progress;
use ostra_masks::onnx::Yolox;
use ostra_masks::onnx::grounding::GroundingDino;
use ostra_masks::onnx::sam::Sam;
use ostra_masks::{
    Click, GroundRequest, MaskError, PreparedFrame, Prompt, PxBox, SegmentRequest, Segmenter,
    TextGrounder, Tracker,
};
use ostra_reconstruct::sfm::matching::NearestMatcher;
use ostra_reconstruct::sfm::onnx::{
    Aliked, AlikedOptions, LightGlue, LightGlueFeatures, LightGlueOptions, LighterGlue,
    LighterGlueOptions, SuperGlue, SuperGlueOptions, SuperPoint, SuperPointOptions, XFeat,
    XFeatOptions,
};
use ostra_reconstruct::sfm::{FeatureError, FeatureExtractor, FeatureMatcher, Sift};
use ostra_tracking::deaot::Deaot;
use ostra_tracking::xmem::XMem;

/// Minimum IoU of a mask with the object that was clicked.
const LEAST_MASK_IOU: f64 = 0.9;
/// Minimum IoU of a box with the object that was searched for.
const LEAST_BOX_IOU: f64 = 0.8;
/// Minimum mean IoU of the masks of a tracked disc, which moves by a quarter of its size per frame.
const LEAST_TRACKED_IOU: f64 = 0.7;
/// Minimum number of matches of an image with its shifted copy.
const LEAST_MATCHES: usize = 100;
/// Minimum share of correct matches of a matching network.
///
/// With the weights of LighterGlue it is 0.81: noise is unlike its training images. Weights without
/// meaning give almost none.
const LEAST_CORRECT: f64 = 0.7;
/// Minimum share of correct matches by nearest descriptors, which has no other check of them.
///
/// With the weights of XFeat it is 0.76; descriptors without meaning give almost none.
const LEAST_CORRECT_NEAREST: f64 = 0.5;
/// Minimum share of correct matches of networks that were not measured with their weights.
///
/// It is lower than for the measured ones, so that a good network never fails. Weights without
/// meaning give almost no correct match.
const LEAST_CORRECT_UNMEASURED: f64 = 0.4;
/// Maximum distance of a correct match from the true position, pixels.
const MATCH_TOLERANCE_PX: f64 = 2.0;
/// Shift between both images, pixels. It is not a multiple of a network's cells.
const SHIFT_PX: [usize; 2] = [27, 13];

/// Outcome of a network's test.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NetworkTest {
    /// The answers are right; the text has figures.
    Passed(String),
    /// Its answers are wrong.
    Failed(String),
    /// It did not run, for this reason: memory or the graphics card may be lacking at the moment.
    NotRun(String),
    /// No test was made, for this reason.
    Untested(String),
}

impl NetworkTest {
    /// Returns the result to be remembered; `None` if the network gave no answers.
    #[must_use]
    pub(crate) fn result(&self) -> Option<TestResult> {
        match self {
            Self::Passed(_) => Some(TestResult::Passed),
            Self::Failed(what) => Some(TestResult::Failed(what.clone())),
            Self::NotRun(_) | Self::Untested(_) => None,
        }
    }
}

/// An answer: figures if it is right, else what is wrong.
type Verdict = Result<String, String>;

/// Why a test ended without a verdict.
enum Interrupted {
    /// The user stopped it.
    Stopped,
    /// The network does not run.
    Broken(String),
}

impl From<MaskError> for Interrupted {
    fn from(error: MaskError) -> Self {
        match error {
            MaskError::Stopped(_) => Self::Stopped,
            error => Self::Broken(error.to_string()),
        }
    }
}

impl From<FeatureError> for Interrupted {
    fn from(error: FeatureError) -> Self {
        Self::Broken(error.to_string())
    }
}

impl From<NnError> for Interrupted {
    fn from(error: NnError) -> Self {
        Self::Broken(error.to_string())
    }
}

/// Asks the network installed in `folder` under `name` questions with known answers.
///
/// A matcher is tested with the features of another network, if that `is_usable`.
///
/// # Errors
///
/// Returns an error if the user stops it. A network that does not load or run is no error.
pub(crate) fn test_network(
    folder: &Path,
    name: &str,
    is_usable: &dyn Fn(&str) -> bool,
    progress: &Progress,
) -> Result<NetworkTest, ostra_core::job::Stopped> {
    let needs = |other: &str| {
        (!is_usable(other)).then(|| {
            NetworkTest::Untested(format!(
                "its test needs `{other}`, which is not installed or failed its own test"
            ))
        })
    };
    let verdict = match name {
        "sam-vit-b" | "mobile-sam" | "efficient-sam" => ask_sam(folder, name, progress),
        name if name.starts_with("sam2") => ask_sam(folder, name, progress),
        "yolox" => Yolox::load(folder)
            .map_err(Interrupted::from)
            .and_then(|yolox| ask_grounder(&yolox, progress)),
        "grounding-dino" => GroundingDino::load(folder)
            .map_err(Interrupted::from)
            .and_then(|dino| ask_grounder(&dino, progress)),
        "xfeat" => ask_xfeat(folder),
        "lighterglue" => match needs("xfeat") {
            Some(untested) => return Ok(untested),
            None => ask_lighterglue(folder),
        },
        "aliked" => ask_aliked(folder),
        "aliked-lightglue" => match needs("aliked") {
            Some(untested) => return Ok(untested),
            None => ask_aliked_lightglue(folder),
        },
        "sift-lightglue" => ask_sift_lightglue(folder),
        "superpoint" => ask_superpoint(folder),
        "xmem" => XMem::load(folder)
            .map_err(Interrupted::from)
            .and_then(|xmem| ask_tracker(&xmem, progress)),
        "deaot" => Deaot::load(folder)
            .map_err(Interrupted::from)
            .and_then(|deaot| ask_tracker(&deaot, progress)),
        "superglue-indoor" | "superglue-outdoor" => match needs("superpoint") {
            Some(untested) => return Ok(untested),
            None => ask_superglue(folder, name),
        },
        _ => {
            return Ok(NetworkTest::Untested(
                "there is no question with a known answer for it".to_owned(),
            ));
        }
    };
    match verdict {
        Ok(Ok(figures)) => Ok(NetworkTest::Passed(figures)),
        Ok(Err(wrong)) => Ok(NetworkTest::Failed(wrong)),
        Err(Interrupted::Broken(why)) => Ok(NetworkTest::NotRun(why)),
        Err(Interrupted::Stopped) => Err(ostra_core::job::Stopped),
    }
}

/// Clicks on a disc, and draws a box around it.
fn ask_sam(folder: &Path, name: &str, progress: &Progress) -> Result<Verdict, Interrupted> {
    let sam = Sam::load(folder, name)?;
    let (image, disc) = disc_image();
    let frame = sam.prepare(&Arc::new(image), None, progress)?;
    let click = Prompt {
        clicks: vec![Click {
            at_px: disc.centre_px,
            include: true,
        }],
        ..Prompt::default()
    };
    let around = Prompt {
        boxes: vec![disc.extent()],
        ..Prompt::default()
    };
    let [click, around] = [("click", click), ("box", around)].map(|(what, prompt)| {
        let iou = mask_iou(&*frame, &prompt, &disc.region(), progress)?;
        Ok::<_, Interrupted>(if iou >= LEAST_MASK_IOU {
            Ok(format!("IoU of a {what} {iou:.2}"))
        } else {
            Err(format!(
                "a {what} on a disc gives a mask with IoU {iou:.2} instead of at least {LEAST_MASK_IOU}"
            ))
        })
    });
    Ok(match (click?, around?) {
        (Ok(click), Ok(around)) => Ok(format!("{click}, {around}")),
        (Err(wrong), _) | (_, Err(wrong)) => Err(wrong),
    })
}

fn mask_iou(
    frame: &dyn PreparedFrame,
    prompt: &Prompt,
    truth: &ostra_masks::Region,
    progress: &Progress,
) -> Result<f64, MaskError> {
    let request = SegmentRequest {
        prompt,
        previous: None,
        taken: None,
    };
    Ok(frame.segment(&request, progress)?.iou(truth))
}

/// Searches for a clock.
fn ask_grounder(grounder: &dyn TextGrounder, progress: &Progress) -> Result<Verdict, Interrupted> {
    let (image, clock) = clock_image();
    let phrases = ["clock".to_owned()];
    let request = GroundRequest {
        phrases: &phrases,
        threshold: None,
    };
    let found = grounder.ground(&image, &request, progress)?;
    let Some(best) = found.first() else {
        return Ok(Err("a clock is not found".to_owned()));
    };
    let iou = box_iou(&best.extent, &clock.extent());
    Ok(if iou < LEAST_BOX_IOU {
        Err(format!(
            "the box of a clock has IoU {iou:.2} instead of at least {LEAST_BOX_IOU}"
        ))
    } else {
        Ok(format!(
            "a clock is found with IoU {iou:.2} and score {:.2}",
            best.score
        ))
    })
}

fn box_iou(a: &PxBox, b: &PxBox) -> f64 {
    let area = |extent: DVec2| extent.max(DVec2::ZERO).element_product();
    let common = area(a.max_px.min(b.max_px) - a.min_px.max(b.min_px));
    common / (area(a.max_px - a.min_px) + area(b.max_px - b.min_px) - common)
}

/// Tracks a moving disc.
fn ask_tracker(tracker: &dyn Tracker, progress: &Progress) -> Result<Verdict, Interrupted> {
    let iou = tracked_disc_iou(tracker, progress)?;
    Ok(if iou >= LEAST_TRACKED_IOU {
        Ok(format!("mean IoU of a moving disc {iou:.2}"))
    } else {
        Err(format!(
            "a moving disc is tracked with mean IoU {iou:.2} instead of at least {LEAST_TRACKED_IOU}"
        ))
    })
}

fn ask_xfeat(folder: &Path) -> Result<Verdict, Interrupted> {
    let xfeat = XFeat::load(folder, XFeatOptions::default())?;
    ask_about_shift(&xfeat, &NearestMatcher::for_floats(), LEAST_CORRECT_NEAREST)
}

fn ask_lighterglue(folder: &Path) -> Result<Verdict, Interrupted> {
    let xfeat = XFeat::load(folder, XFeatOptions::default())?;
    let lighterglue = LighterGlue::load(folder, LighterGlueOptions::default())?;
    ask_about_shift(&xfeat, &lighterglue, LEAST_CORRECT)
}

fn ask_aliked(folder: &Path) -> Result<Verdict, Interrupted> {
    // Noise has few of the corners of photos.
    let options = AlikedOptions {
        least_score: 0.0,
        ..AlikedOptions::default()
    };
    let aliked = Aliked::load(folder, options)?;
    ask_about_shift(
        &aliked,
        &NearestMatcher::for_floats(),
        LEAST_CORRECT_UNMEASURED,
    )
}

fn ask_aliked_lightglue(folder: &Path) -> Result<Verdict, Interrupted> {
    let options = AlikedOptions {
        least_score: 0.0,
        ..AlikedOptions::default()
    };
    let aliked = Aliked::load(folder, options)?;
    let lightglue = LightGlue::load(
        folder,
        LightGlueFeatures::Aliked,
        LightGlueOptions::default(),
    )?;
    ask_about_shift(&aliked, &lightglue, LEAST_CORRECT_UNMEASURED)
}

fn ask_sift_lightglue(folder: &Path) -> Result<Verdict, Interrupted> {
    let lightglue = LightGlue::load(folder, LightGlueFeatures::Sift, LightGlueOptions::default())?;
    ask_about_shift(&Sift::default(), &lightglue, LEAST_CORRECT_UNMEASURED)
}

fn ask_superpoint(folder: &Path) -> Result<Verdict, Interrupted> {
    let superpoint = SuperPoint::load(folder, SuperPointOptions::default())?;
    ask_about_shift(
        &superpoint,
        &NearestMatcher::for_floats(),
        LEAST_CORRECT_NEAREST,
    )
}

fn ask_superglue(folder: &Path, name: &str) -> Result<Verdict, Interrupted> {
    let superpoint = SuperPoint::load(folder, SuperPointOptions::default())?;
    let superglue = SuperGlue::load(folder, name, SuperGlueOptions::default())?;
    ask_about_shift(&superpoint, &superglue, LEAST_CORRECT)
}

/// Matches an image with a shifted copy of it.
fn ask_about_shift(
    extractor: &dyn FeatureExtractor,
    matcher: &dyn FeatureMatcher,
    least_correct: f64,
) -> Result<Verdict, Interrupted> {
    let [right, down] = SHIFT_PX;
    let (width, height) = (512, 384);
    let scene = noise(width + right, height + down);
    let [first, second] = [
        scene.part(right, down, width, height),
        scene.part(0, 0, width, height),
    ]
    .map(
        |Grey {
             width,
             height,
             values,
         }| extractor.extract(&values, width, height, None),
    );
    let (first, second) = (first?, second?);
    let matches = matcher.matches(&first, &second)?;
    let shift = DVec2::new(right as f64, down as f64);
    let is_correct = |&&(a, b): &&(u32, u32)| {
        let moved = first.keypoints[a as usize] + shift;
        moved.distance(second.keypoints[b as usize]) <= MATCH_TOLERANCE_PX
    };
    let (count, correct) = (matches.len(), matches.iter().filter(is_correct).count());
    let share = correct as f64 / count.max(1) as f64;
    let figures = format!("{correct} of {count} matches with a shifted image are correct");
    Ok(if count >= LEAST_MATCHES && share >= least_correct {
        Ok(figures)
    } else {
        Err(figures)
    })
}
