//! Tests of long videos tracked by flow.
//!
//! Memory does not grow with their length, a stop is quick, and a kill loses nothing that was
//! reported as done.

#![expect(
    clippy::disallowed_methods,
    reason = "these tests watch other processes and measure time"
)]

use ostra_project::TrackerId;
use std::io::{BufRead, BufReader, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, Instant};

use glam::DVec2;
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_masks::LabelId;
use ostra_project::MaskOrigin;
use ostra_session::Event;
use ostra_session::{Command, NewProject, PaintRequest, Session, TrackSettings};

use crate::video::{Making, make_video};

const ROOT: &str = "OSTRA_TEST_TRACKED_ROOT";
const DISK_RADIUS: f64 = 20.0;

/// Returns the centre of the disk on image k; it moves back and forth.
fn centre((width, height): (u32, u32), k: u64) -> DVec2 {
    let (width, height) = (f64::from(width), f64::from(height));
    let phase = k as f64 / 40.0;
    DVec2::new(
        width * (0.5 + 0.3 * phase.sin()),
        height * (0.5 + 0.1 * (1.7 * phase).cos()),
    )
}

/// Returns noise of 0–63 that is a fixed function of the position.
fn grain(x: i64, y: i64) -> u8 {
    let mixed = (x / 3)
        .wrapping_mul(0x9E37_79B1)
        .wrapping_add((y / 3).wrapping_mul(0x85EB_CA77));
    ((mixed ^ (mixed >> 15)).wrapping_mul(0x2C1B_3C6D) >> 20) as u8 & 63
}

/// Returns the image of a red disk, with its own noise, in front of a grey wall.
fn image(size: (u32, u32), k: u64) -> Vec<u8> {
    let centre = centre(size, k);
    let pixel = |at: u32| {
        let (x, y) = (f64::from(at % size.0) + 0.5, f64::from(at / size.0) + 0.5);
        let from = DVec2::new(x, y) - centre;
        if from.length() < DISK_RADIUS {
            let own = grain(from.x.floor() as i64, from.y.floor() as i64);
            [150 + own, 50 + own, 40 + own]
        } else {
            [80 + grain(x as i64, y as i64); 3]
        }
    };
    (0..size.0 * size.1).flat_map(pixel).collect()
}

fn perform(session: &mut Session, command: Command) {
    session.act(command).unwrap();
    let events = session.settle(|_| ControlFlow::Continue(()));
    assert!(
        !events
            .iter()
            .any(|event| matches!(event, Event::Failed { .. })),
        "{events:?}"
    );
}

/// Creates a project on a new video, with the disk painted on the keyframe `anchor`.
fn project(folder: &Path, size: (u32, u32), count: u64, keyframe: u64) -> PathBuf {
    let video = folder.join("film.mp4");
    let options = "-c:v libx264 -preset ultrafast -crf 20 -pix_fmt yuv420p";
    make_video(
        &video,
        &Making {
            size,
            pixels: "rgb24",
            count,
            options,
        },
        |k| image(size, k),
    );
    let root = folder.join("project");
    let open = OpenRequest {
        sources: vec![FrameFolder::from(video)],
        ..OpenRequest::default()
    };
    let mut session = Session::new();
    perform(
        &mut session,
        Command::New(NewProject {
            root: root.clone(),
            open,
            cameras: None,
            intrinsics: None,
        }),
    );
    assert_eq!(session.project().unwrap().frames.len() as u64, count);
    perform(
        &mut session,
        Command::AddLabel {
            name: "disk".into(),
            parent: None,
            color: None,
        },
    );
    let points_px = vec![centre(size, keyframe)];
    let (frame, label, radius_px) = (keyframe as usize, LabelId(1), DISK_RADIUS);
    let paint = PaintRequest {
        frame,
        label,
        points_px,
        radius_px,
        erase: false,
        replace: true,
        snap: false,
    };
    perform(&mut session, Command::Paint(paint));
    root
}

fn opened(root: &Path) -> Session {
    let mut session = Session::new();
    perform(&mut session, Command::Open(root.to_owned()));
    session
}

fn track() -> Command {
    Command::Track(TrackSettings {
        tracker: TrackerId::Flow,
        ..TrackSettings::default()
    })
}

/// Returns a line of `/proc/PID/status` in KiB; `None` once the process has ended.
#[cfg(target_os = "linux")]
fn memory_kib(process: u32, line: &str) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|text| text.strip_prefix(line))?;
    line.trim_start_matches(':')
        .trim()
        .trim_end_matches(" kB")
        .parse()
        .ok()
}

/// Checks that the memory of the last third of the video is that of the second third.
///
/// The images are wide and low: a third of the video exceeds the cache of 256 MiB, and there is
/// little to track, so that 3,000 frames take no longer than about a minute.
#[cfg(target_os = "linux")]
fn memory_does_not_grow_over_three_thousand_frames() {
    const SIZE: (u32, u32) = (1280, 72);
    const COUNT: u64 = 3000;
    let folder = tempfile::tempdir().unwrap();
    let root = project(folder.path(), SIZE, COUNT, 0);
    let mut process = Process::new(env!("CARGO_BIN_EXE_ostra"));
    process
        .arg("track")
        .arg(&root)
        .args(["--tracker", "flow"])
        .stderr(Stdio::null());
    let mut child = process.spawn().unwrap();
    let begun = Instant::now();
    let (mut used, mut peak) = (Vec::new(), 0);
    while child.try_wait().unwrap().is_none() {
        used.extend(memory_kib(child.id(), "VmRSS"));
        peak = memory_kib(child.id(), "VmHWM").unwrap_or(peak);
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(child.wait().unwrap().success());
    let most = |part: &[u64]| part.iter().max().copied().unwrap_or_default() / 1024;
    let third = used.len() / 3;
    let (second, last) = (most(&used[third..2 * third]), most(&used[2 * third..]));
    let took = begun.elapsed();
    println!(
        "{COUNT} frames: peak {} MiB; second third {second}, last third {last} MiB; {took:.0?}",
        peak / 1024
    );
    assert!(peak / 1024 < 1500, "{peak} KiB");
    assert!(
        last < second + 64,
        "it grows: {second} MiB in the second third, {last} MiB in the last"
    );
    let session = opened(&root);
    let masks = &session.project().unwrap().masks;
    assert_eq!(masks.len() as u64, COUNT);
}

fn stop_works_at_any_point_of_a_run() {
    const SIZE: (u32, u32) = (640, 360);
    let folder = tempfile::tempdir().unwrap();
    // Tracking starts in the middle in both directions, so that stops hit forward and backward
    // passes.
    let root = project(folder.path(), SIZE, 40, 20);
    let mut session = opened(&root);
    let mut waits: Vec<Duration> = (0..9)
        .map(|turn| stopped_after(&mut session, 150 * turn))
        .collect();
    waits.sort();
    println!("stops answered after {waits:?}");
}

/// Returns how long a run takes to stop when it is stopped after `ms`.
fn stopped_after(session: &mut Session, ms: u64) -> Duration {
    session.act(track()).unwrap();
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_millis(ms) {
        session.poll();
        std::thread::sleep(Duration::from_millis(2));
    }
    let requested = Instant::now();
    session.act(Command::Stop).unwrap();
    loop {
        let events = session.poll();
        if events
            .iter()
            .any(|event| matches!(event, Event::Stopped { .. }))
        {
            return requested.elapsed();
        }
        assert!(
            !events
                .iter()
                .any(|event| matches!(event, Event::Finished { .. })),
            "done before it was stopped"
        );
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Interrupts the program as a terminal does.
#[cfg(unix)]
fn interrupt_exits_with_130_and_keeps_finished_frames() {
    let folder = tempfile::tempdir().unwrap();
    let root = project(folder.path(), (320, 180), 400, 0);
    let mut process = Process::new(env!("CARGO_BIN_EXE_ostra"));
    process
        .arg("track")
        .arg(&root)
        .args(["--tracker", "flow"])
        .stderr(Stdio::piped());
    let written = || std::fs::metadata(root.join("journal.jsonl")).map_or(0, |file| file.len());
    let before = written();
    let mut child = process.spawn().unwrap();
    while written() <= before && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(20));
    }
    let requested = Instant::now();
    assert!(
        Process::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status()
            .unwrap()
            .success()
    );
    let code = child.wait().unwrap().code();
    println!("ended {:?} after the interrupt", requested.elapsed());
    assert_eq!(code, Some(130));
    let session = opened(&root);
    let masks = &session.project().unwrap().masks;
    let tracked: Vec<usize> = masks.keys().copied().filter(|&frame| frame > 0).collect();
    assert!(
        !tracked.is_empty() && tracked.len() < 399,
        "{}",
        tracked.len()
    );
    assert_eq!(
        tracked,
        (1..=tracked.len()).collect::<Vec<_>>(),
        "without a hole"
    );
}

/// Runs the child process, which tracks and prints the safe frames.
///
/// Does nothing unless the parent asks for it.
fn child() {
    let Some(root) = std::env::var_os(ROOT) else {
        return;
    };
    let mut session = opened(Path::new(&root));
    session.act(track()).unwrap();
    let mut out = std::io::stdout();
    loop {
        let events = session.poll();
        let masks = &session.project().unwrap().masks;
        let done = masks
            .iter()
            .filter(|(_, mask)| mask.origin == MaskOrigin::Tracked)
            .map(|(frame, _)| frame);
        let done: Vec<String> = done.map(ToString::to_string).collect();
        writeln!(out, "safe {}", done.join(" ")).unwrap();
        if events
            .iter()
            .any(|event| matches!(event, Event::Finished { .. }))
        {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Lets a child track until `enough` frames are safe and kills it; returns the last printed frames.
fn killed_at(root: &Path, enough: usize) -> Vec<usize> {
    let exe = std::env::current_exe().unwrap();
    let args = [
        "long_videos::child",
        "--exact",
        "--nocapture",
        "--test-threads",
        "1",
    ];
    let mut process = Process::new(exe);
    let mut child: Child = process
        .args(args)
        .env(ROOT, root)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut safe = Vec::new();
    for line in BufReader::new(child.stdout.take().unwrap()).lines() {
        let line = line.unwrap();
        let Some((_, frames)) = line.split_once("safe ") else {
            continue;
        };
        safe = frames
            .split_whitespace()
            .map(|frame| frame.parse().unwrap())
            .collect();
        if safe.len() >= enough {
            break;
        }
    }
    child.kill().unwrap();
    child.wait().unwrap();
    safe
}

fn kill_while_tracking_keeps_every_finished_frame() {
    const COUNT: usize = 120;
    let folder = tempfile::tempdir().unwrap();
    let root = project(folder.path(), (320, 180), COUNT as u64, 60);
    let mask_count = || opened(&root).project().unwrap().masks.len();
    assert_eq!(mask_count(), 1);
    let killed = [10, 30, 75].map(|enough| {
        let safe = killed_at(&root, enough);
        assert!(
            (enough..COUNT - 1).contains(&safe.len()),
            "{} of {enough}",
            safe.len()
        );
        let mut session = opened(&root);
        let masks = session.project().unwrap().masks.clone();
        assert!(
            safe.iter().all(|frame| masks.contains_key(frame)),
            "frames that were done are lost: {safe:?}"
        );
        session.act(Command::Undo).unwrap();
        assert_eq!(
            session.project().unwrap().masks.len(),
            1,
            "the run is one step"
        );
        session.save().unwrap();
        masks
    });
    let mut session = opened(&root);
    perform(&mut session, track());
    let whole = &session.project().unwrap().masks;
    assert_eq!(whole.len(), COUNT);
    for masks in killed {
        assert!(
            masks
                .iter()
                .all(|(frame, mask)| mask.runs == whole[frame].runs),
            "the same as of a whole run"
        );
    }
}

crate::registry::tests! {
    Ffmpeg =>
        memory_does_not_grow_over_three_thousand_frames,
        stop_works_at_any_point_of_a_run,
        interrupt_exits_with_130_and_keeps_finished_frames,
        kill_while_tracking_keeps_every_finished_frame;
    Nothing => child;
}
