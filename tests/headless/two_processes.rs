//! Tests of processes that write to the same place at the same time.

use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use super::recording::Recording;
use crate::program::{done, refused};

/// Runs the commands at the same time; returns their exit codes and standard error outputs.
fn together(commands: &[Vec<&str>]) -> Vec<(Option<i32>, String)> {
    let start = |args: &Vec<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ostra"));
        command
            .args(args)
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY");
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    };
    let running: Vec<_> = commands.iter().map(start).collect();
    let ended = running
        .into_iter()
        .map(|child| child.wait_with_output().unwrap());
    ended
        .map(|output| {
            (
                output.status.code(),
                String::from_utf8_lossy(&output.stderr).into_owned(),
            )
        })
        .collect()
}

#[test]
fn only_one_of_several_processes_creates_the_project() {
    let recording = Recording::new();
    fs::create_dir(recording.path("fewer")).unwrap();
    for name in ["0.png", "1.png"] {
        fs::copy(
            recording.path("color") + "/" + name,
            recording.path("fewer") + "/" + name,
        )
        .unwrap();
    }
    let folders = [recording.path("color"), recording.path("fewer")];
    for round in 0..6 {
        // The parent folder is missing, too; a slower process must not remove it.
        let project = recording.path(&format!("above-{round}/project"));
        let command = |frames| vec!["new", project.as_str(), "--frames", frames];
        let commands: Vec<Vec<&str>> = (0..4)
            .map(|number| command(folders[number % 2].as_str()))
            .collect();
        let ended = together(&commands);
        let made: Vec<usize> = (0..4)
            .filter(|&number| ended[number].0 == Some(0))
            .collect();
        assert_eq!(made.len(), 1, "round {round}: {ended:?}");
        for (_, message) in ended.iter().filter(|(code, _)| *code != Some(0)) {
            let is_clear = [
                "already holds a project",
                "is not empty",
                "is open in another",
            ];
            assert!(
                is_clear.iter().any(|words| message.contains(words)),
                "{message}"
            );
        }
        let info: Value = serde_json::from_str(&done(&["info", &project, "--json"])).unwrap();
        let frames = info["frames"].as_array().unwrap().len();
        assert_eq!(
            frames,
            if made[0].is_multiple_of(2) { 4 } else { 2 },
            "the frames of the one that made it"
        );
    }
}

#[test]
fn export_to_a_place_in_use_is_refused_until_the_other_ends() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["fuse", &project, "--voxel", "0.02"]);
    done(&["label", &project, "thing"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    let (cloud, masks) = (recording.path("out/c.ply"), recording.path("out/masks"));
    fs::create_dir_all(&masks).unwrap();
    // A running export holds a locked list of its files.
    let claim = |folder: &str, names: &str| {
        let path = Path::new(folder).join(".ostra-exporting.other.tmp");
        fs::write(&path, names).unwrap();
        let file = File::options().write(true).open(path).unwrap();
        file.lock().unwrap();
        file
    };
    let of_cloud = claim(&recording.path("out"), r#"["c.ply"]"#);
    let of_masks = claim(&masks, r#"[""]"#);
    for overwrite in [&[][..], &["--overwrite"]] {
        let message = refused(&[&["export", &project, "--cloud", &cloud], overwrite].concat());
        assert!(
            message.contains("another export writes here now"),
            "{message}"
        );
    }
    let message = refused(&["masks", &project, "export", &masks]);
    assert!(
        message.contains("another export writes here now"),
        "{message}"
    );
    done(&["export", &project, "--mesh", &recording.path("out/m.ply")]);
    drop((of_cloud, of_masks));
    done(&["export", &project, "--cloud", &cloud]);
    done(&["masks", &project, "export", &masks]);
    let left: Vec<_> = fs::read_dir(recording.path("out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    assert!(
        left.iter()
            .all(|name| !name.to_string_lossy().ends_with(".tmp")),
        "{left:?}"
    );
}

#[test]
fn exports_to_different_files_run_concurrently() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["fuse", &project, "--voxel", "0.02"]);
    let clouds: Vec<String> = (0..4)
        .map(|number| recording.path(&format!("out/{number}.ply")))
        .collect();
    let commands: Vec<Vec<&str>> = clouds
        .iter()
        .map(|cloud| vec!["export", project.as_str(), "--cloud", cloud.as_str()])
        .collect();
    for _ in 0..3 {
        // From the second round on, each export finds its own entry in the shared record.
        let ended = together(&commands);
        assert!(ended.iter().all(|(code, _)| *code == Some(0)), "{ended:?}");
    }
}
