//! Tests that a repeated or stopped reconstruction reuses its features, matches and cameras.

use std::ffi::OsStr;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};

use image::{GrayImage, Luma};
use ostra_core::job::Progress;
use ostra_frames::{FrameStore, OpenRequest, open};
use ostra_project::{ReconstructMethod, ReconstructRequest};
use ostra_reconstruct::sfm::matching::NearestMatcher;
use ostra_reconstruct::sfm::{
    CachedExtractor, CachedMatcher, FeatureCache, FeatureError, FeatureMatcher, Features,
    MapperOptions, PairMatches, PairOptions, SfmError, SfmRequest, SfmResult, Sift,
    structure_from_motion,
};
use ostra_session::Event;
use ostra_session::{Command, Session};
use serde_json::Value;

use super::scale::{HEIGHT, Photos, WIDTH, done_with_both};
use crate::program::{contents, done};
use crate::session::perform;

/// Returns the files of the project's sparse model, without the status of each frame.
fn model(project: &str) -> Vec<(PathBuf, Vec<u8>)> {
    contents(&Path::new(project).join("sparse"))
}

#[test]
fn repeated_reconstruction_reuses_features_and_gives_the_same_bytes() {
    let photos = Photos::new(5);
    let [once, twice] = ["once", "twice"].map(|name| photos.project(name, &[]));
    let sfm = |project: &str| {
        done_with_both(&["reconstruct", project, "--method", "sfm"].map(str::to_owned))
    };
    let first = sfm(&once);
    assert!(!first.contains("earlier run"), "{first}");
    let again = sfm(&once);
    assert!(
        again.contains("features of 5 of 5 images and matches of 10 of 10 pairs were there"),
        "{again}"
    );
    sfm(&twice);
    let bytes = |project: &str| {
        model(project)
            .into_iter()
            .map(|(_, bytes)| bytes)
            .collect::<Vec<_>>()
    };
    let kept = bytes(&once);
    assert!(kept == bytes(&twice), "with what was kept as without");
    std::fs::remove_dir_all(Path::new(&once).join("cache")).unwrap();
    assert!(!sfm(&once).contains("earlier run"));
    assert!(bytes(&once) == kept);
    // A changed image is extracted again, and so are all its matches.
    let mut image = image::open(photos.path("color/4.png"))
        .unwrap()
        .into_luma8();
    image.put_pixel(9, 9, Luma([255 - image.get_pixel(9, 9).0[0]]));
    image.save(photos.path("color/4.png")).unwrap();
    let changed = sfm(&twice);
    assert!(changed.contains("features of 4 of "), "{changed}");
}

#[test]
fn stopped_reconstruction_resumes_with_its_features() {
    let photos = Photos::new(5);
    let project = photos.project("project", &[]);
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.into())).unwrap();
    let request = ReconstructRequest {
        method: ReconstructMethod::Sfm,
        ..ReconstructRequest::default()
    };
    let run = |session: &mut Session, stop_at: Option<&str>| {
        session.act(Command::Reconstruct(request.clone())).unwrap();
        session.settle(|jobs| {
            let reached = jobs
                .iter()
                .any(|job| Some(job.report.stage.as_str()) == stop_at);
            if reached {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        })
    };
    let notices = |events: &[Event]| {
        let notices = events.iter().filter_map(|event| match event {
            Event::Notice(text) => Some(text.clone()),
            _ => None,
        });
        notices.collect::<Vec<_>>().join("\n")
    };
    let stopped = run(&mut session, Some("match"));
    let ended = stopped
        .iter()
        .any(|event| matches!(event, Event::Stopped { .. } | Event::Finished { .. }));
    assert!(ended, "{stopped:?}");
    let finished = run(&mut session, None);
    assert!(
        finished
            .iter()
            .any(|event| matches!(event, Event::Finished { .. })),
        "{finished:?}"
    );
    assert!(
        notices(&finished).contains("features of 5 of 5 images"),
        "{finished:?}"
    );
}

/// Starts a reconstruction in another process and kills it once it has the features of so many
/// images, when it matches them.
///
/// Returns `false` if it ended before.
fn kill_while_matching(project: &str, images: usize) -> bool {
    let mut child = Process::new(env!("CARGO_BIN_EXE_ostra"))
        .args(["reconstruct", project, "--method", "sfm"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let cache = Path::new(project).join("cache");
    let is_of_image = |name: &OsStr| name.to_string_lossy().starts_with("features-");
    let count = || {
        std::fs::read_dir(&cache).map_or(0, |files| {
            let names = files.flatten().map(|file| file.file_name());
            names.filter(|name| is_of_image(name)).count()
        })
    };
    let mut has_ended = false;
    while !has_ended && count() < images {
        has_ended = child.try_wait().unwrap().is_some();
        std::thread::yield_now();
    }
    child.kill().unwrap();
    !child.wait().unwrap().success()
}

#[test]
fn reconstruction_killed_while_matching_is_repeated_with_the_same_bytes() {
    let photos = Photos::new(10);
    let sfm = |project: &str| {
        done_with_both(&["reconstruct", project, "--method", "sfm"].map(str::to_owned))
    };
    let killed = (0..5)
        .map(|attempt| photos.project(&format!("killed{attempt}"), &[]))
        .find(|project| kill_while_matching(project, 10))
        .expect("it ended before it could be killed");
    let whole = photos.project("whole", &[]);
    let again = sfm(&killed);
    assert!(again.contains("features of 10 of 10 images"), "{again}");
    sfm(&whole);
    let files = |project: &str| {
        let files = model(project).into_iter();
        files
            .map(|(path, bytes)| (path.file_name().unwrap().to_owned(), bytes))
            .collect::<Vec<_>>()
    };
    let repeated = files(&killed);
    assert!(!repeated.is_empty());
    assert!(repeated == files(&whole), "as without the kill");
}

/// Matches nearest descriptors, and stops the run after a number of pairs.
struct StoppingMatcher {
    matcher: NearestMatcher,
    progress: Progress,
    pairs: AtomicUsize,
    stop_after: usize,
}

impl FeatureMatcher for StoppingMatcher {
    fn name(&self) -> &'static str {
        self.matcher.name()
    }

    fn shared_images(&self, images: &[&Features]) -> Vec<usize> {
        self.matcher.shared_images(images)
    }

    fn matches(
        &self,
        first: &Features,
        second: &Features,
    ) -> Result<Vec<(u32, u32)>, FeatureError> {
        self.matcher.matches(first, second)
    }

    fn of_set<'a>(&'a self, images: &'a [&'a Features]) -> Result<PairMatches<'a>, FeatureError> {
        let matches = self.matcher.of_set(images)?;
        Ok(Box::new(move |first, second| {
            if self.pairs.fetch_add(1, Ordering::Relaxed) + 1 == self.stop_after {
                self.progress.stop();
            }
            matches(first, second)
        }))
    }
}

/// Runs structure from motion on the images of a folder with a cache, and counts the pairs that are matched.
fn run_with(
    photos: &Path,
    cache: &Path,
    pairs: PairOptions,
    stop_after: usize,
    store: &FrameStore,
) -> (Result<SfmResult, SfmError>, usize) {
    let request = OpenRequest {
        sources: vec![photos.to_path_buf().into()],
        ..OpenRequest::default()
    };
    let progress = Progress::default();
    let frames = open(&request, &progress).unwrap().frames;
    let cache = FeatureCache::open(cache.to_path_buf(), 1 << 30);
    let sift = Sift::default();
    let extractor = CachedExtractor {
        extractor: &sift,
        identity: "sift",
        cache: &cache,
    };
    let stopping = StoppingMatcher {
        matcher: NearestMatcher::for_bytes(),
        progress: progress.clone(),
        pairs: AtomicUsize::new(0),
        stop_after,
    };
    let matcher = CachedMatcher {
        matcher: &stopping,
        identity: "nearest",
        cache: &cache,
    };
    let mapped: Vec<usize> = (0..frames.len()).collect();
    let request = SfmRequest {
        frames: &frames,
        mapped: &mapped,
        located: &[],
        keep_poses: false,
        allowed: &|_| None,
        extractor: &extractor,
        cached: Some(&extractor),
        matcher: &matcher,
        pairs,
        mapper: MapperOptions::default(),
    };
    let result = structure_from_motion(&request, store, &progress);
    (result, stopping.pairs.load(Ordering::Relaxed))
}

/// Checks that a run that was stopped while matching does the rest when it is repeated, with the same result.
///
/// `matched` says whether a number of pairs is the expected one.
fn check_stopped_run(photos: &Photos, pairs: &PairOptions, matched: impl Fn(usize) -> bool) {
    let (images, scratch) = (photos.path("color"), photos.path("caches"));
    std::fs::create_dir(&scratch).unwrap();
    let [of_whole, of_stopped] = ["whole", "stopped"].map(|name| Path::new(&scratch).join(name));
    let store = FrameStore::new(16 << 20);
    let run = |cache: &Path, stop_after| {
        run_with(Path::new(&images), cache, pairs.clone(), stop_after, &store)
    };
    let (whole, all) = run(&of_whole, 0);
    let whole = whole.unwrap();
    assert!(matched(all), "{all}");
    let (stopped, before) = run(&of_stopped, all / 4);
    assert!(matches!(stopped, Err(SfmError::Stopped(_))), "{stopped:?}");
    assert!(
        (all / 4..all).contains(&before),
        "{before} pairs before the stop"
    );
    let (resumed, rest) = run(&of_stopped, 0);
    let resumed = resumed.unwrap();
    assert_eq!(rest, all - before, "only the rest is matched");
    assert_eq!(resumed.cameras, whole.cameras);
    assert_eq!(resumed.sparse, whole.sparse);
    assert_eq!(resumed.outcomes, whole.outcomes);
    assert_eq!(run(&of_stopped, 0).1, 0, "nothing is matched twice");
}

#[test]
fn run_stopped_in_the_middle_of_matching_ends_with_the_same_result() {
    let all_pairs = |matched| matched == 21;
    check_stopped_run(&Photos::new(7), &PairOptions::default(), all_pairs);
}

#[test]
fn run_stopped_between_rounds_of_matching_ends_with_the_same_result() {
    let chosen = PairOptions {
        exhaustive_up_to: 0,
        window: 1,
        alike: 1,
        partners: 4,
        ..PairOptions::default()
    };
    let first_round = 9 + 1;
    let some_pairs = |matched| matched > first_round;
    check_stopped_run(&Photos::new(10), &chosen, some_pairs);
}

#[test]
fn images_that_do_not_fit_the_memory_together_are_not_kept() {
    let photos = Photos::new(7);
    let images = photos.path("color");
    let of_one = (WIDTH * HEIGHT * 3) as usize;
    let kept_of = |budget: usize| {
        let (store, cache) = (FrameStore::new(budget), photos.path(&budget.to_string()));
        let (images, cache) = (Path::new(&images), Path::new(&cache));
        let (result, _) = run_with(images, cache, PairOptions::default(), 0, &store);
        result.unwrap();
        store.bytes_kept()
    };
    assert_eq!([kept_of(7 * of_one), kept_of(6 * of_one)], [7 * of_one, 0]);
}

#[test]
fn photos_in_a_sequence_need_a_part_of_all_pairs() {
    let photos = Photos::new(25);
    let project = photos.project("project", &[]);
    let sfm = || done_with_both(&["reconstruct", &project, "--method", "sfm"].map(str::to_owned));
    let first = sfm();
    assert!(first.contains("25 of 25 frames"), "{first}");
    let again = sfm();
    let (_, kept) = again.split_once("images and matches of ").unwrap();
    let pairs: usize = kept.split(' ').next().unwrap().parse().unwrap();
    assert!((25 * 4..25 * 24 / 2 * 2 / 3).contains(&pairs), "{again}");
    assert!(
        again.contains(&format!("matches of {pairs} of {pairs} pairs")),
        "{again}"
    );
}

#[test]
fn added_frames_are_matched_and_the_others_are_not_again() {
    let photos = Photos::new(10);
    let [first, more] = ["first", "more"].map(|name| photos.path(name));
    for (folder, numbers) in [(&first, 0..9), (&more, 9..10)] {
        std::fs::create_dir(folder).unwrap();
        for k in numbers {
            let name = format!("{k}.png");
            let from = photos.path(&format!("color/{name}"));
            std::fs::copy(from, Path::new(folder).join(name)).unwrap();
        }
    }
    let project = photos.path("project");
    done(&["new", &project, "--frames", &first]);
    let sfm = || done_with_both(&["reconstruct", &project, "--method", "sfm"].map(str::to_owned));
    sfm();
    done(&["add", &project, "--frames", &more]);
    let output = sfm();
    let expected = "features of 9 of 10 images and matches of 36 of 45 pairs were there";
    assert!(output.contains(expected), "{output}");
}

#[test]
fn damaged_cache_is_computed_again_with_a_warning() {
    let photos = Photos::new(5);
    let project = photos.project("project", &[]);
    let sfm = || done_with_both(&["reconstruct", &project, "--method", "sfm"].map(str::to_owned));
    assert!(!sfm().contains("damaged"));
    let before: Vec<Vec<u8>> = model(&project)
        .into_iter()
        .map(|(_, bytes)| bytes)
        .collect();
    for kind in ["features-", "matches-", "verified-"] {
        let cache = contents(&Path::new(&project).join("cache"));
        let is_of_kind = |path: &Path| {
            path.file_name()
                .unwrap()
                .to_string_lossy()
                .starts_with(kind)
        };
        let (path, mut bytes) = cache
            .into_iter()
            .find(|(path, _)| is_of_kind(path))
            .unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        std::fs::write(path, bytes).unwrap();
        let output = sfm();
        assert!(
            output.contains("1 damaged file was not used"),
            "{kind}: {output}"
        );
        let after: Vec<Vec<u8>> = model(&project)
            .into_iter()
            .map(|(_, bytes)| bytes)
            .collect();
        assert!(after == before, "{kind}");
        assert!(!sfm().contains("damaged"), "{kind}: once");
    }
}

#[test]
fn cache_is_shown_limited_and_removed() {
    let photos = Photos::new(4);
    let project = photos.project("project", &[]);
    let cache = Path::new(&project).join("cache");
    let bytes = || {
        let info: Value = serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
        info["cache_bytes"].as_u64().unwrap()
    };
    let sfm = |more: &[&str]| {
        let words = [&["reconstruct", &project, "--method", "sfm"][..], more].concat();
        done_with_both(&words.into_iter().map(str::to_owned).collect::<Vec<_>>())
    };
    sfm(&["--cache-limit", "0"]);
    assert!(!cache.exists());
    assert_eq!(bytes(), 0);
    assert!(!done(&["info", &project]).contains("cache"));
    sfm(&[]);
    let on_disk: usize = contents(&cache).iter().map(|(_, bytes)| bytes.len()).sum();
    assert_eq!(bytes(), on_disk as u64);
    assert!(done(&["info", &project]).contains("cache of features and matches: "));
    let cameras = model(&project);
    assert!(done(&["clean-cache", &project]).contains("removed "));
    assert!(!cache.exists());
    assert_eq!(model(&project), cameras, "results stay");
    assert!(!sfm(&[]).contains("earlier run"));
}

#[test]
fn stereo_after_cameras_extracts_and_matches_nothing() {
    let photos = Photos::new(5);
    let project = photos.project("project", &[]);
    // Frames 1 and 3 are placed in the model of the others.
    for more in [&["sfm", "--every", "2"][..], &["mvs", "--max-side", "96"]] {
        let command = ["reconstruct", &project, "--device", "cpu", "--method"];
        done(&[&command[..], more].concat());
        // What is extracted is kept, so it would be there again.
        let cache = Path::new(&project).join("cache");
        assert_eq!(cache.exists(), more[0] == "sfm", "{more:?}");
        done(&["clean-cache", &project]);
    }
    let depths = contents(&Path::new(&project).join("depths"));
    assert_eq!(depths.len(), 5);
}

#[test]
fn stereo_uses_existing_cameras_although_images_are_unregistered() {
    let photos = Photos::new(5);
    // Two images show nothing of the carpet.
    for k in [5_u32, 6] {
        GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
            Luma([((x / 9 + k * y / 7) * 31) as u8])
        })
        .save(photos.path(&format!("color/{k}.png")))
        .unwrap();
    }
    let project = photos.project("project", &[]);
    let reconstruct = |more: &[&str]| {
        let words = [
            &["reconstruct", &project, "--device", "cpu", "--method"][..],
            more,
        ]
        .concat();
        done_with_both(&words.into_iter().map(str::to_owned).collect::<Vec<_>>())
    };
    let found = reconstruct(&["sfm"]);
    assert!(found.contains("5.png has no camera"), "{found}");
    let cameras = model(&project);
    done(&["clean-cache", &project]);
    let message = reconstruct(&["mvs", "--max-side", "96"]);
    assert!(
        !message.contains("cameras:")
            && message.contains("2 frames have no camera and get no depth: 5.png, 6.png"),
        "{message}"
    );
    assert_eq!(model(&project), cameras, "the cameras stay as they are");
    assert!(
        !Path::new(&project).join("cache").exists(),
        "nothing was extracted, as it would be kept"
    );
}
