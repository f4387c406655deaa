//! Tests that exports never replace sources and that other programs can read them.

use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use super::recording::Recording;
use crate::program::{contents, done, ostra, refused};

/// Returns a project with masks and a cloud; its label has a non-ASCII name.
fn fused(recording: &Recording) -> String {
    let project = recording.project();
    done(&["label", &project, "Stängel 名前"]);
    done(&[
        "prompt",
        &project,
        "--frame",
        "1",
        "--label",
        "Stängel 名前",
        "--click",
        "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    done(&["fuse", &project, "--voxel", "0.02"]);
    project
}

#[test]
fn exports_over_sources_and_into_projects_are_refused() {
    let recording = Recording::new();
    let project = fused(&recording);
    let before = contents(Path::new(&recording.path("")));
    let [color, depth, sparse, whole] =
        ["color", "depth", "sparse", ""].map(|name| recording.path(name));
    let inside = |name: &str| format!("{project}/{name}");
    let image = format!("{color}/0.png");
    let attempts: &[&[&str]] = &[
        &["masks", &project, "export", &color],
        &["masks", &project, "export", &whole],
        &["masks", &project, "export", &inside("masks")],
        &["masks", &project, "export", &inside("new")],
        &["export", &project, "--undistorted", &whole],
        &["export", &project, "--cameras", &sparse],
        &["export", &project, "--cameras", &sparse, "--binary"],
        &["export", &project, "--depths", &depth],
        &["export", &project, "--traits", &inside("project.toml")],
        &["export", &project, "--traits", &image],
        &["export", &project, "--cloud", &inside("cloud.ply")],
        &["export", &project, "--mesh", &inside("versions/m.ply")],
        &["shot", &project, &image],
        &["shot", &project, &inside("shot.png")],
    ];
    for attempt in attempts {
        for more in [&[][..], &["--overwrite"]] {
            let error = refused(&[attempt, more].concat());
            assert!(
                error.contains("choose") || error.contains("known export"),
                "{attempt:?}: {error}"
            );
        }
    }
    assert_eq!(
        contents(Path::new(&whole)),
        before,
        "nothing was changed or added"
    );
}

#[cfg(unix)]
#[test]
fn exports_through_links_and_hard_links_to_sources_are_refused() {
    let recording = Recording::new();
    let project = fused(&recording);
    let out = recording.path("out");
    std::fs::create_dir(&out).unwrap();
    let image = recording.path("color/0.png");
    let before = std::fs::read(&image).unwrap();
    std::os::unix::fs::symlink(recording.path("color"), format!("{out}/masks")).unwrap();
    std::os::unix::fs::symlink(&image, format!("{out}/s.png")).unwrap();
    std::fs::hard_link(&image, format!("{out}/t.csv")).unwrap();
    std::os::unix::fs::symlink(&project, format!("{out}/p")).unwrap();
    refused(&[
        "masks",
        &project,
        "export",
        &format!("{out}/masks"),
        "--overwrite",
    ]);
    refused(&["shot", &project, &format!("{out}/s.png"), "--overwrite"]);
    refused(&[
        "export",
        &project,
        "--traits",
        &format!("{out}/t.csv"),
        "--overwrite",
    ]);
    refused(&[
        "export",
        &project,
        "--cloud",
        &format!("{out}/p/cloud.ply"),
        "--overwrite",
    ]);
    assert_eq!(std::fs::read(&image).unwrap(), before);
}

#[test]
fn earlier_exports_are_replaced_and_edited_ones_are_kept() {
    let recording = Recording::new();
    let project = fused(&recording);
    let [csv, masks, other] =
        ["out/t.csv", "out/masks", "out/other.csv"].map(|name| recording.path(name));
    let traits = || done(&["export", &project, "--traits", &csv]);
    traits();
    traits();
    done(&["masks", &project, "export", &masks]);
    done(&["masks", &project, "export", &masks]);
    let edited = format!("{}remark\n", std::fs::read_to_string(&csv).unwrap());
    std::fs::write(&csv, &edited).unwrap();
    assert!(refused(&["export", &project, "--traits", &csv]).contains("--overwrite"));
    assert_eq!(std::fs::read_to_string(&csv).unwrap(), edited);
    done(&["export", &project, "--traits", &csv, "--overwrite"]);
    for _ in 0..2 {
        let mut run = Command::new(env!("CARGO_BIN_EXE_ostra"));
        let output = run
            .current_dir(recording.path("out"))
            .args(["export", &project, "--traits", "here.csv"])
            .output();
        assert!(
            output.unwrap().status.success(),
            "a name without a folder is known again"
        );
    }
    std::fs::write(&other, "mine").unwrap();
    refused(&["export", &project, "--traits", &other, "--overwrite"]);
    assert_eq!(std::fs::read_to_string(&other).unwrap(), "mine");
    std::fs::write(format!("{masks}/mine.png"), "mine").unwrap();
    assert!(refused(&["masks", &project, "export", &masks]).contains("mine.png"));
}

#[test]
fn outputs_of_one_export_never_share_a_file() {
    let recording = Recording::new();
    let project = fused(&recording);
    let [ply, masks] = ["out/c.ply", "out/masks"].map(|name| recording.path(name));
    refused(&["export", &project, "--cloud", &ply, "--mesh", &ply]);
    refused(&["export", &project, "--masks", &masks, "--depths", &masks]);
    assert!(!Path::new(&ply).exists());
}

#[test]
fn demo_keeps_foreign_files_and_edits_in_its_project() {
    let recording = Recording::new();
    let out = recording.path("demo");
    for file in [
        "recording/day1.bag",
        "truth/measured.csv",
        "project/thesis.tex",
    ] {
        let path = Path::new(&out).join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, file).unwrap();
    }
    let demo = |out: &str| {
        [
            "demo",
            out,
            "--headless",
            "--frames",
            "6",
            "--size",
            "96x128",
        ]
        .map(str::to_owned)
    };
    let run = |args: [String; 7]| {
        args.iter()
            .map(String::as_str)
            .collect::<Vec<_>>()
            .join("\n")
    };
    let args = run(demo(&out));
    refused(&args.split('\n').collect::<Vec<_>>());
    assert_eq!(contents(Path::new(&out)).len(), 3);

    let fresh = recording.path("fresh");
    let args = run(demo(&fresh));
    let args: Vec<&str> = args.split('\n').collect();
    done(&args);
    done(&["label", &format!("{fresh}/project"), "mine"]);
    assert!(refused(&args).contains("changed"));
    assert!(done(&["info", &format!("{fresh}/project")]).contains("mine"));
}

#[test]
fn names_with_spaces_survive_colmap_text() {
    let recording = Recording::new();
    let spaced = recording.path("spaced");
    std::fs::create_dir(&spaced).unwrap();
    for k in 0..3 {
        std::fs::copy(
            recording.path(&format!("color/{k}.png")),
            format!("{spaced}/DJI 2024 {k}.png"),
        )
        .unwrap();
    }
    std::fs::copy(
        recording.path("color/3.png"),
        format!("{spaced}/DJI_2024_2.png"),
    )
    .unwrap();
    let images = std::fs::read_to_string(recording.path("sparse/images.txt")).unwrap();
    let images = images.replace("3.png", "DJI_2024_2.png");
    let images = (0..3).fold(images, |text, k| {
        text.replace(&format!(" {k}.png"), &format!(" DJI 2024 {k}.png"))
    });
    std::fs::write(recording.path("sparse/images.txt"), images).unwrap();
    let project = recording.path("p");
    done(&[
        "new",
        &project,
        "--frames",
        &spaced,
        "--cameras",
        &recording.path("sparse"),
    ]);
    let [text, binary] = ["text", "binary"].map(|name| recording.path(name));
    let mut run = Command::new(env!("CARGO_BIN_EXE_ostra"));
    let output = run
        .args(["export", &project, "--cameras", &text])
        .output()
        .unwrap();
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.success() && warning.contains("--binary"),
        "{warning}"
    );
    let written = std::fs::read_to_string(format!("{text}/images.txt")).unwrap();
    let names: Vec<&str> = written
        .lines()
        .filter(|line| line.ends_with(".png"))
        .map(|line| line.rsplit(' ').next().unwrap())
        .collect();
    assert_eq!(names.len(), 4);
    assert_eq!(
        names
            .iter()
            .collect::<std::collections::BTreeSet<_>>()
            .len(),
        4,
        "{names:?}"
    );
    assert!(
        written
            .lines()
            .filter(|line| line.ends_with(".png"))
            .all(|line| line.split(' ').count() == 10)
    );
    done(&["export", &project, "--cameras", &binary, "--binary"]);
    let bytes = std::fs::read(format!("{binary}/images.bin")).unwrap();
    assert!(bytes.windows(15).any(|name| name == b"DJI 2024 0.png\0"));
}

#[test]
fn untrusted_names_cannot_control_terminals_or_spreadsheets() {
    let recording = Recording::new();
    let project = fused(&recording);
    let toml = format!("{project}/project.toml");
    let text = std::fs::read_to_string(&toml).unwrap();
    let hostile = text.replacen("Stängel 名前", "rice\\u001b]0;OWNED\\u0007\\u202e", 1);
    assert_ne!(text, hostile);
    std::fs::write(&toml, hostile).unwrap();
    for args in [&["info", &project][..], &["info", &project, "--json"]] {
        let out = done(args);
        assert!(!out.contains(['\u{1b}', '\u{7}', '\u{202e}']), "{out:?}");
        assert!(out.contains("OWNED"));
    }
    let strange = text.replacen("color/0.png", "color/0\\u001b]0;OWNED\\u0007.png", 1);
    std::fs::write(&toml, strange).unwrap();
    let warning = String::from_utf8(ostra(&["info", &project]).stderr).unwrap();
    assert!(
        warning.contains("OWNED") && !warning.contains(['\u{1b}', '\u{7}']),
        "{warning:?}"
    );
    std::fs::write(&toml, text).unwrap();
    done(&["label", &project, "=HYPERLINK(\"http://x\",\"y\")"]);
    done(&[
        "prompt",
        &project,
        "--frame",
        "1",
        "--label",
        "=HYPERLINK(\"http://x\",\"y\")",
        "--click",
        "50,40",
    ]);
    done(&["fuse", &project, "--voxel", "0.02"]);
    let csv = recording.path("t.csv");
    done(&["export", &project, "--traits", &csv]);
    let table = std::fs::read_to_string(&csv).unwrap();
    assert!(
        table.contains("\"'=HYPERLINK") && !table.contains("\n=") && !table.contains("\n\"="),
        "{table}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn output_that_cannot_be_written_is_an_error() {
    let recording = Recording::new();
    let project = fused(&recording);
    for args in [
        &["info", &project][..],
        &["info", &project, "--json"],
        &["doubt", &project, "--json"],
    ] {
        let full = std::fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .unwrap();
        let mut run = Command::new(env!("CARGO_BIN_EXE_ostra"));
        let output = run
            .args(args)
            .stdout(full)
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{args:?}: {text}");
        assert!(text.contains("standard output"), "{text}");
    }
    // Progress and warnings are optional output: the work is done without them.
    std::fs::write(recording.path("color/1.png"), "").unwrap();
    let full = std::fs::OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let status = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(["fuse", &project])
        .stderr(full)
        .status()
        .unwrap();
    assert!(status.success(), "{status:?}");
}

#[test]
fn export_of_a_removed_label_replaces_no_foreign_file() {
    let recording = Recording::new();
    let project = fused(&recording);
    let session = |command: Value| {
        let recipe = recording.path("recipe.json");
        let text = json!({ "format": 1, "commands": [{ "open": project }, command] }).to_string();
        std::fs::write(&recipe, text).unwrap();
        done(&["run", &recipe]);
    };
    session(json!({ "remove_label": 1 }));
    done(&[
        "export",
        &project,
        "--cloud",
        &recording.path("out/c.ply"),
        "--per-label",
    ]);
    let names = std::fs::read_dir(recording.path("out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    let names: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
    let name = names
        .iter()
        .find(|name| name.contains("Stängel"))
        .expect("the cloud still has the label");
    let (cloud, mine) = (recording.path("c.ply"), recording.path(name));
    std::fs::write(&mine, "mine").unwrap();
    for more in [&[][..], &["--overwrite"]] {
        refused(
            &[
                &["export", &project, "--cloud", &cloud, "--per-label"],
                more,
            ]
            .concat(),
        );
        assert_eq!(std::fs::read_to_string(&mine).unwrap(), "mine");
    }
}

/// Script that reads the exports with common libraries and checks their content.
const READERS: &str = r#"
import json, sys
import numpy as np
out, count, labelled = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
import plyfile, open3d, trimesh, pycolmap, laspy
from pycocotools.coco import COCO
for name in ["c.ply", "c_labels.ply", "v.ply"]:
    ply = plyfile.PlyData.read(f"{out}/{name}")
    assert {p.val_dtype for p in ply["vertex"].properties} <= {"f4", "u1", "i4"}, name
    cloud = open3d.t.io.read_point_cloud(f"{out}/{name}")
    assert "label" in cloud.point, (name, list(cloud.point))
    assert len(cloud.point.positions) == len(ply["vertex"])
    assert np.array_equal(cloud.point["label"].numpy().ravel(), ply["vertex"]["label"]), name
ply = plyfile.PlyData.read(f"{out}/c.ply")["vertex"]
assert len(ply) == count and (ply["label"] == 1).sum() == labelled
assert len(trimesh.load(f"{out}/c.ply").vertices) == count
mesh = plyfile.PlyData.read(f"{out}/m.ply")
assert len(trimesh.load(f"{out}/m.ply", process=False).faces) == len(mesh["face"]) > 0
assert len(open3d.io.read_triangle_mesh(f"{out}/m.ply").triangles) == len(mesh["face"])
assert trimesh.load(f"{out}/m.glb").geometry
assert trimesh.load(f"{out}/m.obj", process=False) is not None
las = laspy.read(f"{out}/c.las")
assert len(las) == count and (np.asarray(las["label"]) == 1).sum() == labelled
assert np.allclose(las.xyz, np.stack([ply["x"], ply["y"], ply["z"]], 1), atol=2e-3)
assert len(laspy.read(f"{out}/c.laz")) == count
assert len(open3d.io.read_point_cloud(f"{out}/c.pcd").points) == count
for folder in ["cameras", "cameras-binary", "undistorted/sparse"]:
    model = pycolmap.Reconstruction(f"{out}/{folder}")
    assert len({image.name for image in model.images.values()}) == 4, folder
coco = COCO(f"{out}/coco/annotations.json")
assert len(coco.getImgIds()) == 4 and all(coco.annToMask(a).sum() > 0 for a in coco.loadAnns(coco.getAnnIds()))
names = json.load(open(f"{out}/c.classes.json"))
assert "Stängel 名前" in json.dumps(names, ensure_ascii=False)
print("all read")
"#;

#[test]
#[ignore = "needs python3 with plyfile, open3d, trimesh, pycolmap, laspy, lazrs, pycocotools: add --include-ignored"]
fn common_libraries_read_every_export() {
    let modules = "import plyfile, open3d, trimesh, pycolmap, laspy, lazrs, pycocotools";
    let python = |args: &[&str]| Command::new("python3").args(args).output();
    assert!(
        python(&["-c", modules]).is_ok_and(|output| output.status.success()),
        "python3 cannot {modules}"
    );
    let recording = Recording::new();
    let project = fused(&recording);
    let out = recording.path("out");
    let at = |name: &str| format!("{out}/{name}");
    done(&[
        "export",
        &project,
        "--cloud",
        &at("c.ply"),
        "--twin",
        "--mesh",
        &at("m.ply"),
        "--voxels",
        &at("v.ply"),
    ]);
    done(&[
        "export",
        &project,
        "--cloud",
        &at("c.las"),
        "--mesh",
        &at("m.glb"),
        "--cameras",
        &at("cameras"),
    ]);
    done(&[
        "export",
        &project,
        "--cloud",
        &at("c.laz"),
        "--mesh",
        &at("m.obj"),
        "--undistorted",
        &at("undistorted"),
    ]);
    done(&[
        "export",
        &project,
        "--cloud",
        &at("c.pcd"),
        "--cameras",
        &at("cameras-binary"),
        "--binary",
    ]);
    done(&["masks", &project, "export", &at("coco"), "--format", "coco"]);
    let progress = ostra_core::job::Progress::default();
    let cloud = ostra_cloud::ply::read_ply(Path::new(&at("c.ply")), &progress)
        .unwrap()
        .cloud;
    let labelled = cloud.labels.iter().filter(|label| label.0 == 1).count();
    assert!(labelled > 0);
    let output = python(&[
        "-c",
        READERS,
        &out,
        &cloud.len().to_string(),
        &labelled.to_string(),
    ])
    .unwrap();
    let text = format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(
        output.status.success() && text.contains("all read"),
        "{text}"
    );
}
