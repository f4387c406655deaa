//! Tests that jobs stop promptly, keep what they finished, and use bounded memory.

use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use ostra_cloud::ply::read_ply;
use ostra_core::disk::is_temporary;
use ostra_core::job::Progress;
use serde_json::{Value, json};

use super::recording::Recording;
use crate::program::{contents, done, refused};

/// Returns a project with masks, a cloud and a surface.
fn fused(recording: &Recording) -> String {
    let project = recording.project();
    done(&["label", &project, "thing", "--color", "#d02818"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    done(&["fuse", &project, "--voxel", "0.004"]);
    project
}

fn start(args: &[&str], folder: &Path) -> Child {
    Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(args)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

#[cfg(unix)]
fn interrupt(child: &Child) {
    assert!(
        Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status()
            .unwrap()
            .success()
    );
}

#[expect(
    clippy::disallowed_methods,
    reason = "a moment in the middle of another process's work"
)]
fn pause(milliseconds: u64) {
    std::thread::sleep(Duration::from_millis(milliseconds));
}

/// Returns whether an interrupted process ended correctly: by itself before, or with exit code 130.
///
/// A signal that arrives before the program watches for it ends the process. A shell reports that
/// as 130, too.
#[cfg(unix)]
fn is_stopped_or_done(status: ExitStatus) -> bool {
    use std::os::unix::process::ExitStatusExt;
    matches!(status.code(), Some(0 | 130)) || status.signal() == Some(2)
}

fn temporary_files(folder: &Path) -> Vec<String> {
    let all = contents(folder).into_iter().map(|(path, _)| path);
    all.filter(|path| path.iter().any(is_temporary))
        .map(|path| path.display().to_string())
        .collect()
}

/// Returns commands that read or change a project; the first and the last take longest.
#[cfg(unix)]
fn interrupted_commands<'a>(
    project: &'a str,
    cloud: &'a str,
    masks: &'a str,
) -> [Vec<&'a str>; 13] {
    [
        vec!["shot", project, "a.png", "--size", "8192x8192"],
        vec![
            "shot",
            project,
            "b.png",
            "--model",
            "voxels",
            "--size",
            "4096x4096",
        ],
        vec![
            "shot",
            project,
            "c.png",
            "--model",
            "mesh",
            "--size",
            "4096x4096",
        ],
        vec!["export", project, "--voxels", "v.npz", "--solid"],
        vec![
            "export",
            project,
            "--cloud",
            "d.ply",
            "--mesh",
            "d.glb",
            "--depths",
            "depths",
            "--undistorted",
            "flat",
        ],
        vec!["export", project, "--traits", "t.csv"],
        vec![
            "eval", "cloud", "--truth", cloud, "--result", cloud, "--within", "0.01",
        ],
        vec!["eval", "masks", "--truth", masks, "--result", masks],
        vec!["masks", project, "import", masks],
        vec!["fuse", project, "--voxel", "0.003"],
        vec!["doubt", project],
        vec!["info", project],
        vec![
            "demo",
            "demo",
            "--headless",
            "--frames",
            "6",
            "--size",
            "96x128",
        ],
    ]
}

/// Interrupts a command after some milliseconds; returns whether that stopped it.
#[cfg(unix)]
fn is_stopped_after(command: &[&str], folder: &Path, moment: u64) -> bool {
    let mut child = start(command, folder);
    pause(moment);
    interrupt(&child);
    let mut text = String::new();
    child
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut text)
        .unwrap();
    let status = child.wait().unwrap();
    assert!(
        is_stopped_or_done(status),
        "{command:?} after {moment} ms: {status:?} {text}"
    );
    let stopped = status.code() == Some(130);
    assert!(
        !stopped || text.contains("ostra: stopped"),
        "{command:?}: {text}"
    );
    stopped
}

#[cfg(unix)]
#[test]
fn interrupted_command_ends_and_leaves_only_complete_files() {
    let recording = Recording::new();
    let project = fused(&recording);
    let (cloud, masks) = (recording.path("truth.ply"), recording.path("truth-masks"));
    done(&["export", &project, "--cloud", &cloud, "--masks", &masks]);
    let scratch = recording.path("scratch");
    std::fs::create_dir(&scratch).unwrap();
    let commands = interrupted_commands(&project, &cloud, &masks);
    for (number, command) in commands.into_iter().enumerate() {
        let mut stopped = 0;
        for moment in [0, 60, 250] {
            stopped += usize::from(is_stopped_after(&command, Path::new(&scratch), moment));
            done(&["info", &project]);
        }
        // The largest image and the whole demo take longer than the last moment.
        assert!(
            stopped > 0 || !matches!(number, 0 | 12),
            "{command:?} went on after every interrupt"
        );
    }
    done(&["export", &project, "--cloud", &recording.path("after.ply")]);
    assert_eq!(
        temporary_files(Path::new(&recording.path(""))),
        [] as [String; 0]
    );
}

/// Checks that a pipe instead of an image is refused.
///
/// An untrusted project can name a pipe that has no writer: reading it would wait forever.
#[cfg(unix)]
#[test]
fn pipe_instead_of_an_image_is_refused() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    let pipe = recording.path("color/1.png");
    std::fs::remove_file(&pipe).unwrap();
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let message = refused(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    assert!(
        message.contains("1.png") && message.contains("a named pipe"),
        "{message}"
    );
}

/// A project and a fake ffmpeg that writes half a video and keeps running.
///
/// `make` starts a turntable with it.
#[cfg(unix)]
struct Video {
    recording: Recording,
    project: String,
    programs: String,
    id: String,
}

#[cfg(unix)]
impl Video {
    fn new() -> Self {
        use std::os::unix::fs::PermissionsExt;
        let recording = Recording::new();
        let (project, programs, id) = (
            fused(&recording),
            recording.path("programs"),
            recording.path("id"),
        );
        std::fs::create_dir(&programs).unwrap();
        let ffmpeg = format!("{programs}/ffmpeg");
        // The last argument is the file that ffmpeg writes.
        let script = "#!/bin/sh\nfor last; do :; done\necho half > \"${last#file:}\"\n";
        let script =
            format!("{script}echo $$ > '{id}.new'; mv '{id}.new' '{id}'\nexec sleep 600\n");
        std::fs::write(&ffmpeg, script).unwrap();
        std::fs::set_permissions(&ffmpeg, std::fs::Permissions::from_mode(0o755)).unwrap();
        Self {
            recording,
            project,
            programs,
            id,
        }
    }

    /// Starts a turntable and waits until ffmpeg writes.
    fn make(&self) -> Child {
        let path = format!(
            "{}:{}",
            self.programs,
            std::env::var("PATH").unwrap_or_default()
        );
        let mut child = Command::new(env!("CARGO_BIN_EXE_ostra"))
            .args(["shot", &self.project, &self.recording.path("s.png")])
            .args([
                "--turntable",
                &self.recording.path("t.mp4"),
                "--size",
                "640x480",
                "--seconds",
                "60",
            ])
            .env("PATH", path)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while !Path::new(&self.id).exists() {
            assert!(
                child.try_wait().unwrap().is_none(),
                "it ended before it made a video"
            );
            pause(10);
        }
        child
    }

    fn temporary_files(&self) -> Vec<String> {
        temporary_files(Path::new(&self.recording.path("")))
    }
}

/// Checks that a helper program that keeps running ends with the process that started it.
#[cfg(unix)]
#[test]
fn helper_programs_end_with_the_command() {
    let video = Video::new();
    let mut child = video.make();
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let id = std::fs::read_to_string(&video.id).unwrap();
    let state = Command::new("ps")
        .args(["-o", "stat=", "-p", id.trim()])
        .output()
        .unwrap();
    let state = String::from_utf8_lossy(&state.stdout).trim().to_owned();
    assert!(
        state.is_empty() || state.starts_with('Z'),
        "ffmpeg is still there: {state}"
    );
    assert_eq!(video.temporary_files(), [] as [String; 0]);
    assert!(!Path::new(&video.recording.path("t.mp4")).exists());
}

#[cfg(unix)]
#[test]
fn next_export_removes_files_of_a_killed_video() {
    let video = Video::new();
    let mut child = video.make();
    child.kill().unwrap();
    child.wait().unwrap();
    let id = std::fs::read_to_string(&video.id).unwrap();
    assert!(
        Command::new("kill")
            .args(["-KILL", id.trim()])
            .status()
            .unwrap()
            .success()
    );
    assert!(!video.temporary_files().is_empty());
    done(&[
        "shot",
        &video.project,
        &video.recording.path("again.png"),
        "--size",
        "64x64",
    ]);
    assert_eq!(video.temporary_files(), [] as [String; 0]);
}

fn recipe(recording: &Recording, project: &str, command: &Value) -> String {
    let path = recording.path("recipe.json");
    let recipe = json!({ "format": 1, "commands": [{ "open": project }, command] });
    std::fs::write(&path, recipe.to_string()).unwrap();
    path
}

/// Strokes of a recipe far outside the frame once filled the memory.
#[test]
fn recipes_with_numbers_out_of_range_are_refused() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    let mut commands = Vec::new();
    for far in [4_294_967_296.0, 1e13, -1e300] {
        let points = json!([[5.0, far], [30.0, 40.0]]);
        for (radius, snap) in [(4.0, true), (4.0, false), (0.0, false)] {
            commands.push(
                json!({ "paint": { "frame": 1, "label": 1, "points_px": points, "radius_px": radius,
                "erase": false, "replace": true, "snap": snap } }),
            );
        }
        commands.push(json!({ "trace": { "frame": 1, "label": 1, "points_px": points } }));
        commands.push(
            json!({ "pull": { "frame": 1, "label": 1, "from_px": [1.0, 1.0], "to_px": [1.0, far],
            "replace": true } }),
        );
        let prompt = json!({ "clicks": [{ "at_px": [far, 3.0], "include": true }] });
        commands.push(json!({ "prompt": { "frame": 1, "label": 1, "prompt": prompt, "segmenter": "builtin" } }));
    }
    let count = commands.len();
    for command in commands {
        let message = refused(&["run", &recipe(&recording, &project, &command)]);
        assert!(
            message.contains("too far outside frame 1 (64x48)"),
            "{command}: {message}"
        );
    }
    assert_eq!(count, 18);
    let stroke = |radius: f64| {
        json!({ "paint": { "frame": 1, "label": 1, "points_px": [[5.0, 5.0]], "radius_px": radius, "erase": false,
            "replace": true, "snap": true } })
    };
    for (command, range) in [
        (stroke(1e13), "0 to 100000"),
        (json!({ "fuse": { "voxel": -1.0 } }), "above 0"),
        (
            json!({ "track": { "tracker": "geometry", "short_side": 4_000_000_000u32 } }),
            "64 to 4096",
        ),
        (
            json!({ "paint": { "frame": 99, "label": 1, "points_px": [[5.0, 5.0]], "radius_px": 3.0, "erase": false,
            "replace": true } }),
            "99",
        ),
    ] {
        let message = refused(&["run", &recipe(&recording, &project, &command)]);
        assert!(message.contains(range), "{command}: {message}");
    }
    // A stroke may leave the image.
    let command = json!({ "paint": { "frame": 1, "label": 1, "points_px": [[5.0, 900.0], [30.0, 40.0]],
        "radius_px": 4.0, "erase": false, "replace": true, "snap": true } });
    done(&["run", &recipe(&recording, &project, &command)]);
}

#[test]
fn fusion_reports_the_chosen_voxel_size() {
    let recording = Recording::new();
    let project = recording.project();
    let message = done(&["fuse", &project]);
    // The wall is 2 m away and the focal length is 60 px; all four frames see nearly the same
    // region.
    assert!(
        message.contains("voxel 0.033 (chosen: a pixel covers 0.033"),
        "{message}"
    );
    assert!(
        message.contains("a place is seen by 4 frames") && message.contains("surface voxel 0.033"),
        "{message}"
    );
    let cloud = recording.path("cloud.ply");
    done(&["export", &project, "--cloud", &cloud]);
    let points = read_ply(Path::new(&cloud), &Progress::default())
        .unwrap()
        .cloud
        .len();
    assert!(
        message.contains(&format!("fused {points} points")),
        "{message}"
    );
    let given = done(&["fuse", &project, "--voxel", "0.05"]);
    assert!(
        given.contains("voxel 0.05") && !given.contains("chosen"),
        "{given}"
    );
}
