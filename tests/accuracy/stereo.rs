//! Tests of stereo depth on real images: floors that may only rise, stop and resume, and errors.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use ostra_frames::DepthSource;
use ostra_project::{ReconstructMethod, ReconstructRequest};
use ostra_session::Event;
use ostra_session::{Command, Session};
use serde_json::Value;
use tempfile::TempDir;

use crate::data::data_dir;
use crate::program::ostra;
use crate::project::Project;

/// Returns a project of the first images of a set, with its ground-truth cameras.
fn project(set: &Path, frames: usize) -> Project {
    let last = (frames - 1).to_string();
    let cameras = set.join("sparse");
    Project::new(
        &set.join("images"),
        &["--cameras", cameras.to_str().unwrap(), "--to", &last],
    )
}

fn stereo(project: &Project, side: u32) -> String {
    project.done(&[
        "reconstruct",
        &project.root(),
        "--method",
        "mvs",
        "--max-side",
        &side.to_string(),
    ])
}

/// Scores the fused cloud against the set's reference points at three distances.
///
/// The images show what each camera sees, which decides the pairs that are compared in depth.
fn score(project: &Project, set: &Path, within: &str) -> Value {
    let dir = TempDir::new().unwrap();
    let cloud = dir.path().join("cloud.ply");
    project.done(&["fuse", &project.root()]);
    project.done(&[
        "export",
        &project.root(),
        "--cloud",
        cloud.to_str().unwrap(),
    ]);
    let (truth, cameras) = (set.join("sparse_reference.ply"), dir.path().join("cameras"));
    project.done(&[
        "export",
        &project.root(),
        "--cameras",
        cameras.to_str().unwrap(),
    ]);
    let [truth, cloud, cameras] = [&truth, &cloud, &cameras].map(|path| path.to_str().unwrap());
    let root = project.root();
    let seen = ["--within", within, "--cameras", cameras, "--min-views", "3"];
    let scored = |how: &[&str]| -> Value {
        let text = project.done(
            &[
                &[
                    "eval", "cloud", "--truth", truth, "--result", cloud, "--json",
                ],
                how,
            ]
            .concat(),
        );
        serde_json::from_str(text.lines().last().unwrap()).unwrap()
    };
    let (reported, guessed) = (
        scored(&[&seen[..], &["--frames", &root]].concat()),
        scored(&seen),
    );
    assert_ne!(reported["compared_in_depth"], guessed["compared_in_depth"]);
    assert_eq!(
        completeness(&reported),
        completeness(&guessed),
        "images tell of the share in depth alone"
    );
    reported
}

fn completeness(score: &Value) -> Vec<f64> {
    score["surface"]
        .as_array()
        .unwrap()
        .iter()
        .map(|at| at["completeness"].as_f64().unwrap())
        .collect()
}

/// Minimum number of pairs for a meaningful share in depth.
const LEAST_PAIRS: u64 = 2000;

/// Returns the completeness at each distance and the share in depth at the last one.
fn shares(score: &Value) -> (Vec<f64>, f64) {
    let surface = score["surface"].as_array().unwrap();
    let pairs = score["compared_in_depth"].as_u64().unwrap();
    println!(
        "{} points; {pairs} pairs in depth; {surface:?}",
        score["result_points"]
    );
    assert!(pairs > LEAST_PAIRS, "{pairs} pairs compared in depth");
    (
        completeness(score),
        surface.last().unwrap()["in_depth"].as_f64().unwrap(),
    )
}

fn dtu_with_ground_truth_cameras() {
    let data = data_dir();
    let set = data.join("dtu_scan24");
    let project = project(&set, 12);
    let message = stereo(&project, 640);
    assert!(message.contains("12 of 12 views"), "{message}");
    let score = score(&project, &set, "1,2,3");
    let (complete, in_depth) = shares(&score);
    assert!(complete[0] >= 0.88 && complete[1] >= 0.97, "{complete:?}");
    assert!(in_depth >= 0.98, "{in_depth}");
    assert!(score["result_points"].as_f64().unwrap() <= 1.5 * 288_970.0);
}

fn fountain_with_ground_truth_cameras() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let project = project(&set, 11);
    stereo(&project, 640);
    let score = score(&project, &set, "0.01,0.02,0.05,0.03");
    let (complete, in_depth) = shares(&score);
    assert!(
        complete[0] >= 0.72 && complete[1] >= 0.92 && complete[2] >= 0.98,
        "{complete:?}"
    );
    assert!(in_depth >= 0.955, "{in_depth}");
    assert!(score["result_points"].as_f64().unwrap() <= 1.5 * 393_656.0);
}

fn request() -> Command {
    let method = ReconstructMethod::Mvs;
    Command::Reconstruct(ReconstructRequest {
        method,
        max_side: Some(200),
        ..ReconstructRequest::default()
    })
}

/// Runs stereo and stops it in a stage after `views` views; returns the events.
///
/// The progress is polled without a pause.
fn stopped(session: &mut Session, stage: &str, views: usize) -> Vec<Event> {
    session.act(request()).unwrap();
    let mut events = Vec::new();
    while !session.jobs().is_empty() {
        if session
            .jobs()
            .iter()
            .any(|job| job.report.stage == stage && job.report.done >= views)
        {
            session.act(Command::Stop).unwrap();
        }
        events.extend(session.poll());
        std::thread::yield_now();
    }
    events.extend(session.settle(|_| ControlFlow::Continue(())));
    events
}

/// Stops a run in each stage in turn; each time it resumes where it stopped.
///
/// The first resume must replace a damaged file. Returns `None` if a stage ended before it could be
/// stopped.
fn stopped_in_turn(parts: &Project) -> Option<Session> {
    const DAMAGED_BYTES: u64 = 100;
    let mut session = opened(parts);
    let (mut first, mut damaged): (Vec<(PathBuf, SystemTime)>, Option<PathBuf>) =
        (Vec::new(), None);
    for (stage, views) in [("depth", 2), ("consistent depth", 1), ("complete", 1)] {
        let events = stopped(&mut session, stage, views);
        if !events
            .iter()
            .any(|event| matches!(event, Event::Stopped { .. }))
        {
            println!("{stage}: {events:?}");
            return None;
        }
        let frames = &session.project().unwrap().frames;
        assert!(
            frames.iter().all(|frame| frame.depth.is_none()),
            "depths stand when they are done"
        );
        let kept = rounds(&parts.root());
        let is_later =
            |(path, _): &(PathBuf, SystemTime)| !path.parent().unwrap().ends_with("rounds/0");
        if kept.is_empty() || stage == "depth" && kept.iter().any(is_later) {
            println!("{stage}: stopped too late");
            return None;
        }
        let again = first
            .iter()
            .find(|(path, made)| kept.iter().any(|(other, now)| other == path && now != made));
        assert!(again.is_none(), "{stage}: made again: {again:?}");
        first = kept;
        if stage == "depth" {
            let (path, _) = first.remove(0);
            std::fs::OpenOptions::new()
                .write(true)
                .open(&path)
                .unwrap()
                .set_len(DAMAGED_BYTES)
                .unwrap();
            damaged = Some(path);
        } else {
            let is_damaged =
                |path: &PathBuf| path.metadata().is_ok_and(|now| now.len() == DAMAGED_BYTES);
            assert!(
                !damaged.as_ref().is_some_and(is_damaged),
                "{stage}: left as it was: {damaged:?}"
            );
        }
    }
    Some(session)
}

fn opened(project: &Project) -> Session {
    let mut session = Session::new();
    session.act(Command::Open(project.root().into())).unwrap();
    session.settle(|_| ControlFlow::Continue(()));
    session
}

fn depth_maps(root: &str) -> Vec<(String, Vec<u8>)> {
    let files = std::fs::read_dir(Path::new(root).join("depths")).unwrap();
    let mut maps: Vec<(String, Vec<u8>)> = files
        .map(|file| file.unwrap().path())
        .map(|path| {
            (
                path.file_name().unwrap().to_string_lossy().into_owned(),
                std::fs::read(&path).unwrap(),
            )
        })
        .collect();
    maps.sort();
    maps
}

/// Returns the depth maps of all rounds and of the filter, and their modification times.
fn rounds(root: &str) -> Vec<(PathBuf, SystemTime)> {
    let folder = Path::new(root).join("versions/depths-1/rounds");
    let stages = (0..9)
        .map(|round| round.to_string())
        .chain(["filtered".to_owned()]);
    let rounds = stages.filter_map(|stage| std::fs::read_dir(folder.join(stage)).ok());
    // Files being written have another extension and may disappear at any time.
    let files = rounds
        .flatten()
        .map(|file| file.unwrap().path())
        .filter(|path| path.extension().unwrap() == "tiff");
    files
        .map(|path| (path.clone(), path.metadata().unwrap().modified().unwrap()))
        .collect()
}

fn stopped_run_resumes_and_gives_the_same_result() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let whole = project(&set, 5);
    let mut session = opened(&whole);
    session.act(request()).unwrap();
    session.settle(|_| ControlFlow::Continue(()));
    session.save().unwrap();
    drop(session);
    // Completion is short: on a busy machine it may end before the stop.
    let in_turn = |_| {
        let parts = project(&set, 5);
        stopped_in_turn(&parts).map(|session| (parts, session))
    };
    let (parts, mut session) = (0..8)
        .find_map(in_turn)
        .expect("a run can be stopped in every stage");
    session.act(request()).unwrap();
    session.settle(|_| ControlFlow::Continue(()));
    session.save().unwrap();
    let project = session.project().unwrap();
    assert!(
        project
            .frames
            .iter()
            .all(|frame| matches!(frame.depth, Some(DepthSource::Estimated { .. })))
    );
    drop(session);
    let (once, twice) = (depth_maps(&whole.root()), depth_maps(&parts.root()));
    assert_eq!(once.len(), 5);
    assert!(once == twice, "the same depth maps, byte for byte");
}

fn killed_run_resumes_and_gives_the_same_result() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let (whole, killed) = (project(&set, 4), project(&set, 4));
    let args = |root: &str| {
        ["reconstruct", root, "--method", "mvs", "--max-side", "320"].map(str::to_owned)
    };
    assert!(ostra(&args(&whole.root())).status.success());
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_ostra"));
    let mut child = command
        .args(args(&killed.root()))
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    while rounds(&killed.root()).len() < 2 {
        assert!(
            child.try_wait().unwrap().is_none(),
            "it was done before it could be killed"
        );
        std::thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(
        killed.info()["results"]["depths"].is_null(),
        "depths stand when they are done"
    );
    assert!(ostra(&args(&killed.root())).status.success());
    let (once, twice) = (depth_maps(&whole.root()), depth_maps(&killed.root()));
    assert_eq!(once.len(), 4);
    assert!(once == twice, "the same depth maps, byte for byte");
}

/// Checks that the live preview shows points as soon as a view is done, and stays after the job until
/// a cloud replaces it.
fn live_preview_grows_during_stereo() {
    let data = data_dir();
    let project = project(&data.join("dtu_scan24"), 4);
    let mut session = opened(&project);
    let (tell, reported) = std::sync::mpsc::channel();
    session.set_waker(move || {
        let _ = tell.send(());
    });
    session.act(request()).unwrap();
    let mut seen: Vec<usize> = Vec::new();
    while !session.jobs().is_empty() {
        session.poll();
        let points = session.preview_cloud().map_or(0, |cloud| cloud.len());
        if seen.last() != Some(&points) {
            seen.push(points);
        }
        let _ = reported.recv_timeout(Duration::from_millis(200));
    }
    let stays = session.preview_cloud().map(|cloud| cloud.len());
    assert_eq!((seen[0], stays), (0, seen.last().copied()), "{seen:?}");
    let rising = seen.windows(2).filter(|pair| pair[1] > pair[0]).count();
    assert!(
        rising >= 3 && seen.iter().any(|&points| points > 10_000),
        "{seen:?}"
    );
}

fn frames_without_depth_are_reported_and_the_rest_is_done() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let images = TempDir::new().unwrap();
    for k in 0..5 {
        let name = format!("{k:04}.jpg");
        std::fs::copy(set.join("images").join(&name), images.path().join(&name)).unwrap();
    }
    let grey = image::RgbImage::from_pixel(1536, 1024, image::Rgb([90; 3]));
    grey.save(images.path().join("0003.jpg")).unwrap();
    let cameras = set.join("sparse");
    let project = Project::new(images.path(), &["--cameras", cameras.to_str().unwrap()]);
    std::fs::remove_file(images.path().join("0004.jpg")).unwrap();
    let message = stereo(&project, 200);
    assert!(message.contains("3 of 5 views"), "{message}");
    assert!(
        message.contains("0003.jpg has no depth: all its pixels are alike"),
        "{message}"
    );
    assert!(
        message.contains("0004.jpg has no depth") && message.contains("is missing"),
        "{message}"
    );
    let depths: Vec<bool> = project.info()["frames"]
        .as_array()
        .unwrap()
        .iter()
        .map(|frame| frame["depth"].as_bool().unwrap())
        .collect();
    assert_eq!(depths, [true, true, true, false, false]);
}

fn two_views_are_enough_and_one_is_not() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let two = project(&set, 2);
    let message = stereo(&two, 200);
    assert!(message.contains("2 of 2 views"), "{message}");
    let fused = two.done(&["fuse", &two.root()]);
    let header = std::fs::read(Path::new(&two.root()).join("cloud.ply")).unwrap();
    let header = String::from_utf8_lossy(&header[..400]).into_owned();
    let points = header
        .lines()
        .find_map(|line| line.strip_prefix("element vertex ")?.parse::<usize>().ok());
    assert!(
        points.is_some_and(|points| points > 3000),
        "{fused}{header}"
    );
    let one = project(&set, 1);
    let output = ostra(&["reconstruct", &one.root(), "--method", "mvs"]);
    let why = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{why}");
    assert!(
        why.contains("no frame got depth: 0000.jpg has no depth: it shares too little"),
        "{why}"
    );
}

fn depth_is_scaled_with_the_scene_and_recomputed_for_changed_cameras() {
    let data = data_dir();
    let set = data.join("strecha_fountain_P11");
    let project = project(&set, 3);
    stereo(&project, 200);
    let median = |to: &str| {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join(to);
        project.done(&[
            "export",
            &project.root(),
            "--depths",
            path.to_str().unwrap(),
        ]);
        let file = std::fs::File::open(path.join("0001.tiff")).unwrap();
        let mut decoder = tiff::decoder::Decoder::new(std::io::BufReader::new(file)).unwrap();
        let tiff::decoder::DecodingResult::F32(mut depths) = decoder.read_image().unwrap() else {
            panic!()
        };
        depths.retain(|&depth| depth > 0.0);
        depths.sort_unstable_by(f32::total_cmp);
        f64::from(depths[depths.len() / 2])
    };
    let before = median("before");
    let ends = [
        "--from",
        "0,700,500",
        "--from",
        "1,650,500",
        "--to",
        "0,900,700",
        "--to",
        "1,850,700",
    ];
    project.done(&[&["scale", &project.root(), "--length", "10"][..], &ends].concat());
    let factor = median("scaled") / before;
    assert!((factor - 1.0).abs() > 0.1, "{factor}");
    let message = project.done(&["fuse", &project.root()]);
    assert!(!message.contains("warning"), "{message}");
    // Computed again with the scaled cameras, the depth is the same in the new unit.
    stereo(&project, 200);
    let again = median("again") / before;
    assert!((again / factor - 1.0).abs() < 0.01, "{again} {factor}");
    // With other cameras, the fusion of the existing depth is stale, and a warning says so.
    project.done(&["reconstruct", &project.root(), "--method", "sfm"]);
    let message = project.done(&["fuse", &project.root()]);
    assert!(
        message.contains("the depths were made with other cameras"),
        "{message}"
    );
    assert_eq!(project.info()["results"]["cloud"]["stale"], true);
}

crate::registry::tests! {
    Data(&["dtu_scan24"]) => dtu_with_ground_truth_cameras, live_preview_grows_during_stereo;
    Data(&["strecha_fountain_P11"]) =>
        fountain_with_ground_truth_cameras,
        stopped_run_resumes_and_gives_the_same_result,
        killed_run_resumes_and_gives_the_same_result,
        frames_without_depth_are_reported_and_the_rest_is_done,
        two_views_are_enough_and_one_is_not,
        depth_is_scaled_with_the_scene_and_recomputed_for_changed_cameras;
}
