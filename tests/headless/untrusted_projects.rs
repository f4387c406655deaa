//! Tests of untrusted and damaged projects, read-only folders and moved data.
//!
//! Nothing outside the project folder is changed, and nothing is lost.

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use ostra_cloud::LabelledCloud;
use ostra_cloud::ply::{SavedColors, read_ply, save_ply};
use ostra_core::job::Progress;
use ostra_session::{Command, Session};
use tempfile::TempDir;

use super::recording::Recording;
use crate::program::{contents, done, ostra, refused};

/// Returns a recording and its project with masks, a cloud and a history.
fn finished() -> &'static (Recording, String) {
    static FINISHED: OnceLock<(Recording, String)> = OnceLock::new();
    FINISHED.get_or_init(|| {
        let recording = Recording::new();
        let project = recording.project();
        done(&["label", &project, "thing"]);
        done(&[
            "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
        ]);
        done(&[
            "prompt", &project, "--frame", "2", "--label", "thing", "--click", "20,24",
        ]);
        done(&["fuse", &project, "--voxel", "0.03"]);
        (recording, project)
    })
}

/// A copy of the finished project, next to foreign files that must not change.
struct Copy {
    dir: TempDir,
    project: String,
}

impl Copy {
    fn new() -> Self {
        let dir = TempDir::new().unwrap();
        let project = dir.path().join("project");
        copy_folder(Path::new(&finished().1), &project);
        fs::create_dir(dir.path().join("theirs")).unwrap();
        fs::write(dir.path().join("theirs/notes"), "export X=1\n").unwrap();
        Self {
            project: project.to_str().unwrap().to_owned(),
            dir,
        }
    }

    fn file(&self, name: &str) -> PathBuf {
        Path::new(&self.project).join(name)
    }

    fn theirs(&self, name: &str) -> PathBuf {
        self.dir.path().join("theirs").join(name)
    }

    fn assert_theirs_untouched(&self, case: &str) {
        let theirs = contents(&self.dir.path().join("theirs"));
        assert_eq!(
            theirs,
            [(self.theirs("notes"), b"export X=1\n".to_vec())],
            "{case}"
        );
    }

    /// Adds labels whose steps exist only in the journal, as after a kill.
    fn make_steps(&self, labels: &[&str]) {
        let before: Vec<_> = ["project.toml", "history.jsonl"]
            .map(|name| fs::read(self.file(name)).unwrap())
            .into();
        let mut session = Session::new();
        session
            .act(Command::Open(self.project.clone().into()))
            .unwrap();
        session.settle(|_| ControlFlow::Continue(()));
        for label in labels {
            session
                .act(Command::AddLabel {
                    name: (*label).into(),
                    parent: None,
                    color: None,
                })
                .unwrap();
        }
        let journal = fs::read(self.file("journal.jsonl")).unwrap();
        drop(session);
        for (name, bytes) in ["project.toml", "history.jsonl"].into_iter().zip(before) {
            fs::write(self.file(name), bytes).unwrap();
        }
        fs::write(self.file("journal.jsonl"), journal).unwrap();
    }
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs a command that must succeed; returns its output and its warnings.
fn warned(args: &[&str]) -> (String, String) {
    let output = ostra(args);
    assert!(output.status.success(), "{args:?}: {}", stderr(&output));
    (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr(&output),
    )
}

#[test]
#[cfg(unix)]
fn links_that_leave_the_project_are_neither_read_nor_written_through() {
    use std::os::unix::fs::symlink;
    for name in [
        "project.toml",
        "journal.jsonl",
        "history.jsonl",
        "recipe.jsonl",
        ".lock",
        "cloud.ply",
        "masks",
        "masks/1.png",
        "masks/origins.json",
        "depths",
        "versions",
        "versions/cloud-1.ply",
        "versions/depths-1",
        "sparse",
        "sparse/cameras.txt",
        "cache",
        "votes.bin",
        "mesh.ply",
        "versions/mesh-1.ply",
    ] {
        let copy = Copy::new();
        let (path, outside) = (copy.file(name), copy.dir.path().join("outside"));
        if path.is_dir() {
            copy_folder(&path, &outside);
            fs::remove_dir_all(&path).unwrap();
        } else if path.exists() {
            fs::rename(&path, &outside).unwrap();
        } else {
            fs::create_dir(&outside).unwrap();
        }
        symlink(&outside, &path).unwrap();
        let before = contents(copy.dir.path());
        for args in [
            vec!["info", &copy.project],
            vec!["label", &copy.project, "mine"],
            vec!["doubt", &copy.project],
        ] {
            let error = refused(&args);
            assert!(
                error.contains(name) && error.contains("leads out of the project's folder"),
                "{name}: {error}"
            );
        }
        fs::remove_file(&path).unwrap();
        symlink(copy.theirs("missing"), &path).unwrap();
        assert!(
            refused(&["label", &copy.project, "mine"]).contains("remove the link"),
            "{name}"
        );
        fs::remove_file(&path).unwrap();
        symlink(&outside, &path).unwrap();
        assert_eq!(contents(copy.dir.path()), before, "{name}");
        copy.assert_theirs_untouched(name);
    }
}

#[test]
#[cfg(unix)]
fn links_inside_the_project_are_followed_but_not_out_of_it() {
    use std::os::unix::fs::symlink;
    let copy = Copy::new();
    fs::rename(copy.file("masks"), copy.file("other")).unwrap();
    symlink("other", copy.file("masks")).unwrap();
    symlink("..", copy.file("versions/circle")).unwrap();
    let masks = |text: String| {
        text.lines()
            .find(|line| line.starts_with("masks"))
            .unwrap()
            .to_owned()
    };
    assert_eq!(
        masks(done(&["info", &copy.project])),
        masks(done(&["info", &finished().1]))
    );
    symlink(copy.theirs("notes"), copy.file("other/0.png")).unwrap();
    assert!(refused(&["info", &copy.project]).contains("other/0.png: is a link that leads out"));
    copy.assert_theirs_untouched("through a link inside");
}

#[test]
#[cfg(unix)]
fn hard_links_and_temporary_names_do_not_lead_outside() {
    use std::os::unix::fs::symlink;
    let copy = Copy::new();
    for name in ["journal.jsonl", "history.jsonl", "recipe.jsonl", ".lock"] {
        let _ = fs::remove_file(copy.file(name));
        fs::hard_link(copy.theirs("notes"), copy.file(name)).unwrap();
    }
    for name in [
        ".lock.tmp",
        "project.toml.tmp",
        "journal.jsonl.tmp",
        "history.jsonl.tmp",
        "recipe.jsonl.tmp",
    ] {
        symlink(copy.theirs("notes"), copy.file(name)).unwrap();
    }
    let (_, warnings) = warned(&["info", &copy.project]);
    assert!(
        warnings.contains("journal.jsonl") && warnings.contains("history.jsonl"),
        "{warnings}"
    );
    copy.assert_theirs_untouched("info");
    done(&["label", &copy.project, "mine"]);
    done(&[
        "prompt",
        &copy.project,
        "--frame",
        "0",
        "--label",
        "mine",
        "--click",
        "20,24",
    ]);
    copy.assert_theirs_untouched("edits");
    assert!(done(&["info", &copy.project]).contains("mine"));
    assert!(
        fs::symlink_metadata(copy.file("project.toml.tmp")).is_err(),
        "what killed runs left is removed"
    );
}

#[test]
fn names_in_a_project_do_not_lead_outside() {
    for (from, to) in [
        ("name = \"0.png\"", "name = \"../theirs/notes\""),
        ("name = \"0.png\"", "name = \"/etc/x\""),
        ("name = \"0.png\"", "name = \"a\\u0000b\""),
    ] {
        let copy = Copy::new();
        let text = fs::read_to_string(copy.file("project.toml")).unwrap();
        assert!(text.contains(from), "{text}");
        fs::write(copy.file("project.toml"), text.replacen(from, to, 1)).unwrap();
        let error = refused(&["label", &copy.project, "mine"]);
        assert!(error.contains("cannot be the name of a frame"), "{error}");
        copy.assert_theirs_untouched(to);
    }
    let copy = Copy::new();
    let text = fs::read_to_string(copy.file("project.toml")).unwrap();
    let (start, end) = (
        text.find("[frames.depth]").unwrap(),
        text.find("[frames.camera").unwrap(),
    );
    // Links are checked only in the project's own folders.
    for place in ["../theirs/notes", "theirs/notes"] {
        let made = format!("[frames.depth]\nmade = \"{place}\"\nscale = 1.0\n\n");
        fs::write(
            copy.file("project.toml"),
            [&text[..start], &made, &text[end..]].concat(),
        )
        .unwrap();
        assert!(refused(&["info", &copy.project]).contains("must lie among those of the project"));
        copy.assert_theirs_untouched("depth");
    }
}

#[test]
fn viewing_a_project_writes_nothing() {
    let copy = Copy::new();
    copy.make_steps(&["one", "two"]);
    let mut journal = fs::read(copy.file("journal.jsonl")).unwrap();
    journal.extend(b"{\"seq\":99,\"ac");
    fs::write(copy.file("journal.jsonl"), journal).unwrap();
    fs::remove_file(copy.file(".lock")).unwrap();
    fs::write(copy.file("versions/.ostra-cloud.ply.x.tmp"), "half").unwrap();
    let before = contents(Path::new(&copy.project));
    let out = |name: &str| copy.dir.path().join(name).to_str().unwrap().to_owned();
    for args in [
        vec!["info", &copy.project],
        vec!["info", &copy.project, "--json"],
        vec!["shot", &copy.project, &out("shot.png"), "--size", "64x48"],
        vec![
            "export",
            &copy.project,
            "--cloud",
            &out("c.ply"),
            "--masks",
            &out("m"),
            "--depths",
            &out("d"),
        ],
        vec!["masks", &copy.project, "export", &out("m2")],
        vec!["doubt", &copy.project],
        vec!["suggest", &copy.project],
    ] {
        let (_, warnings) = warned(&args);
        assert!(
            warnings.contains("last line is incomplete"),
            "{args:?}: {warnings}"
        );
        assert_eq!(contents(Path::new(&copy.project)), before, "{args:?}");
    }
    let listed = done(&["info", &copy.project]);
    assert!(listed.contains("one") && listed.contains("two"), "{listed}");
    let (_, warnings) = warned(&["label", &copy.project, "three"]);
    assert!(warnings.contains("last line is incomplete"), "{warnings}");
    let (listed, warnings) = warned(&["info", &copy.project]);
    assert!(
        listed.contains("two") && listed.contains("three") && warnings.is_empty(),
        "{listed} {warnings}"
    );
    assert!(!copy.file("versions/.ostra-cloud.ply.x.tmp").exists());
}

/// Makes a folder read-only: by a mount for the administrator, by permissions for other users.
#[cfg(target_os = "linux")]
struct ReadOnly<'a> {
    folder: &'a str,
    is_mounted: bool,
}

#[cfg(target_os = "linux")]
impl<'a> ReadOnly<'a> {
    /// Returns `None` if neither is possible: for an administrator who may not mount.
    fn new(folder: &'a str) -> Option<Self> {
        let mount = |args: &[&str]| {
            std::process::Command::new("mount")
                .args(args)
                .output()
                .is_ok_and(|out| out.status.success())
        };
        let made = Self {
            folder,
            is_mounted: mount(&["--bind", folder, folder]),
        };
        if made.is_mounted {
            mount(&["-o", "remount,ro,bind", folder]);
        } else {
            made.permit("a-w");
        }
        std::fs::write(format!("{folder}/probe"), "")
            .is_err()
            .then_some(made)
    }

    fn permit(&self, mode: &str) {
        assert!(
            std::process::Command::new("chmod")
                .args(["-R", mode, self.folder])
                .status()
                .unwrap()
                .success()
        );
    }
}

#[cfg(target_os = "linux")]
impl Drop for ReadOnly<'_> {
    fn drop(&mut self) {
        if self.is_mounted {
            assert!(
                std::process::Command::new("umount")
                    .arg(self.folder)
                    .status()
                    .unwrap()
                    .success()
            );
        } else {
            self.permit("u+w");
        }
    }
}

#[test]
#[cfg(target_os = "linux")]
fn project_on_read_only_media_can_be_viewed_but_not_changed() {
    let copy = Copy::new();
    let Some(read_only) = ReadOnly::new(&copy.project) else {
        println!("not tested: an administrator who may not mount can write everywhere");
        return;
    };
    let shot = copy.dir.path().join("shot.png");
    let outcomes = [
        ostra(&["info", &copy.project]),
        ostra(&[
            "shot",
            &copy.project,
            shot.to_str().unwrap(),
            "--size",
            "64x48",
        ]),
        ostra(&["label", &copy.project, "mine"]),
    ];
    let mut session = Session::new();
    session
        .act(Command::Open(copy.project.clone().into()))
        .unwrap();
    let events = session.settle(|_| ControlFlow::Continue(()));
    let (frames, reason) = (
        session.project().map(|project| project.frames.len()),
        session.view_reason().map(str::to_owned),
    );
    let step = session.act(Command::AddLabel {
        name: "mine".into(),
        parent: None,
        color: None,
    });
    drop(session);
    drop(read_only);
    assert_eq!(
        outcomes.each_ref().map(|out| out.status.code()),
        [Some(0), Some(0), Some(1)],
        "{outcomes:?}"
    );
    assert!(
        stderr(&outcomes[2]).contains("cannot be written"),
        "{}",
        stderr(&outcomes[2])
    );
    assert!(frames == Some(4) && reason.is_some(), "{events:?}");
    assert!(format!("{:#}", step.unwrap_err()).contains("open for viewing"));
}

#[test]
fn damaged_journal_loses_the_steps_from_there_on_and_is_kept() {
    type Spoil = fn(&mut Vec<u8>, usize);
    let spoils: [(Spoil, &str); 3] = [
        (
            |bytes, line| bytes[line + 20] ^= 0x55,
            "line 2 is damaged; this step and the one after it are left out",
        ),
        (
            |bytes, line| bytes.drain(..line).for_each(drop),
            "lacks step",
        ),
        (
            |bytes, line| drop(bytes.splice(line..line, *b"\0\0\0\n")),
            "line 2 is damaged; this step and the 2 after it",
        ),
    ];
    for (spoil, says) in spoils {
        let copy = Copy::new();
        copy.make_steps(&["one", "two", "three"]);
        let mut bytes = fs::read(copy.file("journal.jsonl")).unwrap();
        let second = bytes.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        if says == "lacks step" {
            // The second of three lines is missing.
            let third = second
                + bytes[second..]
                    .iter()
                    .position(|&byte| byte == b'\n')
                    .unwrap()
                + 1;
            bytes.drain(second..third);
        } else {
            spoil(&mut bytes, second);
        }
        fs::write(copy.file("journal.jsonl"), &bytes).unwrap();
        let before = contents(Path::new(&copy.project));
        let (listed, warnings) = warned(&["info", &copy.project]);
        assert!(
            listed.contains("one") && !listed.contains("two") && !listed.contains("three"),
            "{listed}"
        );
        assert!(
            warnings.contains(says) && warnings.contains("nothing was changed"),
            "{warnings}"
        );
        assert_eq!(contents(Path::new(&copy.project)), before);
        fs::write(copy.file("journal.jsonl.damaged"), "of an earlier time").unwrap();
        let (_, warnings) = warned(&["label", &copy.project, "four"]);
        assert!(
            warnings.contains(says) && warnings.contains("kept as journal.jsonl.damaged-2"),
            "{warnings}"
        );
        assert_eq!(
            fs::read(copy.file("journal.jsonl.damaged-2")).unwrap(),
            bytes
        );
        assert_eq!(
            fs::read(copy.file("journal.jsonl.damaged")).unwrap(),
            b"of an earlier time"
        );
        let (listed, warnings) = warned(&["info", &copy.project]);
        assert!(
            listed.contains("one") && listed.contains("four") && warnings.is_empty(),
            "{listed} {warnings}"
        );
    }
}

/// Checks that unusable journals are kept under another name.
///
/// A journal without its first step belongs to another state. A tool that changed the line ends
/// turned the journal into one long line.
#[test]
fn journals_that_cannot_be_used_at_all_are_kept_aside() {
    type Spoil = fn(&str) -> String;
    let spoils: [(Spoil, &str); 2] = [
        (
            |journal| journal.lines().last().unwrap().to_owned() + "\n",
            "lacks step",
        ),
        (|journal| journal.replace('\n', "\r"), "line 1 is damaged"),
    ];
    for (spoil, says) in spoils {
        let copy = Copy::new();
        copy.make_steps(&["alpha", "beta"]);
        let spoilt = spoil(&fs::read_to_string(copy.file("journal.jsonl")).unwrap());
        fs::write(copy.file("journal.jsonl"), &spoilt).unwrap();
        let before = contents(Path::new(&copy.project));
        let (listed, warnings) = warned(&["info", &copy.project]);
        assert!(
            !listed.contains("alpha") && !listed.contains("beta"),
            "{listed}"
        );
        assert!(
            warnings.contains(says) && warnings.contains("nothing was changed"),
            "{warnings}"
        );
        assert_eq!(contents(Path::new(&copy.project)), before);
        let (_, warnings) = warned(&["label", &copy.project, "mine"]);
        assert!(
            warnings.contains("kept as journal.jsonl.damaged"),
            "{warnings}"
        );
        assert_eq!(
            fs::read_to_string(copy.file("journal.jsonl.damaged")).unwrap(),
            spoilt
        );
        assert!(done(&["info", &copy.project]).contains("mine"));
    }
}

/// Checks that a mask of another size is refused by its header, without decoding it.
#[test]
fn masks_of_another_size_are_refused_by_their_header() {
    let copy = Copy::new();
    let mut bomb = Vec::new();
    let mut encoder = png::Encoder::new(&mut bomb, 16_000, 16_000);
    encoder.set_depth(png::BitDepth::One);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&vec![0; 16_000 * 2_000])
        .unwrap();
    fs::write(copy.file("masks/1.png"), &bomb).unwrap();
    // About 400 MB of address space for the whole process; decoding would take more than 500 MB.
    let script = format!(
        "ulimit -v 400000; exec {} info {}",
        env!("CARGO_BIN_EXE_ostra"),
        copy.project
    );
    let output = std::process::Command::new("sh")
        .arg("-c")
        .arg(script)
        .output()
        .unwrap();
    let text = stderr(&output);
    assert!(
        output.status.success() && text.contains("1.png") && text.contains("16000"),
        "{text}"
    );
}

#[test]
fn damaged_history_loses_undo_and_is_kept() {
    let whole = fs::read(Path::new(&finished().1).join("history.jsonl")).unwrap();
    let first = whole.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    let second = first
        + whole[first..]
            .iter()
            .position(|&byte| byte == b'\n')
            .unwrap()
        + 1;
    let flipped: Vec<u8> = whole
        .iter()
        .enumerate()
        .map(|(k, &byte)| if k == 30 { byte ^ 0x55 } else { byte })
        .collect();
    let without_a_step = [&whole[..first], &whole[second..]].concat();
    for damaged in [flipped, whole[..whole.len() - 9].to_vec(), without_a_step] {
        let copy = Copy::new();
        fs::write(copy.file("history.jsonl"), &damaged).unwrap();
        let before = contents(Path::new(&copy.project));
        let (_, warnings) = warned(&["info", &copy.project]);
        assert!(
            warnings.contains("history.jsonl: ") && warnings.contains("cannot be undone"),
            "{warnings}"
        );
        assert_eq!(contents(Path::new(&copy.project)), before);
        let (_, warnings) = warned(&["label", &copy.project, "mine"]);
        assert!(
            warnings.contains("kept as history.jsonl.damaged"),
            "{warnings}"
        );
        assert_eq!(
            fs::read(copy.file("history.jsonl.damaged")).unwrap(),
            damaged
        );
        assert_eq!(warned(&["info", &copy.project]).1, "");
    }
}

#[test]
fn damaged_masks_and_origins_are_reported_and_kept() {
    let masks = |listed: &str| {
        listed
            .lines()
            .find(|line| line.starts_with("masks"))
            .unwrap()
            .to_owned()
    };
    let whole = masks(&done(&["info", &finished().1]));
    assert!(whole.contains("2 keyframes"), "{whole}");
    let empty_png = |width, height| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::GrayImage::new(width, height)
            .write_to(&mut bytes, image::ImageFormat::Png)
            .unwrap();
        bytes.into_inner()
    };
    for (name, damaged, count, says) in [
        (
            "masks/origins.json",
            b"{\"0.png\":".to_vec(),
            "2 keyframes",
            "2 masks count as keyframes",
        ),
        (
            "masks/origins.json",
            b"{\"1.png\":{\"origin\":\"x\"},\"2.png\":{\"origin\":\"anchor\"}}".to_vec(),
            "2 keyframes",
            "1 of its entries",
        ),
        (
            "masks/1.png",
            b"no image".to_vec(),
            "1 keyframes",
            "frame 1 (1.png) has no mask now",
        ),
        (
            "masks/1.png",
            empty_png(10, 10),
            "1 keyframes",
            "frame 1 (1.png) has no mask now",
        ),
    ] {
        let copy = Copy::new();
        fs::write(copy.file(name), &damaged).unwrap();
        let before = contents(Path::new(&copy.project));
        let (listed, warnings) = warned(&["info", &copy.project]);
        assert!(
            masks(&listed).contains(count) && warnings.contains(says) && warnings.contains(name),
            "{warnings}"
        );
        assert_eq!(contents(Path::new(&copy.project)), before);
        let (_, warnings) = warned(&["label", &copy.project, "mine"]);
        assert!(warnings.contains("the file is kept as"), "{warnings}");
        assert_eq!(
            fs::read(copy.file(&format!("{name}.damaged"))).unwrap(),
            damaged
        );
        let (listed, warnings) = warned(&["info", &copy.project]);
        assert!(
            masks(&listed).contains(count) && warnings.is_empty(),
            "{name}: {listed} {warnings}"
        );
    }
    let copy = Copy::new();
    fs::remove_file(copy.file("masks/origins.json")).unwrap();
    let (listed, warnings) = warned(&["info", &copy.project]);
    assert!(
        masks(&listed).contains("2 keyframes") && warnings.contains("origins.json: is missing"),
        "{warnings}"
    );
}

#[test]
fn votes_of_another_cloud_are_refused_until_the_next_fusion() {
    let copy = Copy::new();
    let path = copy.file("versions/cloud-1.ply");
    let cloud = read_ply(&path, &Progress::default()).unwrap().cloud;
    let fewer = LabelledCloud {
        tree: cloud.tree.clone(),
        ..LabelledCloud::from_positions(cloud.positions[9..].to_vec())
    };
    save_ply(&path, &fewer, SavedColors::Image, &Progress::default()).unwrap();
    let votes = format!(
        "has votes on {} points, but there are {}",
        cloud.len(),
        fewer.len()
    );
    let out = ostra(&["doubt", &copy.project]);
    assert!(
        out.status.code() == Some(1) && stderr(&out).contains(&votes),
        "{}",
        stderr(&out)
    );
    for args in [
        vec!["instances", &copy.project, "--label", "thing"],
        vec!["adopt", &copy.project],
        vec!["doubt", &copy.project, "--accept", "1"],
    ] {
        assert!(refused(&args).contains(&votes), "{args:?}");
    }
    let voxels = copy.dir.path().join("v.ply");
    assert_ne!(
        ostra(&[
            "export",
            &copy.project,
            "--voxels",
            voxels.to_str().unwrap()
        ])
        .status
        .code(),
        Some(101)
    );
    let shot = copy.dir.path().join("shot.png");
    warned(&[
        "shot",
        &copy.project,
        shot.to_str().unwrap(),
        "--size",
        "64x48",
    ]);
    // A vote of the masks normally reuses the points, but these cannot be used.
    done(&["fuse", &copy.project, "--voxel", "0.03"]);
    assert_eq!(warned(&["doubt", &copy.project]).1, "");
}

/// A kind of damage to a file.
#[cfg(unix)]
struct Spoil {
    kind: &'static str,
    /// Damages the file at the first path; the second is a file outside the project.
    apply: fn(&Path, &Path),
}

#[cfg(unix)]
impl Spoil {
    fn new(kind: &'static str, apply: fn(&Path, &Path)) -> Self {
        Self { kind, apply }
    }
}

#[cfg(unix)]
fn spoils() -> [Spoil; 6] {
    use std::os::unix::fs::symlink;
    [
        Spoil::new("flip", |path, _| {
            let mut bytes = fs::read(path).unwrap();
            let at = bytes.len() / 2;
            bytes.get_mut(at).into_iter().for_each(|byte| *byte ^= 0x80);
            fs::write(path, bytes).unwrap();
        }),
        Spoil::new("truncate", |path, _| {
            fs::write(
                path,
                &fs::read(path).unwrap()[..fs::metadata(path).unwrap().len() as usize / 2],
            )
            .unwrap();
        }),
        Spoil::new("folder", |path, _| {
            fs::remove_file(path).unwrap();
            fs::create_dir(path).unwrap();
        }),
        Spoil::new("pipe", |path, _| {
            fs::remove_file(path).unwrap();
            assert!(
                std::process::Command::new("mkfifo")
                    .arg(path)
                    .status()
                    .unwrap()
                    .success()
            );
        }),
        Spoil::new("link", |path, theirs| {
            fs::remove_file(path).unwrap();
            symlink(theirs, path).unwrap();
        }),
        Spoil::new("missing", |path, _| fs::remove_file(path).unwrap()),
    ]
}

/// Damages every file of a project in every way, then views and changes the project.
///
/// Each command must end, change nothing outside, and report what is missing.
#[test]
#[cfg(unix)]
fn damage_to_any_file_is_never_silent() {
    let whole = done(&["info", &finished().1, "--json"]);
    let root = Path::new(&finished().1);
    let files: Vec<String> = contents(root)
        .into_iter()
        .map(|(path, _)| {
            path.strip_prefix(root)
                .unwrap()
                .to_str()
                .unwrap()
                .to_owned()
        })
        .filter(|name| !name.starts_with("depths"))
        .collect();
    for name in &files {
        // Results are read on request; there, two kinds of damage stand for all.
        let is_result =
            name.starts_with("versions") || name.ends_with(".ply") || name.ends_with(".bin");
        for spoil in spoils()
            .into_iter()
            .filter(|spoil| !is_result || matches!(spoil.kind, "flip" | "pipe"))
        {
            check_spoilt(name, &spoil, &whole);
        }
    }
}

/// Damages one file of a project, then views and changes the project.
///
/// `whole` is what `ostra info` prints of the undamaged project.
#[cfg(unix)]
fn check_spoilt(name: &str, spoil: &Spoil, whole: &str) {
    let case = format!("{name}: {}", spoil.kind);
    let copy = Copy::new();
    (spoil.apply)(&copy.file(name), &copy.theirs("notes"));
    let damaged = fs::symlink_metadata(copy.file(name))
        .ok()
        .filter(fs::Metadata::is_file)
        .map(|_| fs::read(copy.file(name)).unwrap());
    let info = ostra(&["info", &copy.project, "--json"]);
    let (code, text) = (info.status.code(), stderr(&info));
    assert!(
        matches!(code, Some(0 | 1)) && !text.contains("panicked"),
        "{case}: {text}"
    );
    assert!(
        info.stdout == whole.as_bytes() || !text.trim().is_empty(),
        "{case}: it is lost silently"
    );
    let label = ostra(&["label", &copy.project, "mine"]);
    let text = stderr(&label);
    assert!(
        matches!(label.status.code(), Some(0 | 1)) && !text.contains("panicked"),
        "{case}: {text}"
    );
    copy.assert_theirs_untouched(&case);
    let is_kept = |damaged: Vec<u8>| {
        let bytes = |path: &Path| fs::read(path).unwrap();
        let mut all = Vec::new();
        files_below(Path::new(&copy.project), &mut all);
        all.iter().any(|path| bytes(path).starts_with(&damaged))
    };
    // An incomplete line is not a step, and results under fixed names are copies: both may
    // go.
    let is_copy = !name.contains('/') && !name.ends_with(".jsonl");
    let kept =
        damaged.is_none_or(|damaged| spoil.kind == "truncate" || is_copy || is_kept(damaged));
    assert!(
        kept || name.starts_with("sparse"),
        "{case}: the damaged file is gone"
    );
}

/// Appends the regular files below a folder to `all`.
fn files_below(folder: &Path, all: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().flatten() {
        match entry.file_type().unwrap() {
            kind if kind.is_dir() => files_below(&entry.path(), all),
            kind if kind.is_file() => all.push(entry.path()),
            _ => {}
        }
    }
}

#[test]
fn project_moved_with_its_images_opens() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    let toml = fs::read_to_string(Path::new(&project).join("project.toml")).unwrap();
    assert!(
        toml.contains("path = \"../color/0.png\"") && toml.contains("path = \"../depth/0.png\""),
        "{toml}"
    );
    let elsewhere = TempDir::new().unwrap();
    let set = elsewhere.path().join("deep/set");
    fs::create_dir_all(set.parent().unwrap()).unwrap();
    fs::rename(Path::new(&project).parent().unwrap(), &set).unwrap();
    let moved = set.join("project").to_str().unwrap().to_owned();
    assert_eq!(warned(&["fuse", &moved, "--voxel", "0.03"]).1, "");
    assert_eq!(warned(&["info", &moved]).1, "");
    // The project alone still finds the images where they are.
    let alone = elsewhere.path().join("alone").to_str().unwrap().to_owned();
    fs::rename(&moved, &alone).unwrap();
    assert_eq!(warned(&["fuse", &alone, "--voxel", "0.05"]).1, "");
    // `Recording` removes this folder at the end.
    fs::create_dir(Path::new(&project).parent().unwrap()).unwrap();
}

#[test]
fn sources_of_an_older_project_are_found_next_to_it_but_not_replaced_by_others() {
    let recording = Recording::new();
    let project = recording.project();
    let toml = Path::new(&project).join("project.toml");
    let parent = Path::new(&project).parent().unwrap().to_owned();
    let text = fs::read_to_string(&toml).unwrap();
    let older: Vec<String> = text
        .lines()
        .filter(|line| !line.starts_with("folder = "))
        .map(|line| line.replace("path = \"..", &format!("path = \"{}", parent.display())))
        .collect();
    fs::write(&toml, older.join("\n") + "\n").unwrap();
    assert_eq!(
        warned(&["info", &project]).1,
        "",
        "absolute paths are read as before"
    );
    let elsewhere = TempDir::new().unwrap();
    let set = elsewhere.path().join("set");
    fs::rename(&parent, &set).unwrap();
    let moved = set.join("project").to_str().unwrap().to_owned();
    let (_, warnings) = warned(&["fuse", &moved, "--voxel", "0.03"]);
    assert!(
        warnings.contains("were found in")
            && warnings.contains(set.join("color").to_str().unwrap()),
        "{warnings}"
    );
    assert_eq!(warned(&["info", &moved]).1, "");

    // Other images with the same names are not used.
    let other = elsewhere.path().join("other");
    fs::create_dir_all(other.join("color")).unwrap();
    (0..4).for_each(|k| {
        image::RgbImage::new(32, 32)
            .save(other.join(format!("color/{k}.png")))
            .unwrap();
    });
    fs::rename(set.join("project"), other.join("project")).unwrap();
    fs::rename(&set, elsewhere.path().join("renamed")).unwrap();
    let project = other.join("project").to_str().unwrap().to_owned();
    let (_, warnings) = warned(&["info", &project]);
    assert!(
        warnings.contains("source files are missing") && warnings.contains("ostra relocate"),
        "{warnings}"
    );
    let error = refused(&["fuse", &project, "--voxel", "0.03"]);
    assert!(
        error.contains("is missing") && error.contains("ostra relocate"),
        "{error}"
    );
    fs::create_dir(&parent).unwrap();
}

#[test]
fn relocate_points_frames_to_the_same_files_elsewhere() {
    let recording = Recording::new();
    let project = recording.project();
    let elsewhere = TempDir::new().unwrap();
    let to = |name: &str| elsewhere.path().join(name).to_str().unwrap().to_owned();
    fs::rename(recording.path("color"), to("images")).unwrap();
    assert!(refused(&["fuse", &project]).contains("ostra relocate PROJECT OLD NEW"));
    let error = refused(&["relocate", &project, "/nowhere", &to("images")]);
    assert!(
        error.contains(&recording.path("color")) && error.contains(&recording.path("depth")),
        "{error}"
    );
    assert!(
        refused(&["relocate", &project, &recording.path("color"), &to("none")])
            .contains("0.png: is missing")
    );
    fs::create_dir(to("small")).unwrap();
    (0..4).for_each(|k| {
        image::RgbImage::new(32, 32)
            .save(format!("{}/{k}.png", to("small")))
            .unwrap();
    });
    let error = refused(&["relocate", &project, &recording.path("color"), &to("small")]);
    assert!(
        error.contains("it has 32 × 32 pixels") && error.contains("64 × 48"),
        "{error}"
    );
    let message = done(&[
        "relocate",
        &project,
        &format!("{}/", recording.path("color")),
        &to("images"),
    ]);
    assert!(message.contains("4 frames are read from"), "{message}");
    assert_eq!(warned(&["fuse", &project, "--voxel", "0.03"]).1, "");
    // One image was deleted during the move; the others are still found.
    fs::rename(to("images"), to("moved")).unwrap();
    fs::remove_file(format!("{}/2.png", to("moved"))).unwrap();
    let (message, warnings) = warned(&["relocate", &project, &to("images"), &to("moved")]);
    assert!(message.contains("3 frames are read from"), "{message}");
    assert!(
        warnings.contains("1 frame stays as it was") && warnings.contains("2.png"),
        "{warnings}"
    );
}

/// Checks that a step in the journal counts as made although the checkpoint fails.
///
/// A limit on the size of files stands for a full disk: the step fits into the journal, the
/// checkpoint does not.
#[test]
#[cfg(unix)]
fn completed_step_is_not_reported_as_failed() {
    let copy = Copy::new();
    let size = fs::metadata(copy.file("project.toml")).unwrap().len();
    assert!(size > 2048, "{size}");
    let script = format!(
        "trap '' XFSZ; ulimit -f 2; exec {} label {} full",
        env!("CARGO_BIN_EXE_ostra"),
        copy.project
    );
    let out = std::process::Command::new("sh")
        .arg("-c")
        .arg(script)
        .output()
        .unwrap();
    let text = stderr(&out);
    assert!(
        out.status.success()
            && text.contains("warning")
            && text.contains("are in the project's journal"),
        "{text}"
    );
    assert!(done(&["info", &copy.project]).contains("full"));
    let mut all = Vec::new();
    files_below(Path::new(&copy.project), &mut all);
    let left = all.iter().filter(|path| {
        path.extension()
            .is_some_and(|ending| ending == "tmp" || ending == "part")
    });
    assert_eq!(left.count(), 0, "{all:?}");
    done(&["label", &copy.project, "more"]);
    assert!(
        fs::read_to_string(copy.file("project.toml"))
            .unwrap()
            .contains("full"),
        "the rest was written"
    );
}

#[test]
fn leftovers_of_killed_runs_are_removed_and_nothing_else() {
    let copy = Copy::new();
    fs::create_dir_all(copy.file("versions/depths-9/maps")).unwrap();
    let left = [
        "project.toml.tmp",
        ".ostra-project.toml.Ab3.tmp",
        "versions/cloud-7.ply.4711.tmp",
        "versions/.ostra-mesh-7.ply.Ab3.tmp",
        "versions/depths-9/maps/0.tiff.tmp",
        "masks/.1.png.part",
        "masks/.ostra-1.png.Ab3.tmp",
    ];
    let theirs = ["notes.tmp", "paper.part", "versions/cloud-7.ply"];
    left.iter()
        .chain(&theirs)
        .for_each(|name| fs::write(copy.file(name), "half").unwrap());
    done(&["info", &copy.project]);
    assert!(
        left.iter().all(|name| copy.file(name).exists()),
        "looking removes nothing"
    );
    done(&["label", &copy.project, "mine"]);
    let still: Vec<_> = left
        .iter()
        .filter(|name| copy.file(name).exists())
        .collect();
    assert!(still.is_empty(), "{still:?}");
    assert!(theirs.iter().all(|name| copy.file(name).exists()));
}

#[test]
fn reader_sees_the_steps_of_a_concurrent_writer() {
    let copy = Copy::new();
    let mut session = Session::new();
    session
        .act(Command::Open(copy.project.clone().into()))
        .unwrap();
    session.settle(|_| ControlFlow::Continue(()));
    for (number, save) in [false, true, false].into_iter().enumerate() {
        session
            .act(Command::AddLabel {
                name: format!("label {number}"),
                parent: None,
                color: None,
            })
            .unwrap();
        if save {
            session.save().unwrap();
        }
        let (listed, warnings) = warned(&["info", &copy.project]);
        assert!(
            listed.contains(&format!("label {number}")) && warnings.is_empty(),
            "{listed} {warnings}"
        );
    }
    assert!(refused(&["label", &copy.project, "mine"]).contains("close it there first"));
}

#[test]
#[cfg(target_os = "linux")]
fn output_to_a_full_disk_is_an_error() {
    let copy = Copy::new();
    let info = |output: fs::File| {
        let mut process = std::process::Command::new(env!("CARGO_BIN_EXE_ostra"));
        process
            .args(["info", &copy.project])
            .stdout(output)
            .output()
            .unwrap()
    };
    let out = info(
        fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .unwrap(),
    );
    assert!(
        out.status.code() == Some(1) && stderr(&out).contains("standard output cannot be written"),
        "{}",
        stderr(&out)
    );
}
