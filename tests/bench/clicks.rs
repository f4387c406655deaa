//! How good the first answer to a click is, and what an exclude click removes from a tracked mask.
//!
//! `cargo bench --bench clicks [first] [corrections] [CLIP…]` on the images of `OSTRA_DATA`.
//!
//! `first` clicks the deepest point of each object and those of its other parts. It prints the
//! share of answers with an IoU of at least 0.5 and that of answers which take much background: of
//! the automatic size, of the best of all sizes, and of rules that replace an implausible answer by
//! the best plausible one. An answer is implausible if it covers a share of the image or touches
//! three of its borders. The rules choose among answers of the graph cut; thin structures are not
//! followed for them. Objects are in two halves, for choosing a rule and for checking it. The name
//! `tiller` chooses rendered rice plants.
//!
//! `corrections` tracks the first mask of each clip by flow and corrects every fourth frame with
//! four clicks into the largest error. It prints the mean gain of IoU of the clicks of each kind.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a bench prints its table and ends where data is missing"
)]

#[path = "../support/images.rs"]
mod images;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec2;
use ostra_core::job::Progress;
use ostra_eval::simulated_click::next_click;
use ostra_eval::synthetic::{Scene, SceneOptions, SensorNoise};
use ostra_frames::{DepthMap, Frame, FrameFolder, FrameStore, Image, OpenRequest, open};
use ostra_masks::graph_cut::BuiltinSegmenter;
use ostra_masks::graph_cut::ranked_click::{RankedClick, RankedFrame};
use ostra_masks::graph_cut::ranking::{WEIGHTS, best};
use ostra_masks::{
    AnswerSize, Click, Direction, Label, LabelId, LabelMask, PreparedFrame, Prompt, Region,
    SegmentRequest, Segmenter, TrackRequest, TrackedFrame, Tracker, landmarks,
};
use ostra_project::mask_edits::{keyframe, mask_of};
use ostra_project::prompt::PromptMeaning;
use ostra_project::{Edit, Project, PromptRequest, SegmenterId};
use ostra_tracking::flow::FlowTracker;
use rayon::prelude::*;

use images::{read_depth, read_image};

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with('-'))
        .collect();
    let parts = ["first", "corrections"];
    let is_named = |word: &String| parts.contains(&word.as_str());
    let wants = |part: &str| !words.iter().any(is_named) || words.iter().any(|word| word == part);
    let names: Vec<&str> = words
        .iter()
        .filter(|word| !is_named(word))
        .map(String::as_str)
        .collect();
    let data = std::env::var_os("OSTRA_DATA")
        .map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    if !data.is_dir() {
        println!("no images at {}: set OSTRA_DATA", data.display());
        return;
    }
    if wants("first") {
        first_clicks(&data, &names);
    }
    if wants("corrections") {
        corrections(&data.join("davis2016"), &names);
    }
}

/// An image with ground truth.
struct Case {
    set: &'static str,
    /// Whether it belongs to the half for checking.
    is_check: bool,
    source: CaseSource,
}

/// Where image, depth and ground truth of a case come from.
enum CaseSource {
    Files {
        image: PathBuf,
        depth: Option<PathBuf>,
        truth: PathBuf,
        is_binary: bool,
    },
    /// A view of a rendered rice tiller before posters.
    Tiller { seed: u64, view: usize },
}

/// Image, depth and objects of a case.
struct CaseImages {
    image: Arc<Image>,
    depth: Option<Arc<DepthMap>>,
    objects: Vec<Region>,
}

impl CaseSource {
    fn read(&self) -> CaseImages {
        match self {
            Self::Files {
                image,
                depth,
                truth,
                is_binary,
            } => {
                let truth = image::open(truth)
                    .expect("the ground truth can be read")
                    .to_luma8();
                let object = |value: u8| Region {
                    width: truth.width(),
                    height: truth.height(),
                    inside: truth
                        .pixels()
                        .map(|pixel| match is_binary {
                            true => pixel.0[0] > 127,
                            false => pixel.0[0] == value,
                        })
                        .collect(),
                };
                let values = if *is_binary { 255..=255 } else { 1..=20 };
                CaseImages {
                    image: read_image(image),
                    depth: depth.as_ref().map(|path| Arc::new(read_depth(path))),
                    objects: values.map(object).collect(),
                }
            }
            Self::Tiller { seed, view } => {
                let options = SceneOptions {
                    seed: *seed,
                    noise: Some(SensorNoise::default()),
                    ..SceneOptions::default()
                };
                let scene = Scene::build(&options).expect("the options are valid");
                let rendered = scene.render(&scene.views()[*view]);
                let mut ids = rendered.mask.ids.clone();
                ids.sort_unstable();
                ids.dedup();
                let mask = &rendered.mask;
                CaseImages {
                    objects: ids
                        .into_iter()
                        .filter(|&id| id != LabelId::NONE)
                        .map(|id| mask.region(id))
                        .collect(),
                    image: Arc::new(rendered.image),
                    depth: None,
                }
            }
        }
    }
}

/// Number of clicks per object.
const CLICKS: usize = 3;
/// Minimum area of an object, pixels.
const LEAST_PX: usize = 400;

fn first_clicks(data: &Path, names: &[&str]) {
    let mut cases = davis_cases(&data.join("davis2016"), names);
    if names.is_empty() {
        cases.extend(labelled_cases(&data.join("apc_shelf_rgbd_labels")));
    }
    if names.is_empty() || names.contains(&"tiller") {
        cases.extend(tiller_cases());
    }
    let found: Vec<(usize, Vec<FirstAnswers>)> = (0..cases.len())
        .into_par_iter()
        .map(|at| (at, first_answers(&cases[at])))
        .collect();
    println!(
        "first answers with an IoU of at least 0.5, and those that take more than a fifth of the image besides the object: \
         automatic, best of all sizes, then of implausible from {SHARES:?} of the image on"
    );
    let mut of_set: BTreeMap<(&str, bool), Vec<FirstAnswers>> = BTreeMap::new();
    for (at, answers) in found {
        let key = (cases[at].set, cases[at].is_check);
        of_set.entry(key).or_default().extend(answers);
    }
    for ((set, is_check), answers) in of_set {
        let percent = |test: &dyn Fn(&FirstAnswer) -> bool| {
            let share = |which: usize| {
                let count = answers.iter().filter(|all| test(&all[which])).count();
                format!("{:5.1}", 100.0 * count as f64 / answers.len().max(1) as f64)
            };
            let shares: Vec<_> = (0..2 + SHARES.len()).map(share).collect();
            shares.join(" ")
        };
        println!(
            "{set:12} {:5} {:4} clicks: {} %;  {} %",
            if is_check { "check" } else { "tune" },
            answers.len(),
            percent(&|answer| answer.iou >= 0.5),
            percent(&|answer| answer.takes_background),
        );
    }
}

/// Returns every eighth image of each clip; every second clip is for checking.
fn davis_cases(root: &Path, names: &[&str]) -> Vec<Case> {
    let mut cases = Vec::new();
    for (number, clip) in sorted(&root.join("JPEGImages")).iter().enumerate() {
        let name = clip.file_name().unwrap_or_default().to_string_lossy();
        if !names.is_empty() && !names.contains(&&*name) {
            continue;
        }
        for image in sorted(clip).into_iter().step_by(8) {
            let file = Path::new(image.file_name().unwrap_or_default()).with_extension("png");
            cases.push(Case {
                set: "davis",
                is_check: number % 2 == 1,
                source: CaseSource::Files {
                    depth: None,
                    truth: root.join("Annotations").join(&*name).join(file),
                    image,
                    is_binary: true,
                },
            });
        }
    }
    cases
}

/// Returns all images of a recording, without and with depth; every second one is for checking.
fn labelled_cases(root: &Path) -> Vec<Case> {
    let mut cases = Vec::new();
    for (number, image) in sorted(&root.join("color")).into_iter().enumerate() {
        let file = image.file_name().unwrap_or_default().to_owned();
        for (set, depth) in [
            ("shelf", None),
            ("shelf depth", Some(root.join("depth").join(&file))),
        ] {
            cases.push(Case {
                set,
                is_check: number % 2 == 1,
                source: CaseSource::Files {
                    image: image.clone(),
                    depth,
                    truth: root.join("labels").join(&file),
                    is_binary: false,
                },
            });
        }
    }
    cases
}

/// Returns views of rendered rice tillers without depth; every second is for checking.
fn tiller_cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (number, seed) in (31..35).enumerate() {
        cases.push(Case {
            set: "tiller",
            is_check: number % 2 == 1,
            source: CaseSource::Tiller {
                seed,
                view: 6 * number,
            },
        });
    }
    cases
}

/// Shares of the image from which an answer is implausible, one per rule.
const SHARES: [f32; 4] = [0.3, 0.4, 0.5, 0.6];

/// Answers to a first click: of the automatic size, the best of all sizes, and by each rule.
type FirstAnswers = [FirstAnswer; 2 + SHARES.len()];

/// How good an answer to a first click is.
#[derive(Debug, Clone, Copy, Default)]
struct FirstAnswer {
    iou: f64,
    /// Whether more than a fifth of the image is in the answer and not in the object.
    takes_background: bool,
}

impl FirstAnswer {
    fn of(answer: &Region, object: &Region) -> Self {
        let pairs = answer.inside.iter().zip(&object.inside);
        let wrong = pairs
            .filter(|(answer, object)| **answer && !**object)
            .count();
        Self {
            iou: answer.iou(object),
            takes_background: 5 * wrong > answer.inside.len(),
        }
    }
}

/// Returns the answers to each first click on the objects of an image.
fn first_answers(case: &Case) -> Vec<FirstAnswers> {
    let CaseImages {
        image,
        depth,
        objects,
    } = case.source.read();
    let frame = BuiltinSegmenter
        .prepare(&image, depth.as_ref(), &Progress::default())
        .expect("the image can be prepared");
    let ranked = RankedFrame::new(&image, depth.as_deref(), &Progress::default())
        .expect("the image can be prepared");
    let mut answers = Vec::new();
    for object in objects {
        if object.area() < LEAST_PX {
            continue;
        }
        for at_px in landmarks(&object, CLICKS) {
            let of_size =
                |size: AnswerSize| FirstAnswer::of(&first_answer(&*frame, at_px, size), &object);
            let of_sizes = AnswerSize::ALL.map(of_size);
            let best = of_sizes.into_iter().max_by(|a, b| a.iou.total_cmp(&b.iou));
            let mut all = FirstAnswers::default();
            all[..2].copy_from_slice(&[of_sizes[2], best.unwrap_or_default()]);
            for (answer, share) in all[2..].iter_mut().zip(SHARES) {
                let region = plausible_answer(&ranked, at_px, share, &object);
                *answer = FirstAnswer::of(&region, &object);
            }
            answers.push(all);
        }
    }
    answers
}

fn first_answer(frame: &dyn PreparedFrame, at_px: DVec2, size: AnswerSize) -> Region {
    let prompt = Prompt {
        clicks: vec![Click {
            at_px,
            include: true,
        }],
        size,
        ..Prompt::default()
    };
    let request = SegmentRequest {
        prompt: &prompt,
        previous: None,
        taken: None,
    };
    frame
        .segment(&request, &Progress::default())
        .expect("a click inside the image has an answer")
}

/// Returns the answer by a rule; `frame_of` gives the size of the image.
fn plausible_answer(ranked: &RankedFrame, at_px: DVec2, share: f32, frame_of: &Region) -> Region {
    let (width, height) = (frame_of.width as usize, frame_of.height as usize);
    let taken = Region::empty(frame_of.width, frame_of.height);
    let of_pixel = ranked.region_of_pixel();
    let mut areas = vec![0.0f32; ranked.region_count()];
    let mut borders = vec![[false; 4]; ranked.region_count()];
    for (at, &region) in of_pixel.iter().enumerate() {
        let (x, y) = (at % width, at / width);
        areas[region as usize] += 1.0;
        let touched = [x == 0, x + 1 == width, y == 0, y + 1 == height];
        for (known, touched) in borders[region as usize].iter_mut().zip(touched) {
            *known |= touched;
        }
    }
    let is_plausible = |change: &[bool]| {
        let changed = || (0..change.len()).filter(|&at| change[at]);
        let area: f32 = changed().map(|at| areas[at]).sum();
        let touched = (0..4).filter(|&side| changed().any(|at| borders[at][side]));
        area <= share * (width * height) as f32 && touched.count() < 3
    };
    let request = RankedClick {
        click: Click {
            at_px,
            include: true,
        },
        earlier: &[],
        previous: None,
        taken: &taken,
    };
    ranked.answer(&request, &mut |found| {
        let automatic = best(&WEIGHTS, found.kind, &found.terms, &found.shared).unwrap_or(0);
        if is_plausible(&found.changes[automatic]) {
            return automatic;
        }
        let left: Vec<usize> = (0..found.changes.len())
            .filter(|&at| is_plausible(&found.changes[at]))
            .collect();
        let terms: Vec<_> = left.iter().map(|&at| found.terms[at]).collect();
        let shared: Vec<Vec<f32>> = left
            .iter()
            .map(|&a| left.iter().map(|&b| found.shared[a][b]).collect())
            .collect();
        best(&WEIGHTS, found.kind, &terms, &shared).map_or(automatic, |at| left[at])
    })
}

/// Kinds of correcting clicks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ClickKind {
    Include,
    /// An exclude click in a large error, which removes a whole region.
    Leak,
    Exclude,
}

/// A correcting click: its kind, the gain, and the gain of a local correction instead.
type Gain = (ClickKind, f64, f64);

fn corrections(set: &Path, names: &[&str]) {
    println!("mean gain of IoU of a click, share that gains, share that loses 0.02 or more");
    let mut all: Vec<Gain> = Vec::new();
    for clip in sorted(&set.join("JPEGImages")) {
        let name = clip.file_name().unwrap_or_default().to_string_lossy();
        if names.is_empty() || names.contains(&&*name) {
            let gains = clip_gains(set, &name);
            print_gains(&name, &gains);
            all.extend(gains);
        }
    }
    print_gains("all", &all);
}

fn print_gains(name: &str, gains: &[Gain]) {
    for kind in [ClickKind::Include, ClickKind::Leak, ClickKind::Exclude] {
        let of_kind = || gains.iter().filter(|gain| gain.0 == kind);
        let count = of_kind().count();
        let line = |of: fn(&Gain) -> f64| {
            let total = count.max(1) as f64;
            let mean = of_kind().map(of).sum::<f64>() / total;
            let share = |test: &dyn Fn(f64) -> bool| {
                100.0 * of_kind().filter(|gain| test(of(gain))).count() as f64 / total
            };
            format!(
                "{mean:+.4} {:3.0} % {:3.0} %",
                share(&|gain| gain > 0.0),
                share(&|gain| gain <= -0.02)
            )
        };
        println!(
            "{name:14} {:8} {count:4} clicks: {}; as local corrections {}",
            format!("{kind:?}"),
            line(|gain| gain.1),
            line(|gain| gain.2)
        );
    }
}

const OBJECT: LabelId = LabelId(1);

/// Tracks a clip from its first mask and returns the gains of the clicks on every fourth frame.
fn clip_gains(set: &Path, clip: &str) -> Vec<Gain> {
    let source = FrameFolder {
        frames: set.join("JPEGImages").join(clip),
        depth: None,
    };
    let request = OpenRequest {
        sources: vec![source],
        ..OpenRequest::default()
    };
    let frames = open(&request, &Progress::default())
        .expect("the clip can be opened")
        .frames;
    let truth = |frame: &Frame| {
        let file = Path::new(&frame.name).with_extension("png");
        let grey = image::open(set.join("Annotations").join(clip).join(file))
            .expect("the ground truth can be read")
            .to_luma8();
        let id = |pixel: &image::Luma<u8>| LabelId(u16::from(pixel.0[0] > 127));
        LabelMask {
            width: grey.width(),
            height: grey.height(),
            ids: grey.pixels().map(id).collect(),
        }
    };
    let store = Arc::new(FrameStore::new(256 << 20));
    let tracking = TrackRequest {
        from: 0,
        to: frames.len() - 1,
        store: Arc::clone(&store),
        keyframes: BTreeMap::from([(0, Arc::new(truth(&frames[0])))]),
        direction: Direction::Both,
        labels: None,
        frames: Arc::new(frames),
    };
    let mut tracked = BTreeMap::new();
    let mut take = |frame: TrackedFrame| {
        tracked.insert(frame.frame, frame.mask);
    };
    FlowTracker::default()
        .track(&tracking, &mut take, &Progress::default())
        .expect("the clip can be tracked");
    let chosen: Vec<(&usize, &LabelMask)> = tracked.iter().step_by(4).collect();
    let gains: Vec<Vec<Gain>> = chosen
        .into_par_iter()
        .map(|(&frame, mask)| {
            let of = &tracking.frames[frame];
            let image = store.image(of).expect("the image can be read");
            frame_gains(of, &image, &truth(of).region(OBJECT), mask)
        })
        .collect();
    gains.into_iter().flatten().collect()
}

fn frame_gains(frame: &Frame, image: &Arc<Image>, truth: &Region, mask: &LabelMask) -> Vec<Gain> {
    let ready = BuiltinSegmenter
        .prepare(image, None, &Progress::default())
        .expect("the image can be prepared");
    let mut project = Project::default();
    let edits = [
        Edit::AddFrames {
            frames: vec![frame.clone()],
        },
        Edit::SetLabel {
            id: OBJECT,
            label: Some(Label {
                id: OBJECT,
                name: "object".into(),
                color: [255, 0, 0],
                parent: None,
            }),
        },
        Edit::SetMask {
            frame: 0,
            mask: Some(keyframe(mask)),
        },
    ];
    for edit in edits {
        project.apply(edit).expect("the edit is valid");
    }
    let mut prompt = Prompt::default();
    let mut gains = Vec::new();
    for _ in 0..4 {
        let now = region_of(&project);
        let before = now.iou(truth);
        let Some(click) = next_click(truth, &now).filter(|_| before < 0.9) else {
            break;
        };
        prompt.clicks.push(click);
        let answers = [AnswerSize::Automatic, AnswerSize::Smaller].map(|size| {
            let prompt = Prompt {
                size,
                ..prompt.clone()
            };
            let request = PromptRequest {
                frame: 0,
                label: OBJECT,
                prompt,
                segmenter: SegmenterId::Builtin,
            };
            let meaning = PromptMeaning::new(&project, &request).expect("the prompt is valid");
            let region = meaning
                .segment(&*ready, image, &Progress::default())
                .expect("the click has an answer");
            (
                meaning.edits(&project, &region).expect("the answer fits"),
                region,
            )
        });
        let [automatic, smaller] = answers;
        let gain = |region: &Region| region.iou(truth) - before;
        let is_leak = !click.include && is_deep(&now, &click);
        let (kind, local) = if click.include {
            (ClickKind::Include, &automatic.1)
        } else if is_leak {
            (ClickKind::Leak, &smaller.1)
        } else {
            (ClickKind::Exclude, &automatic.1)
        };
        gains.push((kind, gain(&automatic.1), gain(local)));
        for edit in automatic.0 {
            project.apply(edit).expect("the edit is valid");
        }
    }
    gains
}

/// Returns whether all pixels within 8 pixels of a click are inside.
fn is_deep(region: &Region, click: &Click) -> bool {
    const DEPTH_PX: f64 = 8.0;
    let width = region.width as usize;
    (0..region.inside.len()).all(|at| {
        let centre = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        region.inside[at] || centre.distance(click.at_px) > DEPTH_PX
    })
}

fn region_of(project: &Project) -> Region {
    mask_of(project, 0)
        .expect("the frame exists")
        .region(OBJECT)
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("the folder can be read");
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths
}
