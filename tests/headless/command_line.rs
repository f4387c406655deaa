//! Tests of the program as a process: the behaviour that scripts depend on.

use std::path::{Path, PathBuf};

use image::{GrayImage, ImageBuffer, Luma};
use ostra_cloud::ply::{SavedColors, read_ply, save_ply};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, read_palette_png};
use serde_json::Value;

use super::recording::Recording;
use crate::program::{contents, done, ostra, refused};

#[test]
fn complete_workflow_runs_on_the_command_line() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing", "--color", "#d02818"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    done(&["fuse", &project, "--voxel", "0.01"]);
    let cloud = recording.path("cloud.ply");
    let masks = recording.path("masks");
    done(&[
        "export",
        &project,
        "--cloud",
        &cloud,
        "--masks",
        &masks,
        "--cameras",
        &recording.path("out"),
        "--depths",
        &recording.path("depths"),
    ]);
    let shot = recording.path("shot.png");
    for model in ["cloud", "mesh", "voxels"] {
        done(&[
            "shot", &project, &shot, "--color", "labels", "--model", model,
        ]);
        let image = image::open(&shot).unwrap().to_rgb8();
        let of_thing = image
            .pixels()
            .filter(|pixel| pixel.0[0] > 90 && pixel.0[1] < 60)
            .count();
        assert!(
            of_thing > 500,
            "{model}: the thing is drawn in its colour, on {of_thing} pixels"
        );
    }

    let info: Value = serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
    let states: Vec<&str> = info["frames"]
        .as_array()
        .unwrap()
        .iter()
        .map(|frame| frame["mask"].as_str().unwrap())
        .collect();
    assert_eq!(states, ["tracked", "anchor", "tracked", "tracked"]);
    assert_eq!(info["labels"][0]["name"], "thing");
    assert_eq!(info["labels"][0]["color"], "#d02818");
    assert_eq!(info["results"]["cloud"]["stale"], false);

    let truth = recording.truth();
    let score: Value = serde_json::from_str(&done(&[
        "eval", "masks", "--truth", &truth, "--result", &masks, "--json",
    ]))
    .unwrap();
    assert!(score["j"].as_f64().unwrap() > 0.9, "{score}");

    let same = done(&[
        "eval", "cloud", "--truth", &cloud, "--result", &cloud, "--within", "0.001",
    ]);
    assert!(same.contains("thing"), "{same}");
    let cameras: Value = serde_json::from_str(&done(&[
        "eval",
        "cameras",
        "--truth",
        &recording.path("sparse"),
        "--result",
        &recording.path("out"),
        "--json",
    ]))
    .unwrap();
    assert_eq!(cameras["error"]["count"], 4);
    assert!(
        cameras["error"]["centre"]["max"].as_f64().unwrap() < 1e-9,
        "{cameras}"
    );
}

/// Returns the colours and labels of the project's cloud and of its mesh's vertices.
fn fused(project: &str) -> [(Vec<[u8; 3]>, Vec<LabelId>); 2] {
    let of = |file: &str| {
        read_ply(&Path::new(project).join(file), &Progress::default())
            .unwrap()
            .cloud
    };
    ["cloud.ply", "mesh.ply"]
        .map(of)
        .map(|cloud| (cloud.colors, cloud.labels))
}

#[test]
fn fusion_after_a_correction_only_votes_again_and_equals_a_full_fusion() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    done(&["fuse", &project, "--voxel", "0.01"]);
    let first = fused(&project);

    // A point's colour is computed from images only: if this change survives, no image was read.
    let versions = Path::new(&project).join("versions");
    let file = std::fs::read_dir(versions)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let file = file
        .into_iter()
        .find(|path| path.to_str().unwrap().contains("cloud-"))
        .unwrap();
    let mut marked = read_ply(&file, &Progress::default()).unwrap().cloud;
    marked.colors[7] = [1, 2, 3];
    save_ply(&file, &marked, SavedColors::Image, &Progress::default()).unwrap();

    for frame in ["0", "2", "3"] {
        done(&[
            "prompt", &project, "--frame", frame, "--label", "thing", "--click", "50,10",
        ]);
    }
    done(&["fuse", &project, "--voxel", "0.01"]);
    let voted = fused(&project);
    assert_eq!(voted[0].0[7], [1, 2, 3]);
    assert!(
        voted[0].1 != first[0].1 && voted[1].1 != first[1].1,
        "other masks, other labels"
    );

    // A depth file with a new time stamp may have new content, so all points are computed again.
    let depth = std::fs::File::options()
        .append(true)
        .open(recording.path("depth/2.png"))
        .unwrap();
    depth
        .set_modified(std::time::SystemTime::UNIX_EPOCH)
        .unwrap();
    done(&["fuse", &project, "--voxel", "0.01"]);
    let again = fused(&project);
    assert_eq!(again[0].0[7], first[0].0[7]);
    assert!(again[0].1 == voted[0].1 && again[1] == voted[1]);
    done(&["fuse", &project, "--voxel", "0.02"]);
    assert!(
        fused(&project)[0].1.len() < again[0].1.len(),
        "another voxel size, other points"
    );
}

#[test]
fn prompt_sets_only_given_fields_and_keyframes_are_not_overwritten() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    done(&[
        "prompt", &project, "--frame", "0", "--label", "thing", "--click", "20,24",
    ]);
    let keyframe = std::fs::read(Path::new(&project).join("masks/0.png")).unwrap();
    done(&[
        "prompt", &project, "--frame", "3", "--label", "thing", "--click", "16,24",
    ]);
    done(&["track", &project]);
    assert_eq!(
        std::fs::read(Path::new(&project).join("masks/0.png")).unwrap(),
        keyframe
    );
}

/// Returns the label ids of a frame's mask as stored in the project.
fn ids(project: &str, frame: u32) -> Vec<u8> {
    let mask = read_palette_png(&Path::new(project).join(format!("masks/{frame}.png"))).unwrap();
    mask.ids.iter().map(|id| id.0 as u8).collect()
}

#[test]
fn thin_structure_is_traced_through_at_least_two_points() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    let one = refused(&[
        "trace", &project, "--frame", "1", "--label", "thing", "--point", "19,16",
    ]);
    assert!(one.contains("two different points"), "{one}");
    let points = ["--point", "19,16", "--point", "19,32"];
    done(
        &[
            &["trace", &project, "--frame", "1", "--label", "thing"][..],
            &points,
        ]
        .concat(),
    );
    let traced = ids(&project, 1);
    let (inside, adjacent) = (traced[24 * 64 + 19], traced[24 * 64 + 40]);
    assert_eq!((inside, adjacent), (1, 0));
    let area = traced.iter().filter(|&&id| id == 1).count();
    assert!(
        (16 * 12..16 * 21).contains(&area),
        "{area} pixels of a bar 16 wide"
    );
    done(&["label", &project, "other"]);
    done(
        &[
            &["trace", &project, "--frame", "1", "--label", "other"][..],
            &points,
        ]
        .concat(),
    );
    assert_eq!(ids(&project, 1), traced, "another label's pixels stay");
    done(
        &[
            &[
                "trace",
                &project,
                "--frame",
                "1",
                "--label",
                "other",
                "--replace",
            ][..],
            &points,
        ]
        .concat(),
    );
    assert_eq!(ids(&project, 1)[24 * 64 + 19], 2);
    let info: Value = serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
    assert_eq!(info["frames"][1]["mask"], "anchor");
}

#[test]
fn holes_are_filled_and_islands_removed() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    let masks = recording.path("holey");
    std::fs::create_dir(&masks).unwrap();
    let hole = |x: u32, y: u32| (20..22).contains(&x) && (20..22).contains(&y);
    let island = |x: u32, y: u32| (50..53).contains(&x) && y == 5;
    let inside = |x: u32, y: u32| (12..28).contains(&x) && (14..34).contains(&y);
    GrayImage::from_fn(64, 48, |x, y| {
        Luma([u8::from((inside(x, y) && !hole(x, y)) || island(x, y))])
    })
    .save(format!("{masks}/1.png"))
    .unwrap();
    done(&["masks", &project, "import", &masks]);
    let area = || ids(&project, 1).iter().filter(|&&id| id == 1).count();
    let tidy = |options: &[&str]| {
        done(
            &[
                &["tidy", &project, "--frame", "1", "--label", "thing"][..],
                options,
            ]
            .concat(),
        )
    };
    assert!(tidy(&["--holes-below", "4", "--islands-below", "3"]).contains("no holes or islands"));
    assert_eq!(area(), 16 * 20 - 4 + 3);
    tidy(&["--holes-below", "5"]);
    assert_eq!(area(), 16 * 20 + 3);
    tidy(&["--islands-below", "1000"]);
    assert_eq!(area(), 16 * 20, "the largest piece stays");
    let elsewhere = refused(&[
        "tidy",
        &project,
        "--frame",
        "2",
        "--label",
        "thing",
        "--islands-below",
        "5",
    ]);
    assert!(
        elsewhere.contains("'thing' on frame 2") && elsewhere.contains("not on this frame"),
        "{elsewhere}"
    );
    assert_eq!(
        ostra(&["tidy", &project, "--frame", "1", "--label", "thing"])
            .status
            .code(),
        Some(2)
    );
}

/// Writes a mask file with `thing` (1) and `wall` (2) in the given columns of rows 14 to 33.
fn write_mask(folder: &str, frame: u32, thing: std::ops::Range<u32>, wall: std::ops::Range<u32>) {
    std::fs::create_dir_all(folder).unwrap();
    let mask = GrayImage::from_fn(64, 48, |x, y| match (14..34).contains(&y) {
        true if thing.contains(&x) => Luma([1]),
        true if wall.contains(&x) => Luma([2]),
        _ => Luma([0]),
    });
    mask.save(format!("{folder}/{frame}.png")).unwrap();
}

/// A project with masks of the labels `thing` (1) and `wall` (2).
struct TwoLabels {
    recording: Recording,
    project: String,
}

impl TwoLabels {
    fn new() -> Self {
        let recording = Recording::new();
        let project = recording.project();
        done(&["label", &project, "thing"]);
        done(&["label", &project, "wall"]);
        Self { recording, project }
    }

    /// Imports a mask as written by [`write_mask`].
    fn import(
        &self,
        name: &str,
        frame: u32,
        thing: std::ops::Range<u32>,
        wall: std::ops::Range<u32>,
    ) {
        let folder = self.recording.path(name);
        write_mask(&folder, frame, thing, wall);
        done(&["masks", &self.project, "import", &folder]);
    }

    fn file(&self, frame: u32) -> PathBuf {
        Path::new(&self.project).join(format!("masks/{frame}.png"))
    }

    /// Returns the mask file of each frame.
    fn bytes(&self) -> [Vec<u8>; 4] {
        [0, 1, 2, 3].map(|k| std::fs::read(self.file(k)).unwrap())
    }

    fn region(&self, frame: u32, label: u16) -> ostra_masks::Region {
        let mask = read_palette_png(&self.file(frame)).unwrap();
        mask.region(LabelId(label))
    }

    /// Returns how `ostra info` describes the mask of each frame.
    fn mask_states(&self) -> Vec<String> {
        let info: Value = serde_json::from_str(&done(&["info", &self.project, "--json"])).unwrap();
        info["frames"]
            .as_array()
            .unwrap()
            .iter()
            .map(|frame| frame["mask"].as_str().unwrap().to_owned())
            .collect()
    }
}

#[test]
fn one_label_is_tracked_again_and_the_others_stay() {
    let labels = TwoLabels::new();
    let project = &labels.project;
    labels.import("first", 1, 12..26, 36..56);
    done(&["track", project]);
    // The keyframe is corrected in both labels, and one of them is tracked again on one frame.
    labels.import("corrected", 1, 12..20, 36..42);
    let (before, walls) = (labels.bytes(), [0, 2, 3].map(|k| labels.region(k, 2)));
    done(&[
        "track", project, "--label", "thing", "--from", "2", "--to", "2",
    ]);
    let after = labels.bytes();
    assert_eq!(
        [0, 1, 3].map(|k: usize| after[k] == before[k]),
        [true; 3],
        "outside the range and on the keyframe"
    );
    assert_eq!(
        labels.mask_states(),
        ["stale", "anchor", "tracked", "stale"]
    );
    assert!(
        (100..=200).contains(&labels.region(2, 1).area()),
        "{}",
        labels.region(2, 1).area()
    );
    assert_eq!(labels.region(2, 2), walls[1]);
    let areas = [labels.region(0, 1).area(), walls[1].area()];
    assert!(
        areas[0] > 220 && areas[1] > 200,
        "the tracker would have made both smaller: {areas:?}"
    );

    // Around the keyframe: all frames.
    done(&["track", project, "--label", "thing", "--around", "1"]);
    assert_eq!([0, 2, 3].map(|k| labels.region(k, 2)), walls);
    assert!(
        [0, 2, 3]
            .iter()
            .all(|&k| (100..=200).contains(&labels.region(k, 1).area()))
    );
    assert_eq!(
        (labels.bytes()[1].clone(), labels.bytes()[2].clone()),
        (after[1].clone(), after[2].clone()),
        "the same answer"
    );

    // The thing takes pixels from the wall only on request.
    labels.import("over", 1, 12..48, 0..0);
    done(&["track", project, "--label", "thing", "--around", "1"]);
    assert_eq!([0, 2, 3].map(|k| labels.region(k, 2)), walls);
    done(&[
        "track",
        project,
        "--label",
        "thing",
        "--around",
        "1",
        "--replace",
    ]);
    assert!(
        [0, 2, 3]
            .iter()
            .all(|&k| labels.region(k, 2).area() <= walls[0].area() / 2
                && labels.region(k, 1).area() > 550)
    );
}

#[test]
fn one_label_is_tracked_only_from_a_keyframe_and_with_its_options() {
    let labels = TwoLabels::new();
    let project = &labels.project;
    labels.import("first", 1, 12..26, 36..56);
    done(&["track", project]);
    let before = contents(Path::new(project));
    assert!(refused(&["track", project, "--label", "sky"]).contains("'sky'"));
    assert!(
        refused(&["track", project, "--label", "thing", "--around", "2"])
            .contains("frame 2 is not a keyframe")
    );
    assert_eq!(
        ostra(&["track", project, "--around", "1", "--from", "0"])
            .status
            .code(),
        Some(2)
    );
    assert_eq!(
        ostra(&["track", project, "--replace"]).status.code(),
        Some(2)
    );
    assert_eq!(contents(Path::new(project)), before);
}

#[test]
fn simulated_user_counts_the_clicks_that_tracking_saves() {
    let recording = Recording::new();
    let (project, truth) = (recording.project(), recording.truth());
    let before = contents(Path::new(&project));
    let play = [
        "eval",
        "interact",
        "--frames",
        &project,
        "--truth",
        &truth,
        "--tracker",
        "geometry",
    ];
    let report: Value = serde_json::from_str(&done(&[&play[..], &["--json"]].concat())).unwrap();
    assert_eq!(
        (&report["tracker"], &report["segmenter"]),
        (&"geometry".into(), &"auto".into()),
        "on a recording the segmenter is chosen for each click"
    );
    assert_eq!(
        (&report["frames"], &report["labels"]),
        (&4.into(), &1.into())
    );
    assert!(report["mean_iou"].as_f64().unwrap() >= 0.9, "{report}");
    let clicks = report["reached"][1]["clicks"].as_u64().unwrap();
    assert!(
        (1..4).contains(&clicks) && report["frame_by_frame"]["clicks"].as_u64().unwrap() >= 4,
        "{report}"
    );
    assert!(done(&play).contains(&format!("clicks to mean IoU 0.90 {clicks:>8}")));
    assert!(
        done(&[&play[..], &["--jitter", "1.5", "--seed", "7"]].concat())
            .contains("on which the first tracking failed")
    );
    assert_eq!(
        ostra(&[&play[..], &["--jitter", "far"]].concat())
            .status
            .code(),
        Some(2)
    );
    assert_eq!(
        contents(Path::new(&project)),
        before,
        "the project is only read"
    );
    let color = recording.path("color");
    let refusal = refused(&[
        "eval",
        "interact",
        "--frames",
        &color,
        "--truth",
        &truth,
        "--tracker",
        "geometry",
    ]);
    assert!(refusal.contains("depth"), "{refusal}");
}

#[test]
fn missing_requirements_are_named_in_the_error() {
    let recording = Recording::new();
    let project = recording.project();
    assert!(refused(&["ground", &project, "--frame", "0", "--text", "thing"]).contains("network"));
    assert!(refused(&["models", "install", "xfeat"]).contains("ostra models add xfeat FILE"));
    assert!(refused(&["reconstruct", &project, "--method", "sfm"]).len() > 30);
    done(&["label", &project, "thing"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    assert!(refused(&["track", &project, "--tracker", "xmem"]).contains("xmem"));
    let message = refused(&[
        "track",
        &project,
        "--tracker",
        "flow",
        "--short-side",
        "480",
    ]);
    assert!(
        message.contains("'xmem' and 'deaot'") && message.contains("'flow'"),
        "{message}"
    );
    assert_eq!(ostra(&["prompt"]).status.code(), Some(2));
    assert_eq!(
        ostra(&["frobnicate"]).status.code(),
        Some(1),
        "a path that is not there cannot be opened"
    );
}

#[test]
fn score_refuses_options_without_effect() {
    let score = |of: &str, option: &[&str]| {
        refused(
            &[
                &["eval", of, "--truth", "truth", "--result", "result"],
                option,
            ]
            .concat(),
        )
    };
    assert!(score("cameras", &["--turns"]).contains("--align se3"));
    for of in ["masks", "cloud"] {
        assert!(
            score(of, &["--turns"]).contains("--turns has no effect"),
            "{of}"
        );
    }
    assert!(score("cameras", &["--skip-first"]).contains("--skip-first has no effect"));
    for of in ["masks", "cameras"] {
        assert!(
            score(of, &["--frames", "frames"]).contains("--frames has no effect"),
            "{of}"
        );
    }
    let cameras = [
        "--cameras",
        "sparse",
        "--min-views",
        "3",
        "--frames",
        "frames",
    ];
    assert!(score("cloud", &cameras).contains("--within"));
    assert!(score("cloud", &["--within", "1", "--frames", "frames"]).contains("--cameras"));
}

#[test]
fn broken_input_gives_one_error_line_and_changes_nothing() {
    let recording = Recording::new();
    let [color, depth, sparse] = ["color", "depth", "sparse"].map(|name| recording.path(name));
    let project = recording.path("broken");
    let new = |extra: &[&str]| refused(&[&["new", &project, "--frames", &color], extra].concat());

    let empty = recording.path("empty");
    std::fs::create_dir(&empty).unwrap();
    assert!(refused(&["new", &project, "--frames", &empty]).contains("empty"));

    let nan = recording.path("nan");
    std::fs::create_dir(&nan).unwrap();
    std::fs::copy(
        format!("{sparse}/cameras.txt"),
        format!("{nan}/cameras.txt"),
    )
    .unwrap();
    std::fs::write(format!("{nan}/points3D.txt"), "").unwrap();
    std::fs::write(format!("{nan}/images.txt"), "1 nan 0 0 0 0 0 0 1 0.png\n\n").unwrap();
    assert!(
        new(&["--cameras", &nan])
            .contains("0.png: the pose has a value that is not a finite number")
    );
    std::fs::write(
        format!("{nan}/images.txt"),
        "1 1 0 0 0 0 0 0 1 other.png\n\n",
    )
    .unwrap();
    assert!(
        new(&["--cameras", &nan]).contains("other"),
        "names that match no frame are reported"
    );

    let small = recording.path("small");
    std::fs::create_dir(&small).unwrap();
    let tiny: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::new(32, 24);
    tiny.save(format!("{small}/0.png")).unwrap();
    let error = new(&["--depth", &small]);
    assert!(error.contains("32") && error.contains("64"), "{error}");

    let whole = std::fs::read(format!("{color}/2.png")).unwrap();
    std::fs::write(format!("{color}/2.png"), &whole[..whole.len() / 2]).unwrap();
    assert!(!Path::new(&project).exists(), "nothing was made");
    let output = ostra(&["new", &project, "--frames", &color, "--depth", &depth]);
    let warning = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.success() && warning.contains("1 of 4 images") && warning.contains("2.png"),
        "{warning}"
    );
}

#[test]
fn refused_command_leaves_the_project_unchanged() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    done(&["info", &project]);
    let before = contents(Path::new(&project));

    let wrong = recording.path("wrong");
    std::fs::create_dir(&wrong).unwrap();
    GrayImage::new(10, 10)
        .save(format!("{wrong}/0.png"))
        .unwrap();
    let error = refused(&["masks", &project, "import", &wrong]);
    assert!(error.contains("10") && error.contains("64"), "{error}");
    assert!(refused(&["label", &project, "thing"]).contains("thing"));
    assert!(
        refused(&[
            "prompt", &project, "--frame", "99", "--label", "thing", "--click", "1,1"
        ])
        .contains("99")
    );
    assert!(
        refused(&[
            "prompt", &project, "--frame", "0", "--label", "nothing", "--click", "1,1"
        ])
        .contains("nothing")
    );
    assert!(refused(&["fuse", &project, "--onto", "/nowhere.ply"]).contains("nowhere.ply"));
    assert!(refused(&["export", &project, "--cloud", &recording.path("c.ply")]).contains("fuse"));
    assert_eq!(contents(Path::new(&project)), before);

    let toml = Path::new(&project).join("project.toml");
    let newer = std::fs::read_to_string(&toml)
        .unwrap()
        .replacen("format = 1", "format = 2", 1);
    std::fs::write(&toml, &newer).unwrap();
    assert!(refused(&["info", &project]).contains('2'));
    assert_eq!(std::fs::read_to_string(&toml).unwrap(), newer);
}

#[test]
fn recipe_makes_an_equal_project() {
    let recording = Recording::new();
    let by_hand = recording.project();
    done(&["label", &by_hand, "thing"]);
    done(&[
        "prompt", &by_hand, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &by_hand, "--tracker", "geometry"]);
    let by_recipe = recording.path("by_recipe");
    let recipe = serde_json::json!({ "format": 1, "commands": [
        { "new": { "root": by_recipe, "open": {
            "sources": [{ "frames": recording.path("color"), "depth": recording.path("depth") }], "depth_unit": 0.001, "every": 1 },
            "cameras": recording.path("sparse") } },
        { "add_label": { "name": "thing", "parent": null, "color": null } },
        { "prompt": { "frame": 1, "label": 1, "prompt": { "clicks": [{ "at_px": [20.0, 24.0], "include": true }] }, "segmenter": "auto" } },
        { "track": { "tracker": "geometry" } },
    ] });
    let path = recording.path("recipe.json");
    std::fs::write(&path, recipe.to_string()).unwrap();
    done(&["run", &path]);
    for k in 0..4 {
        let mask = |project: &str| {
            std::fs::read(Path::new(project).join(format!("masks/{k}.png"))).unwrap()
        };
        assert_eq!(mask(&by_hand), mask(&by_recipe), "frame {k}");
    }
    let info = |project: &str| -> Value {
        let mut info: Value = serde_json::from_str(&done(&["info", project, "--json"])).unwrap();
        info["results"]["tracking"]["seconds"] = Value::Null;
        info
    };
    assert_eq!(info(&by_hand), info(&by_recipe));
    // The steps of the four calls are kept as one recipe, too.
    let again = recording.path("again");
    let kept = std::fs::read_to_string(Path::new(&by_hand).join("recipe.jsonl")).unwrap();
    let mut commands: Vec<Value> = kept
        .lines()
        .filter(|line| !line.is_empty())
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    commands[0]["new"]["root"] = again.clone().into();
    std::fs::write(
        &path,
        serde_json::json!({ "format": 1, "commands": commands }).to_string(),
    )
    .unwrap();
    done(&["run", &path]);
    assert_eq!(info(&by_hand), info(&again));
}

#[test]
fn earlier_command_names_are_hidden_aliases() {
    let help = done(&["--help"]);
    for (earlier, now) in [
        ("doubt", "conflicts"),
        ("adopt", "attach"),
        ("tidy", "clean"),
    ] {
        assert_eq!(done(&[earlier, "--help"]), done(&[now, "--help"]));
        let lists = |name: &str| help.lines().any(|line| line.trim().starts_with(name));
        assert!(lists(now) && !lists(earlier), "{help}");
    }
}
