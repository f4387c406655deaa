//! Relabelling of a cloud of a million points of `apc_shelf_rgbd_labels` after one mask changed.
//!
//! Prints wall and CPU seconds and peak memory, for the changed frame only and for a search of all
//! frames for changes. Then measures the program, from a brush stroke to the cloud that a window
//! shows.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench speaks to the user and may panic"
)]

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec2;
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::{ChangedMask, FuseOptions, Views, Votes, fuse, relabel, vote_again};
use ostra_core::job::Progress;
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_masks::{LabelId, LabelMask, LabelTree, MaskFormat};
use ostra_project::FuseRequest;
use ostra_session::{Command, NewProject, PaintRequest, Session};

#[path = "../support/data.rs"]
#[expect(
    dead_code,
    reason = "the benches share it with the integration tests and use a part"
)]
mod data;
#[path = "../support/data_set.rs"]
mod data_set;

const POINTS: u32 = 1_000_000;
const CACHE_BYTES: usize = 64 << 20;
const CHANGED: usize = 7;

fn main() {
    let Ok(data) = data::find_data() else {
        return;
    };
    let set = data.join("apc_shelf_rgbd_labels");
    let mut shelf =
        data_set::DataSet::open(&set, "color", Some("depth"), Some("labels"), CACHE_BYTES);
    let (cloud, votes) = million(&shelf);
    println!(
        "{} points seen by {} frames, peak {} MB",
        cloud.len(),
        votes.frames().count(),
        peak_memory_mb()
    );
    let changed = Arc::new(moved(&shelf.mask(CHANGED).unwrap()));
    let (tree, progress) = (LabelTree::default(), Progress::default());
    for round in 1..=3 {
        let change = [ChangedMask {
            frame: CHANGED,
            mask: Some(Arc::clone(&changed)),
        }];
        timed(&format!("relabel {round}"), || {
            relabel(&cloud, &votes, &change, &tree, &progress).unwrap()
        });
    }
    shelf.masks[CHANGED] = Some(changed);
    timed("vote again", || {
        vote_again(&cloud, &votes, &shelf, &tree, &progress).unwrap()
    });
    drop((cloud, votes, shelf));
    in_the_program(&set);
}

/// Measures a brush stroke and the live vote after it.
fn in_the_program(set: &Path) {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::new();
    let perform = |session: &mut Session, command: Command| {
        session.act(command).unwrap();
        session.settle(|_| ControlFlow::Continue(()));
    };
    let sources = vec![FrameFolder {
        frames: set.join("color"),
        depth: Some(set.join("depth")),
    }];
    let open = OpenRequest {
        sources,
        ..OpenRequest::default()
    };
    let root = folder.path().join("project");
    perform(
        &mut session,
        Command::New(NewProject {
            root,
            open,
            cameras: Some(set.join("sparse")),
            intrinsics: None,
        }),
    );
    perform(
        &mut session,
        Command::ImportMasks {
            dir: set.join("labels"),
            format: MaskFormat::Davis,
        },
    );
    perform(
        &mut session,
        Command::Fuse(FuseRequest {
            voxel: Some(0.0008),
            ..FuseRequest::default()
        }),
    );
    println!(
        "the program's cloud has {} points",
        session.cloud().unwrap().len()
    );
    for round in 1..=3 {
        let points_px = vec![
            DVec2::new(100.0 + 20.0 * f64::from(round), 150.0),
            DVec2::new(400.0, 160.0),
        ];
        let (label, radius_px) = (
            session.project().unwrap().labels.iter().next().unwrap().id,
            12.0,
        );
        let (erase, replace, snap) = (false, true, false);
        let stroke = PaintRequest {
            frame: CHANGED,
            label,
            points_px,
            radius_px,
            erase,
            replace,
            snap,
        };
        let before = Arc::clone(session.cloud().unwrap());
        timed(&format!("stroke {round} to cloud"), || {
            perform(&mut session, Command::Paint(stroke));
            session.follow_masks();
            session.settle(|_| ControlFlow::Continue(()));
        });
        assert!(
            !Arc::ptr_eq(&before, session.cloud().unwrap()),
            "the cloud follows"
        );
    }
}

/// Returns the first million of the shelf's points, with their votes.
fn million(shelf: &data_set::DataSet) -> (LabelledCloud, Votes) {
    let options = FuseOptions {
        voxel: Some(0.0008),
        ..FuseOptions::default()
    };
    let fused = fuse(shelf, &LabelTree::default(), &options, &Progress::default()).unwrap();
    let count = POINTS.min(fused.cloud.len() as u32);
    let points: Vec<u32> = (0..count).collect();
    (fused.cloud.select(&points), fused.votes.select(&points))
}

/// Returns the mask with one object labelled as another.
fn moved(mask: &LabelMask) -> LabelMask {
    let ids = mask
        .ids
        .iter()
        .map(|&id| if id == LabelId(3) { LabelId(4) } else { id })
        .collect();
    LabelMask { ids, ..*mask }
}

fn timed<T>(what: &str, work: impl FnOnce() -> T) {
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let _done = work();
    let (wall, cpu) = (start.elapsed().as_secs_f64(), cpu_seconds() - cpu);
    println!(
        "{what}: {wall:.3} s, {cpu:.2} s of CPU, peak {} MB",
        peak_memory_mb()
    );
}

fn peak_memory_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| {
        line.strip_prefix("VmHWM:")?
            .trim()
            .strip_suffix(" kB")?
            .parse::<u64>()
            .ok()
    });
    peak.unwrap_or(0) >> 10
}

/// Returns the CPU time of this process in seconds.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks: f64 = after_name
        .split_whitespace()
        .skip(11)
        .take(2)
        .filter_map(|t| t.parse::<f64>().ok())
        .sum();
    ticks / 100.0
}
