//! Accuracy and time of the built-in segmenter with a simulated user.
//!
//! The images are real and have ground truth.
//!
//! `cargo bench --bench segmenter [davis] [shelf] [tiller] [boxes] [time] [NAME…]`; with
//! `OSTRA_SHOTS=DIR`, results are drawn to that folder.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a bench prints its table and ends where data is missing"
)]

#[path = "../support/images.rs"]
mod images;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec2;
use ostra_core::job::Progress;
use ostra_eval::simulated_click::next_click;
use ostra_eval::synthetic::{Scene, SceneOptions};
use ostra_frames::{DepthMap, Image};
use ostra_masks::graph_cut::BuiltinSegmenter;
use ostra_masks::{
    Click, LabelId, PreparedFrame, Prompt, PxBox, Region, SegmentRequest, Segmenter,
};

use images::{read_depth, read_image};

const CAP: usize = 20;
const SHOWN: [usize; 5] = [1, 3, 5, 10, 20];

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with('-'))
        .collect();
    let parts = ["davis", "shelf", "tiller", "boxes", "time"];
    let wants = |part: &str| {
        words.iter().any(|word| word == part) || !words.iter().any(|word| parts.contains(&&**word))
    };
    let names: Vec<&str> = words
        .iter()
        .map(|word| &**word)
        .filter(|word| !parts.contains(word))
        .collect();
    let data = std::env::var_os("OSTRA_DATA")
        .map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    if !data.is_dir() {
        println!("no images at {}: set OSTRA_DATA", data.display());
        return;
    }
    if wants("davis") {
        davis(&data.join("davis2016"), &names);
    }
    if wants("shelf") {
        shelf(&data.join("apc_shelf_rgbd_labels"), &names);
    }
    if wants("tiller") {
        tiller(&names);
    }
    if wants("boxes") {
        boxes(&data, &names);
    }
    if wants("time") {
        times(&data.join("davis2016"));
    }
}

/// Plays the simulated user on the first, middle and last frame of each clip.
fn davis(root: &Path, names: &[&str]) {
    println!("davis2016: IoU after clicks, clicks to 0.85 and 0.90, ms an answer");
    let mut runs = Vec::new();
    for (name, image, truth) in davis_frames(root, names) {
        let run = play(&name, &image, None, &truth, CAP);
        println!("{}", run.line(&name));
        runs.push(run);
    }
    summary(&runs);
}

/// Returns the first, middle and last frame of each clip with ground truth.
fn davis_frames(root: &Path, names: &[&str]) -> impl Iterator<Item = (String, Arc<Image>, Region)> {
    let clips = sorted(&root.join("JPEGImages")).into_iter();
    let wanted = clips.filter(|clip| names.is_empty() || names.contains(&&**clip));
    wanted.flat_map(|clip| {
        let folder = root.join("JPEGImages").join(&clip);
        let images = sorted(&folder);
        [0, images.len() / 2, images.len() - 1].map(|at| {
            let truth = root
                .join("Annotations")
                .join(&clip)
                .join(format!("{at:05}.png"));
            (
                format!("{clip}-{at}"),
                read_image(&folder.join(&images[at])),
                mask(&truth, |value| value > 127),
            )
        })
    })
}

/// Scores the ground truth's bounding box as the only prompt.
fn boxes(data: &Path, names: &[&str]) {
    println!("IoU of a box alone");
    let mut sum = (0.0, 0.0);
    for (name, image, truth) in davis_frames(&data.join("davis2016"), names) {
        let found = boxed(&name, &image, None, &truth);
        println!("{name:18} {found:.3}");
        sum = (sum.0 + found, sum.1 + 1.0);
    }
    println!("mean of davis2016 {:.3}", sum.0 / f64::max(sum.1, 1.0));
    for (kind, title) in ["colour alone", "with depth"].iter().enumerate() {
        let mut sum = (0.0, 0.0);
        for (name, image, depth, truth) in shelf_objects(&data.join("apc_shelf_rgbd_labels"), names)
        {
            sum = (
                sum.0
                    + boxed(
                        &format!("{name}-{kind}"),
                        &image,
                        (kind == 1).then_some(&depth),
                        &truth,
                    ),
                sum.1 + 1.0,
            );
        }
        println!(
            "mean of the shelf, {title}: {:.3}",
            sum.0 / f64::max(sum.1, 1.0)
        );
    }
}

/// Returns every object of every third view.
fn shelf_objects(root: &Path, names: &[&str]) -> Vec<(String, Arc<Image>, Arc<DepthMap>, Region)> {
    let mut found = Vec::new();
    for (at, file) in sorted(&root.join("color")).iter().enumerate().step_by(3) {
        let image = read_image(&root.join("color").join(file));
        let depth = Arc::new(read_depth(&root.join("depth").join(file)));
        for object in 1..=4u8 {
            let name = format!("shelf{at}-{object}");
            if names.is_empty() || names.contains(&&*name) {
                let truth = mask(&root.join("labels").join(file), |value| value == object);
                found.push((name, image.clone(), depth.clone(), truth));
            }
        }
    }
    found
}

fn summary(runs: &[Run]) {
    let count = runs.len().max(1) as f64;
    let clicks = |goal: f64| {
        runs.iter()
            .map(|run| run.clicks_to(goal).unwrap_or(CAP) as f64)
            .sum::<f64>()
            / count
    };
    let failed = |goal: f64| {
        runs.iter()
            .filter(|run| run.clicks_to(goal).is_none())
            .count()
    };
    println!(
        "mean of {}: clicks to 0.85 {:.2} ({} failed), to 0.90 {:.2} ({} failed)",
        runs.len(),
        clicks(0.85),
        failed(0.85),
        clicks(0.90),
        failed(0.90)
    );
    let mean = |after: usize| runs.iter().map(|run| run.after(after)).sum::<f64>() / count;
    let means: Vec<f64> = (1..=CAP).map(mean).collect();
    println!(
        "mean IoU after 1…{CAP}: {}",
        means
            .iter()
            .map(|iou| format!("{iou:.3}"))
            .collect::<Vec<_>>()
            .join(" ")
    );
    let falls = means
        .windows(2)
        .filter(|pair| pair[1] < pair[0] - 1e-9)
        .count();
    println!("further clicks that lower the mean: {falls}");
    let mut answers: Vec<Duration> = runs
        .iter()
        .flat_map(|run| run.answers.iter().copied())
        .collect();
    let mut prepared: Vec<Duration> = runs.iter().map(|run| run.prepared).collect();
    println!(
        "median answer {:.1} ms, median preparation {:.0} ms",
        median_ms(&mut answers),
        median_ms(&mut prepared)
    );
}

/// Plays the simulated user on every object of every third shelf view, with and without depth.
fn shelf(root: &Path, names: &[&str]) {
    println!("shelf: IoU after 1, 2, 3 clicks without depth | with depth");
    let mut sums = [[0.0; 3]; 2];
    let mut best = [[[0.0f64; 3]; 2]; 4];
    let mut count = 0.0;
    for (name, image, depth, truth) in shelf_objects(root, names) {
        let mut line = format!("{name:16}");
        for (kind, depth) in [None, Some(&depth)].into_iter().enumerate() {
            let run = play(
                &format!("{name}-{}", ["rgb", "rgbd"][kind]),
                &image,
                depth,
                &truth,
                3,
            );
            for clicks in 0..3 {
                sums[kind][clicks] += run.after(clicks + 1);
                let object = name
                    .bytes()
                    .last()
                    .map_or(0, |digit| usize::from(digit - b'1'));
                let most = &mut best[object][kind][clicks];
                *most = most.max(run.after(clicks + 1));
                line += &format!(" {:.3}", run.after(clicks + 1));
            }
            line += " |";
        }
        count += 1.0;
        println!("{line}");
    }
    for (kind, sums) in ["colour alone", "with depth"].iter().zip(sums) {
        println!(
            "mean {kind}: {}",
            sums.map(|sum| format!("{:.3}", sum / count)).join(" ")
        );
    }
    for (object, best) in best.iter().enumerate() {
        println!(
            "best view of object {}: {:.3?} | {:.3?}",
            object + 1,
            best[0],
            best[1]
        );
    }
}

/// Plays the simulated user on each organ class of a synthetic tiller, with exact depth.
///
/// Many parts share one label.
fn tiller(names: &[&str]) {
    println!("tiller: IoU after 1 2 3 5 8 clicks with depth");
    let options = SceneOptions {
        seed: 7,
        views: 3,
        ..SceneOptions::default()
    };
    let scene = Scene::build(&options).expect("the default scene can be made");
    for view in scene.views() {
        let seen = scene.render(view);
        let (image, depth) = (Arc::new(seen.image), Arc::new(seen.depth));
        for label in scene
            .tree()
            .iter()
            .filter(|label| scene.tree().depth(label.id) == Scene::CLASS_LEVEL)
        {
            let name = format!("tiller{}-{}", view.index, label.name);
            if !names.is_empty() && !names.contains(&&*name) {
                continue;
            }
            let is_inside =
                |id: &LabelId| scene.tree().at_level(*id, Scene::CLASS_LEVEL) == label.id;
            let inside = seen.mask.ids.iter().map(is_inside).collect();
            let truth = Region {
                width: image.width,
                height: image.height,
                inside,
            };
            let run = play(&name, &image, Some(&depth), &truth, 8);
            let ious: Vec<String> = [1, 2, 3, 5, 8]
                .map(|after| format!("{:.3}", run.after(after)))
                .into();
            println!("{name:18} {}", ious.join(" "));
        }
    }
}

/// Measures only the time, at both sizes.
fn times(root: &Path) {
    for (width, height) in [(854, 480), (1280, 720)] {
        let mut runs = Vec::new();
        for clip in ["blackswan", "dance-twirl", "scooter-black"] {
            let image = resized(
                &read_image(&root.join("JPEGImages").join(clip).join("00020.jpg")),
                width,
                height,
            );
            let truth = mask(
                &root.join("Annotations").join(clip).join("00020.png"),
                |value| value > 127,
            );
            runs.push(play(
                clip,
                &image,
                None,
                &resized_region(&truth, width, height),
                10,
            ));
        }
        let mut answers: Vec<Duration> = runs
            .iter()
            .flat_map(|run| run.answers.iter().copied())
            .collect();
        let mut prepared: Vec<Duration> = runs.iter().map(|run| run.prepared).collect();
        println!(
            "{width}×{height}: median answer {:.1} ms, longest {:.1} ms, median preparation {:.0} ms",
            median_ms(&mut answers),
            answers.last().map_or(0.0, |time| time.as_secs_f64() * 1e3),
            median_ms(&mut prepared)
        );
    }
}

/// Results of one frame.
struct Run {
    ious: Vec<f64>,
    answers: Vec<Duration>,
    prepared: Duration,
}

impl Run {
    fn after(&self, clicks: usize) -> f64 {
        self.ious
            .get(clicks - 1)
            .or(self.ious.last())
            .copied()
            .unwrap_or(0.0)
    }

    fn clicks_to(&self, goal: f64) -> Option<usize> {
        self.ious
            .iter()
            .position(|&iou| iou >= goal)
            .map(|at| at + 1)
    }

    fn line(&self, name: &str) -> String {
        let ious: Vec<String> = SHOWN
            .iter()
            .map(|&after| format!("{:.3}", self.after(after)))
            .collect();
        let clicks = |goal| {
            self.clicks_to(goal)
                .map_or_else(|| "-".into(), |clicks| clicks.to_string())
        };
        let time = median_ms(&mut self.answers.clone());
        format!(
            "{name:18} {}  {:>2} {:>2}  {time:.1}",
            ious.join(" "),
            clicks(0.85),
            clicks(0.90)
        )
    }
}

fn play(
    name: &str,
    image: &Arc<Image>,
    depth: Option<&Arc<DepthMap>>,
    truth: &Region,
    cap: usize,
) -> Run {
    let start = Instant::now();
    let frame = BuiltinSegmenter
        .prepare(image, depth, &Progress::default())
        .expect("the image can be prepared");
    let mut run = Run {
        ious: Vec::new(),
        answers: Vec::new(),
        prepared: start.elapsed(),
    };
    let mut answer = Region::empty(truth.width, truth.height);
    let mut prompt = Prompt::default();
    while let Some(click) = next_click(truth, &answer).filter(|_| run.ious.len() < cap) {
        prompt.clicks.push(click);
        let start = Instant::now();
        answer = ask(&*frame, &prompt, &answer);
        run.answers.push(start.elapsed());
        run.ious.push(iou(truth, &answer));
        shoot(name, run.ious.len(), image, truth, &answer, &prompt.clicks);
    }
    run
}

/// Returns the IoU of the result for the ground truth's bounding box only.
fn boxed(name: &str, image: &Arc<Image>, depth: Option<&Arc<DepthMap>>, truth: &Region) -> f64 {
    let frame = BuiltinSegmenter
        .prepare(image, depth, &Progress::default())
        .expect("the image can be prepared");
    let width = truth.width as usize;
    let places = || {
        (0..truth.inside.len())
            .filter(|&at| truth.inside[at])
            .map(|at| (at % width, at / width))
    };
    let least = |axis: fn((usize, usize)) -> usize| places().map(axis).min().unwrap_or(0) as f64;
    let most =
        |axis: fn((usize, usize)) -> usize| places().map(axis).max().unwrap_or(0) as f64 + 1.0;
    let part = PxBox {
        min_px: DVec2::new(least(|place| place.0), least(|place| place.1)),
        max_px: DVec2::new(most(|place| place.0), most(|place| place.1)),
    };
    let prompt = Prompt {
        boxes: vec![part],
        ..Prompt::default()
    };
    let answer = ask(&*frame, &prompt, truth);
    shoot(&format!("{name}-box"), 0, image, truth, &answer, &[]);
    iou(truth, &answer)
}

fn ask(frame: &dyn PreparedFrame, prompt: &Prompt, answer: &Region) -> Region {
    let previous = (prompt.clicks.len() > 1).then_some(answer);
    frame
        .segment(
            &SegmentRequest {
                prompt,
                previous,
                taken: None,
            },
            &Progress::default(),
        )
        .expect("a click inside the image has an answer")
}

fn iou(a: &Region, b: &Region) -> f64 {
    let pairs = || a.inside.iter().zip(&b.inside);
    let both = pairs().filter(|(a, b)| **a && **b).count();
    let any = pairs().filter(|(a, b)| **a || **b).count();
    both as f64 / any.max(1) as f64
}

fn median_ms(times: &mut [Duration]) -> f64 {
    times.sort();
    times
        .get(times.len() / 2)
        .map_or(0.0, |time| time.as_secs_f64() * 1e3)
}

fn sorted(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("the folder of images can be read");
    let mut names: Vec<String> = entries
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into())
        .collect();
    names.sort();
    names
}

fn mask(path: &Path, is_inside: impl Fn(u8) -> bool) -> Region {
    let image = image::open(path).expect("the mask can be read").to_luma8();
    Region {
        width: image.width(),
        height: image.height(),
        inside: image.pixels().map(|pixel| is_inside(pixel.0[0])).collect(),
    }
}

fn resized(image: &Image, width: u32, height: u32) -> Arc<Image> {
    let buffer =
        image::RgbImage::from_fn(image.width, image.height, |x, y| image::Rgb(image.at(x, y)));
    let buffer = image::imageops::resize(
        &buffer,
        width,
        height,
        image::imageops::FilterType::CatmullRom,
    );
    Arc::new(Image {
        width,
        height,
        pixels: buffer.pixels().map(|pixel| pixel.0).collect(),
    })
}

fn resized_region(region: &Region, width: u32, height: u32) -> Region {
    let at = |place: u32| {
        region.at(
            place % width * region.width / width,
            place / width * region.height / height,
        )
    };
    Region {
        width,
        height,
        inside: (0..width * height).map(at).collect(),
    }
}

/// Draws a result: red where right, blue where missed, green where too much.
///
/// Clicks are white and black.
fn shoot(
    name: &str,
    number: usize,
    image: &Image,
    truth: &Region,
    answer: &Region,
    clicks: &[Click],
) {
    let Some(folder) = std::env::var_os("OSTRA_SHOTS") else {
        return;
    };
    let mut out = image::RgbImage::from_fn(image.width, image.height, |x, y| {
        let tint = match (truth.at(x, y), answer.at(x, y)) {
            (true, true) => [255, 0, 0],
            (true, false) => [0, 0, 255],
            (false, true) => [0, 255, 0],
            (false, false) => image.at(x, y),
        };
        let pixel = image.at(x, y);
        image::Rgb(std::array::from_fn(|channel| {
            (pixel[channel] / 2).saturating_add(tint[channel] / 2)
        }))
    });
    for click in clicks {
        for (dx, dy) in (-3i64..=3).flat_map(|dx| (-3i64..=3).map(move |dy| (dx, dy))) {
            let (x, y) = (click.at_px.x as i64 + dx, click.at_px.y as i64 + dy);
            if x >= 0 && y >= 0 && x < i64::from(image.width) && y < i64::from(image.height) {
                out.put_pixel(
                    x as u32,
                    y as u32,
                    image::Rgb(if click.include { [255; 3] } else { [0; 3] }),
                );
            }
        }
    }
    let path = Path::new(&folder).join(format!("{name}-{number:02}.png"));
    out.save(&path).expect("the drawing can be written");
}
