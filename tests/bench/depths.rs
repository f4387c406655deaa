//! CPU stereo of real images with their ground-truth cameras, as a user runs it.
//!
//! Prints seconds per view, peak memory, and the completeness of the fused cloud over the set's
//! reference points that at least three views see.
//!
//! `cargo bench --bench depths [-- dtu fountain temple full]`, by default all; `full` is the
//! fountain at full size.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "a bench speaks to the user, may panic, and waits for the program"
)]

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

#[path = "../support/data.rs"]
#[expect(
    dead_code,
    reason = "the benches share it with the integration tests and use a part"
)]
mod data;

/// Images of a data set, and how they are measured.
struct Set {
    name: &'static str,
    folder: &'static str,
    /// Number of images, from the first on.
    views: u32,
    /// Longer side in pixels.
    side: u32,
    /// Distances in units of the reference; the share in depth uses the last.
    within: &'static str,
}

const SETS: [Set; 4] = [
    Set {
        name: "dtu",
        folder: "dtu_scan24",
        views: 12,
        side: 640,
        within: "1,2,3",
    },
    Set {
        name: "fountain",
        folder: "strecha_fountain_P11",
        views: 11,
        side: 640,
        within: "0.01,0.02,0.05,0.03",
    },
    Set {
        name: "temple",
        folder: "middlebury_templeSparseRing",
        views: 16,
        side: 640,
        within: "",
    },
    Set {
        name: "full",
        folder: "strecha_fountain_P11",
        views: 11,
        side: 1536,
        within: "0.01,0.02,0.05,0.03",
    },
];

fn main() {
    let Ok(data) = data::find_data() else {
        return;
    };
    let is_named = |set: &Set| std::env::args().any(|word| word == set.name);
    let is_any_named = SETS.iter().any(is_named);
    for set in SETS.iter().filter(|set| !is_any_named || is_named(set)) {
        let dir = TempDir::new().unwrap();
        let (folder, root) = (data.join(set.folder), dir.path().join("project"));
        let (root, last) = (root.to_str().unwrap(), (set.views - 1).to_string());
        let (images, cameras) = (folder.join("images"), folder.join("sparse"));
        let given = ["--cameras", cameras.to_str().unwrap(), "--to", &last];
        done(
            &[
                &["new", root, "--frames", images.to_str().unwrap()][..],
                &given,
            ]
            .concat(),
        );
        let side = set.side.to_string();
        let begun = Instant::now();
        let peak = peak_mib(&[
            "reconstruct",
            root,
            "--method",
            "mvs",
            "--max-side",
            &side,
            "--device",
            "cpu",
        ]);
        let seconds = begun.elapsed().as_secs_f64();
        println!(
            "{}: {:.2} s a view, peak {peak} MiB",
            set.name,
            seconds / f64::from(set.views)
        );
        let reference = folder.join("sparse_reference.ply");
        if reference.is_file() {
            score(root, dir.path(), &reference, set.within);
        }
    }
}

/// Prints the completeness and accuracy of the fused cloud.
fn score(root: &str, dir: &Path, reference: &Path, within: &str) {
    let (cloud, cameras) = (dir.join("cloud.ply"), dir.join("cameras"));
    let (cloud, cameras, reference) = (
        cloud.to_str().unwrap(),
        cameras.to_str().unwrap(),
        reference.to_str().unwrap(),
    );
    done(&["fuse", root]);
    done(&["export", root, "--cloud", cloud, "--cameras", cameras]);
    let seen = [
        "--cameras",
        cameras,
        "--min-views",
        "3",
        "--frames",
        root,
        "--within",
        within,
        "--json",
    ];
    let output = done(
        &[
            &["eval", "cloud", "--truth", reference, "--result", cloud][..],
            &seen,
        ]
        .concat(),
    );
    let score: Value = serde_json::from_str(output.lines().last().unwrap()).unwrap();
    println!("  {} points", score["result_points"]);
    for at in score["surface"].as_array().unwrap() {
        let share = |name: &str| 100.0 * at[name].as_f64().unwrap();
        println!(
            "  within {}: complete {:.1} %, in depth {:.1} %",
            at["within"],
            share("completeness"),
            share("in_depth")
        );
    }
}

/// Runs the program and returns its standard output.
fn done(args: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(args)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{args:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// Runs the program and returns its peak memory in MiB, or 0 if the system does not report it.
fn peak_mib(args: &[&str]) -> u64 {
    let mut program = Command::new(env!("CARGO_BIN_EXE_ostra"));
    let mut child = program
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let kib = |line: &str| {
            line.strip_prefix("VmHWM:")?
                .trim()
                .strip_suffix(" kB")?
                .parse::<u64>()
                .ok()
        };
        peak = text.lines().find_map(kib).unwrap_or(peak);
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(child.wait().unwrap().success(), "{args:?} failed");
    peak / 1024
}
