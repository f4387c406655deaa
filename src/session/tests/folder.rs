use std::fs;
use std::path::{Path, PathBuf};

use super::making::{images, keyframe, perform, project, record, tracked};
use crate::{Command, NewProject, Session};
use ostra_cloud::LabelledCloud;
use ostra_cloud::ply::{SavedColors, save_ply};
use ostra_core::job::Progress;
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_project::OpenProject;
use ostra_project::store::{Folder, Loaded, cloud_path};
use ostra_project::{Edit, ResultKind, ResultRecord};

fn open(root: &Path) -> anyhow::Result<Loaded> {
    Folder::open(root, &Progress::default())
}

/// Returns every file of a folder with its content.
fn snapshot(root: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap().flatten() {
            match entry.path() {
                path if path.is_dir() => folders.push(path),
                path => found.push((path.clone(), fs::read(path).unwrap())),
            }
        }
    }
    found.sort();
    found
}

fn painted(root: &Path) -> OpenProject {
    let mut open = OpenProject::create(root, project()).unwrap();
    for (frame, ids) in [(0, [1, 0, 2]), (3, [0, 2, 2]), (4, [1, 1, 1])] {
        open.commit(
            "Paint",
            vec![Edit::SetMask {
                frame,
                mask: Some(keyframe(ids)),
            }],
        )
        .unwrap();
    }
    open.commit(
        "Track",
        vec![Edit::SetMask {
            frame: 1,
            mask: Some(tracked([1, 0, 0])),
        }],
    )
    .unwrap();
    open
}

#[test]
fn checkpoint_is_readable_with_other_tools() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    let mut made = painted(&root);
    made.save_now().unwrap();
    let text = fs::read_to_string(root.join("project.toml")).unwrap();
    assert!(text.starts_with("format = 1\n"), "{text}");
    let mask = image::open(root.join("masks/a/0.png")).unwrap();
    assert_eq!((mask.width(), mask.height()), (4, 3));
    assert!(
        root.join("masks/b/1.jpg.png").exists() && root.join("masks/b/1.png.png").exists(),
        "b/1.jpg and b/1.png"
    );
    assert_eq!(fs::metadata(root.join("journal.jsonl")).unwrap().len(), 0);
    assert_eq!(
        fs::read_to_string(root.join("history.jsonl"))
            .unwrap()
            .lines()
            .count(),
        4
    );
    made.commit(
        "Clear",
        vec![Edit::SetMask {
            frame: 0,
            mask: None,
        }],
    )
    .unwrap();
    made.save_now().unwrap();
    assert!(!root.join("masks/a/0.png").exists());
}

#[test]
fn incomplete_last_line_is_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    let state = painted(&root).project().clone();
    let journal = root.join("journal.jsonl");
    let whole = fs::read(&journal).unwrap();
    for torn in [
        &b"{\"seq\":5,\"act\":{\"st"[..],
        b"{\"seq\":5}",
        b"\0\0\0\0",
    ] {
        fs::write(&journal, [&whole[..], torn].concat()).unwrap();
        let viewed = Folder::view(&root, "", &Progress::default()).unwrap();
        assert_eq!(fs::read(&journal).unwrap(), [&whole[..], torn].concat());
        let loaded = open(&root).unwrap();
        assert_eq!((&loaded.project, &viewed.project), (&*state, &*state));
        assert_eq!(loaded.warnings, viewed.warnings);
        assert!(
            loaded.warnings[0].contains("its last line is incomplete"),
            "{:?}",
            loaded.warnings
        );
        assert_eq!(fs::read(&journal).unwrap(), whole);
    }
    fs::write(&journal, &whole[..whole.len() - 7]).unwrap();
    assert!(
        !open(&root).unwrap().project.masks.contains_key(&1),
        "the step that was not whole"
    );
}

#[test]
fn unreadable_project_is_rejected_and_not_changed() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    let mut made = painted(&root);
    made.save_now().unwrap();
    made.commit(
        "Clear",
        vec![Edit::SetMask {
            frame: 0,
            mask: None,
        }],
    )
    .unwrap();
    made.commit(
        "Clear",
        vec![Edit::SetMask {
            frame: 3,
            mask: None,
        }],
    )
    .unwrap();
    drop(made);
    let good = snapshot(&root);
    let newer = |text: String| text.replace("format = 1\n", "format = 2\n");
    type Case<'a> = (&'a str, &'a dyn Fn(String) -> String, &'a str);
    let cases: [Case<'_>; 2] = [
        (
            "project.toml",
            &newer,
            "newer program (format 2, this one reads 1)",
        ),
        (
            "project.toml",
            &|text| text[..text.len() / 2].to_owned(),
            "is damaged",
        ),
    ];
    for (name, spoil, says) in cases {
        let path = root.join(name);
        let before = fs::read_to_string(&path).unwrap();
        fs::write(&path, spoil(before.clone())).unwrap();
        let spoilt = snapshot(&root);
        let error = format!("{:#}", open(&root).expect_err(name));
        assert!(
            error.contains(says) && !error.contains('\n'),
            "{name}: {error}"
        );
        assert_eq!(snapshot(&root), spoilt, "{name}: nothing is changed");
        fs::write(&path, before).unwrap();
    }
    for (path, bytes) in good {
        fs::write(path, bytes).unwrap();
    }
    assert!(open(&root).is_ok());
    // The journal is from a later time, so its steps cannot follow.
    let path = root.join("project.toml");
    fs::write(
        &path,
        fs::read_to_string(&path)
            .unwrap()
            .replace("step = 4", "step = 2"),
    )
    .unwrap();
    let loaded = open(&root).unwrap();
    assert!(
        loaded.warnings[0].contains("lacks step 3; this step and the one after it"),
        "{:?}",
        loaded.warnings
    );
    assert!(root.join("journal.jsonl.damaged").is_file());
}

#[test]
fn damaged_history_only_costs_the_undo() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    let mut made = painted(&root);
    made.save_now().unwrap();
    let state = made.project().clone();
    drop(made);
    fs::write(root.join("history.jsonl"), "?\n?\n").unwrap();
    let loaded = open(&root).unwrap();
    assert_eq!(
        (loaded.project, loaded.warnings.len()),
        (state.as_ref().clone(), 1)
    );
    assert_eq!(
        fs::read(root.join("history.jsonl.damaged")).unwrap(),
        b"?\n?\n"
    );
    let mut again = OpenProject::loaded(open_after(loaded.folder, &root));
    again
        .commit(
            "Clear",
            vec![Edit::SetMask {
                frame: 0,
                mask: None,
            }],
        )
        .unwrap();
    again.save_now().unwrap();
    drop(again);
    let loaded = open(&root).unwrap();
    assert_eq!(loaded.warnings, Vec::<String>::new());
    let mut again = OpenProject::loaded(loaded);
    again.undo().unwrap();
    assert_eq!(*again.project(), state);
    assert!(again.undo().is_err());
}

/// Opens the project after the first holder is dropped.
fn open_after(held: Folder, root: &Path) -> Loaded {
    drop(held);
    open(root).unwrap()
}

#[test]
fn second_writer_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    let made = painted(&root);
    let error = open(&root).unwrap_err().to_string();
    assert!(
        error.contains("is open in another window or command"),
        "{error}"
    );
    drop(made);
    assert!(open(&root).is_ok());
}

#[test]
fn missing_mask_file_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    let mut made = painted(&root);
    made.save_now().unwrap();
    drop(made);
    fs::remove_file(root.join("masks/a/0.png")).unwrap();
    let loaded = open(&root).unwrap();
    assert_eq!(
        loaded.warnings,
        ["masks/a/0.png: is gone; frame 0 has no mask now"]
    );
}

#[test]
fn failed_creation_leaves_no_files() {
    let folder = tempfile::tempdir().unwrap();
    let place = images(folder.path());
    let mut session = Session::new();
    let new = |root: &str, frames: &Path, cameras: Option<PathBuf>| {
        let sources = vec![FrameFolder {
            frames: frames.to_owned(),
            depth: None,
        }];
        let open = OpenRequest {
            sources,
            ..OpenRequest::default()
        };
        Command::New(NewProject {
            root: folder.path().join(root),
            open,
            cameras,
            intrinsics: None,
        })
    };
    let before = snapshot(folder.path());
    for command in [
        new("x/p", &folder.path().join("nowhere"), None),
        new("x/p", &place, Some(folder.path().join("no-cameras"))),
        new("pictures", &place, None),
        new("pictures/0.png/p", &place, None),
    ] {
        let error = perform(&mut session, command)
            .expect_err("must fail")
            .to_string();
        assert!(!error.contains('\n'), "{error}");
        assert_eq!(snapshot(folder.path()), before);
        assert!(!folder.path().join("x").exists());
        assert!(session.project().is_none());
    }
    perform(&mut session, new("x/p", &place, None)).unwrap();
    assert_eq!(session.project().unwrap().frames.len(), 3);
    let error = perform(&mut session, new("x/p", &place, None))
        .unwrap_err()
        .to_string();
    assert!(error.contains("already holds a project"), "{error}");
}

#[test]
#[cfg(unix)]
fn a_read_only_folder_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    drop(painted(&root));
    let before = snapshot(&root);
    fs::set_permissions(&root, fs::Permissions::from_mode(0o555)).unwrap();
    if fs::write(root.join("probe"), "").is_ok() {
        return fs::remove_file(root.join("probe")).unwrap(); // the administrator may write anywhere
    }
    let error = format!("{:#}", open(&root).unwrap_err());
    assert!(
        error.contains("a project needs a folder with write access") && !error.contains('\n'),
        "{error}"
    );
    let made = OpenProject::create(&root.join("q"), project());
    assert!(format!("{:#}", made.unwrap_err()).contains("cannot be written"));
    assert_eq!(snapshot(&root), before);
    fs::set_permissions(&root, fs::Permissions::from_mode(0o755)).unwrap();
}

/// Creates a project in `root` whose only result is a cloud with this many points.
fn with_cloud(root: &Path, points: usize) {
    let mut open = OpenProject::create(root, project()).unwrap();
    let version = open.next_version().unwrap();
    let cloud = LabelledCloud::from_positions(vec![glam::Vec3::ONE; points]);
    save_ply(
        &cloud_path(root, version),
        &cloud,
        SavedColors::Image,
        &Progress::default(),
    )
    .unwrap();
    let record = ResultRecord {
        version,
        ..record("fuse")
    };
    open.commit(
        "Fuse",
        vec![Edit::SetResult {
            kind: ResultKind::Cloud,
            record: Some(record),
        }],
    )
    .unwrap();
    open.save_now().unwrap();
}

#[test]
fn project_never_shows_the_cloud_of_the_previous_one() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::new();
    for (name, points) in [("a", 3), ("b", 5)] {
        let root = folder.path().join(name);
        with_cloud(&root, points);
        perform(&mut session, Command::Open(root)).unwrap();
        assert!(session.cloud().is_none(), "{name}: it is not loaded yet");
        session.settle(|_| std::ops::ControlFlow::Continue(()));
        assert_eq!(session.cloud().unwrap().len(), points, "{name}");
    }
}

#[test]
fn journal_ends_at_a_record_that_does_not_fit() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    let mut made = painted(&root);
    made.save_now().unwrap();
    made.commit(
        "Clear",
        vec![Edit::SetMask {
            frame: 0,
            mask: None,
        }],
    )
    .unwrap();
    let state = made.project().clone();
    made.commit(
        "Clear",
        vec![
            Edit::SetMask {
                frame: 3,
                mask: None,
            },
            Edit::SetMask {
                frame: 4,
                mask: None,
            },
        ],
    )
    .unwrap();
    drop(made);
    let journal = root.join("journal.jsonl");
    let spoilt = fs::read_to_string(&journal)
        .unwrap()
        .replace("\"frame\":4", "\"frame\":44");
    fs::write(&journal, &spoilt).unwrap();
    let loaded = open(&root).unwrap();
    assert_eq!(loaded.project, *state, "half a record is not done");
    assert!(
        loaded.warnings[0].contains("line 2 does not fit the project"),
        "{:?}",
        loaded.warnings
    );
    assert_eq!(
        fs::read_to_string(root.join("journal.jsonl.damaged")).unwrap(),
        spoilt
    );
    assert_eq!(fs::read_to_string(&journal).unwrap().lines().count(), 1);
}

#[test]
fn project_open_for_viewing_rejects_steps_and_keeps_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("p");
    drop(painted(&root));
    let before = snapshot(&root);
    let mut viewed =
        OpenProject::loaded(Folder::view(&root, "it is a copy", &Progress::default()).unwrap());
    let state = viewed.project().clone();
    let error = viewed
        .commit(
            "Clear",
            vec![Edit::SetMask {
                frame: 0,
                mask: None,
            }],
        )
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("it is a copy") && viewed.next_version().is_err() && viewed.undo().is_err(),
        "{error}"
    );
    viewed.publish().unwrap();
    viewed.save_now().unwrap();
    assert_eq!((viewed.project(), snapshot(&root)), (&state, before));
}
