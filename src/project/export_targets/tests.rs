use super::*;

#[test]
fn unchanged_exports_are_replaced_but_changed_and_foreign_files_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let (mine, notes) = (dir.path().join("a.csv"), dir.path().join("notes.txt"));
    let check = |overwrite: bool, file: &Path| {
        ExportTargets {
            overwrite,
            ..ExportTargets::default()
        }
        .check_files([file])
    };
    check(false, &mine).unwrap();
    ExportTargets::write_files(std::slice::from_ref(&mine), || {
        Ok(fs::write(&mine, "exported")?)
    })
    .unwrap();
    check(false, &mine).unwrap();
    fs::write(&mine, "exported, and a column of remarks").unwrap();
    assert!(
        check(false, &mine)
            .unwrap_err()
            .to_string()
            .contains("--overwrite")
    );
    check(true, &mine).unwrap();
    fs::write(&notes, "mine").unwrap();
    for overwrite in [false, true] {
        let error = check(overwrite, &notes).unwrap_err().to_string();
        assert!(error.contains("not a known export"), "{error}");
    }
    assert!(check(true, dir.path()).is_err());
}

#[test]
fn folders_with_foreign_files_are_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("masks");
    let targets = ExportTargets::default();
    targets.check_folder(&folder).unwrap();
    fs::create_dir_all(folder.join("below")).unwrap();
    targets.check_folder(&folder).unwrap();
    let write = || Ok(fs::write(folder.join("below/0.png"), "mask")?);
    ExportTargets::write_all(&[], std::slice::from_ref(&folder), write).unwrap();
    targets.check_folder(&folder).unwrap();
    fs::write(folder.join("mine.txt"), "mine").unwrap();
    let overwrite = ExportTargets {
        overwrite: true,
        ..ExportTargets::default()
    };
    assert!(
        overwrite
            .check_folder(&folder)
            .unwrap_err()
            .to_string()
            .contains("1 file that OSTRA did not export")
    );
}

#[test]
fn files_left_by_an_interrupted_export_are_replaced_on_request() {
    let dir = tempfile::tempdir().unwrap();
    let (file, folder) = (dir.path().join("c.ply"), dir.path().join("masks"));
    let names = ([file.clone()], [folder.clone()]);
    begin(&names.0, &names.1).unwrap();
    fs::write(&file, "cloud").unwrap();
    fs::write(folder.join("0.png"), "mask").unwrap();
    for overwrite in [false, true] {
        let targets = ExportTargets {
            overwrite,
            ..ExportTargets::default()
        };
        assert_eq!(targets.check_files([file.as_path()]).is_ok(), overwrite);
        assert_eq!(targets.check_folder(&folder).is_ok(), overwrite);
    }
}

#[test]
fn files_written_by_a_failed_export_are_recorded_and_others_are_not() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let files = [path("c.ply"), path("c_stem.ply")];
    let folders = [path("masks")];
    let failed = ExportTargets::write_all(&files, &folders, || -> Result<()> {
        fs::write(&files[0], "cloud")?;
        fs::write(folders[0].join("0.png"), "mask")?;
        bail!("no space")
    });
    assert_eq!(failed.unwrap_err().to_string(), "no space");
    let targets = ExportTargets::default();
    targets
        .check_files(files.iter().map(PathBuf::as_path))
        .unwrap();
    targets.check_folder(&folders[0]).unwrap();
    fs::write(&files[1], "the user's").unwrap();
    fs::write(folders[0].join("notes.txt"), "the user's").unwrap();
    let overwrite = ExportTargets {
        overwrite: true,
        ..targets
    };
    assert!(overwrite.check_files([files[1].as_path()]).is_err());
    assert!(overwrite.check_folder(&folders[0]).is_err());
}

#[test]
fn files_of_an_earlier_export_are_removed_from_the_folder() {
    let dir = tempfile::tempdir().unwrap();
    let folders = [dir.path().join("model")];
    let write = |names: &[&str]| {
        let write = || {
            Ok(names
                .iter()
                .try_for_each(|name| disk::write(&folders[0].join(name), b"model"))?)
        };
        ExportTargets::write_all(&[], &folders, write).unwrap().1
    };
    assert!(write(&["cameras.bin", "images.bin", "project.ini"]).is_empty());
    let warnings = write(&["cameras.txt", "images.txt", "project.ini"]);
    assert!(
        warnings.len() == 1 && warnings[0].contains("2 files"),
        "{warnings:?}"
    );
    let names: Vec<_> = files_below(&folders[0])
        .unwrap()
        .iter()
        .map(|file| file.file_name().unwrap().to_owned())
        .collect();
    assert_eq!(names, ["cameras.txt", "images.txt", "project.ini"]);
    ExportTargets::default().check_folder(&folders[0]).unwrap();
}

#[test]
fn two_outputs_with_the_same_name_are_rejected() {
    let (a, b) = (Path::new("/out/Leaf.ply"), Path::new("/out/leaf.ply"));
    assert!(
        ExportTargets::default()
            .check_files([a, b])
            .unwrap_err()
            .to_string()
            .contains("same file")
    );
}

#[test]
fn targets_inside_a_project_are_rejected_by_any_path() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path().join("project");
    fs::create_dir(&root).unwrap();
    fs::write(root.join("project.toml"), "").unwrap();
    let targets = ExportTargets {
        root: Some(root.canonicalize().unwrap()),
        ..ExportTargets::default()
    };
    for inside in [
        "project/c.ply",
        "project/new/c.ply",
        "other/../project/c.ply",
    ] {
        let error = targets
            .check_files([dir.path().join(inside).as_path()])
            .unwrap_err()
            .to_string();
        assert!(error.contains("inside the project folder"), "{error}");
    }
    targets
        .check_files([dir.path().join("c.ply").as_path()])
        .unwrap();
    assert!(
        ExportTargets::default()
            .check_folder(&root.join("masks"))
            .is_err(),
        "another project's folder"
    );
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&root, dir.path().join("link")).unwrap();
        assert!(
            targets
                .check_files([dir.path().join("link/c.ply").as_path()])
                .is_err()
        );
    }
}
