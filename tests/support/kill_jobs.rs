//! Kills the program in the middle of every kind of long job.
//!
//! The project must keep its data, and each output of a job must be complete or absent. The quick
//! tests kill a few kinds once, the accuracy tests every kind.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::Value;
use tempfile::TempDir;

/// A kind of job: its name and its command line.
///
/// In the arguments, `P` stands for the project of an RGB-D recording, `Q` for one of its images
/// alone, `R` for the recording and `O` for a folder of outputs.
pub struct Job {
    pub name: &'static str,
    args: &'static [&'static str],
}

pub const JOBS: [Job; 14] = [
    Job {
        name: "prompt",
        args: &[
            "prompt", "P", "--frame", "3", "--label", "rice", "--click", "48,64",
        ],
    },
    Job {
        name: "track by flow",
        args: &["track", "P", "--tracker", "flow"],
    },
    Job {
        name: "track by geometry",
        args: &["track", "P", "--tracker", "geometry"],
    },
    Job {
        name: "stereo",
        args: &["reconstruct", "Q", "--method", "mvs"],
    },
    Job {
        name: "registration",
        args: &["reconstruct", "P", "--method", "rgbd"],
    },
    Job {
        name: "structure from motion",
        args: &["reconstruct", "Q", "--method", "sfm"],
    },
    Job {
        name: "fuse",
        args: &["fuse", "P", "--voxel", "0.004"],
    },
    Job {
        name: "export cloud and mesh",
        args: &[
            "export",
            "P",
            "--cloud",
            "O/c.ply",
            "--mesh",
            "O/m.glb",
            "--per-label",
        ],
    },
    Job {
        name: "export voxels",
        args: &["export", "P", "--voxels", "O/v.npz", "--solid"],
    },
    Job {
        name: "export undistorted",
        args: &[
            "export",
            "P",
            "--undistorted",
            "O/undistorted",
            "--depths",
            "O/depths",
        ],
    },
    Job {
        name: "export masks",
        args: &["masks", "P", "export", "O/masks"],
    },
    Job {
        name: "import masks",
        args: &["masks", "P", "import", "R/labels"],
    },
    Job {
        name: "shot",
        args: &["shot", "P", "O/s.png", "--size", "1024x1024"],
    },
    Job {
        name: "new",
        args: &[
            "new",
            "O/new",
            "--frames",
            "R/color",
            "--depth",
            "R/depth",
            "--cameras",
            "R/sparse",
        ],
    },
];

/// The projects in which jobs are killed.
struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let bench = Self { folder };
        bench.done(&[
            "demo",
            "D",
            "--headless",
            "--frames",
            "6",
            "--size",
            "96x128",
        ]);
        bench.done(&["masks", "P", "export", "R/labels"]);
        bench.done(&["new", "Q", "--frames", "R/color", "--cameras", "R/sparse"]);
        bench.done(&["label", "Q", "rice"]);
        bench.done(&[
            "prompt", "Q", "--frame", "0", "--label", "rice", "--click", "48,64",
        ]);
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns the command with the letters of its arguments replaced by paths.
    fn command(&self, args: &[&str]) -> Command {
        let places = [
            ("D", "demo"),
            ("P", "demo/project"),
            ("Q", "images"),
            ("R", "demo/recording"),
            ("O", "out"),
        ];
        let mut command = Command::new(env!("CARGO_BIN_EXE_ostra"));
        command
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        for arg in args {
            let (first, rest) = arg
                .split_once('/')
                .map_or((*arg, None), |(first, rest)| (first, Some(rest)));
            match places.iter().find(|(letter, _)| *letter == first) {
                Some((_, place)) => {
                    command.arg(rest.map_or(self.path(place), |rest| self.path(place).join(rest)))
                }
                None => command.arg(arg),
            };
        }
        command
    }

    fn done(&self, args: &[&str]) -> String {
        let output = self.command(args).output().unwrap();
        assert!(
            output.status.success(),
            "{args:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs a job to its end and returns its duration, so that kills can be spread over all of it.
    fn duration(&self, job: &Job) -> Duration {
        let begun = Instant::now();
        let output = self.command(job.args).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        // Six small views may be too few for some methods.
        assert!(
            matches!(output.status.code(), Some(0 | 1)),
            "{}: {text}",
            job.name
        );
        assert!(!text.contains("panic"), "{}: {text}", job.name);
        begun.elapsed()
    }

    /// Starts a job and kills it after `wait`. Returns whether a running job was killed.
    ///
    /// A job may end earlier because the machine has become faster since the duration was measured.
    /// Then it is started again with half the wait.
    fn kill_running(&self, job: &Job, mut wait: Duration) -> bool {
        for _ in 0..5 {
            let _ = std::fs::remove_dir_all(self.path("out"));
            std::fs::create_dir_all(self.path("out")).unwrap();
            let mut child = self
                .command(job.args)
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            let until = Instant::now() + wait;
            let mut has_ended = false;
            while !has_ended && Instant::now() < until {
                has_ended = child.try_wait().unwrap().is_some();
                std::thread::yield_now();
            }
            child.kill().unwrap();
            child.wait().unwrap();
            if !has_ended {
                return true;
            }
            wait /= 2;
        }
        false
    }

    /// Returns the data that must survive: the labels, and the keyframe masks as exported.
    fn kept(&self, project: &str) -> (Vec<String>, BTreeMap<String, Vec<u8>>) {
        let info: Value = serde_json::from_str(&self.done(&["info", project, "--json"])).unwrap();
        let labels = info["labels"]
            .as_array()
            .unwrap()
            .iter()
            .map(|label| label["name"].to_string())
            .collect();
        let kept = self.path("kept");
        let _ = std::fs::remove_dir_all(&kept);
        self.done(&["masks", project, "export", kept.to_str().unwrap()]);
        let keyframes = info["frames"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|frame| frame["mask"] == "anchor");
        let masks = keyframes.map(|frame| {
            let name = Path::new(frame["name"].as_str().unwrap()).with_extension("png");
            (
                frame["name"].to_string(),
                std::fs::read(kept.join(name)).unwrap(),
            )
        });
        (labels, masks.collect())
    }
}

/// Checks that every file in the folder can be read by its format's reader.
fn check_outputs(folder: &Path) {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else {
            continue;
        };
        for entry in entries {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                // A project is checked by opening it.
                if name != "new" {
                    folders.push(path);
                }
            } else if !name.starts_with('.') {
                let bytes = std::fs::read(&path).unwrap();
                let is_whole = match path.extension().and_then(|ending| ending.to_str()) {
                    Some("png") => image::load_from_memory(&bytes).is_ok(),
                    Some("json") => serde_json::from_slice::<Value>(&bytes).is_ok(),
                    Some("ply") => {
                        let progress = ostra_core::job::Progress::default();
                        ostra_cloud::ply::read_ply(&path, &progress).is_ok()
                    }
                    Some("glb") => {
                        bytes.len() >= 12
                            && u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize
                                == bytes.len()
                    }
                    Some("npz") => bytes
                        .windows(4)
                        .rev()
                        .take(1 << 16)
                        .any(|at| at == b"PK\x05\x06"),
                    Some("tiff") => tiff::decoder::Decoder::new(std::io::Cursor::new(&bytes))
                        .and_then(|mut decoder| decoder.read_image())
                        .is_ok(),
                    _ => !bytes.is_empty() || name == "points3D.txt",
                };
                assert!(
                    is_whole,
                    "{} is not whole ({} bytes)",
                    path.display(),
                    bytes.len()
                );
            }
        }
    }
}

/// Kills jobs of each kind in turn and checks the project after each kill.
pub fn kill(jobs: &[&Job], kills: usize) {
    let bench = Bench::new();
    let mut random = Pcg64Mcg::seed_from_u64(41);
    let mut hit = BTreeMap::new();
    let durations: Vec<Duration> = jobs.iter().map(|job| bench.duration(job)).collect();
    for kill in 0..kills {
        let job = jobs[kill % jobs.len()];
        let project = if job.args.contains(&"Q") { "Q" } else { "P" };
        bench.done(&["label", project, &format!("before kill {kill}")]);
        let before = bench.kept(project);
        let wait = durations[kill % jobs.len()].mul_f64(random.random_range(0.0..0.95));
        *hit.entry(job.name).or_insert(0_usize) += usize::from(bench.kill_running(job, wait));
        let after = bench.kept(project);
        assert!(
            after.0.starts_with(&before.0),
            "{}: labels {:?} became {:?}",
            job.name,
            before.0,
            after.0
        );
        if job.name != "import masks" && job.name != "prompt" {
            for (frame, mask) in &before.1 {
                assert_eq!(
                    after.1.get(frame),
                    Some(mask),
                    "{}: keyframe {frame}",
                    job.name
                );
            }
        }
        check_outputs(&bench.path("out"));
        if bench.path("out/new/project.toml").exists() {
            bench.done(&["info", "O/new"]);
        }
    }
    println!("kills that hit a running job: {hit:?}");
    // The next edit removes temporary files that the kills left behind.
    for project in ["P", "Q"] {
        bench.done(&["label", project, "after all"]);
    }
    let mut folders = vec![bench.path("demo/project"), bench.path("images")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            assert!(
                !ostra_core::disk::is_temporary(&entry.file_name()),
                "{:?}",
                entry.path()
            );
            if entry.file_type().unwrap().is_dir() {
                folders.push(entry.path());
            }
        }
    }
    assert!(
        hit.values().sum::<usize>() * 2 > kills,
        "most kills hit a running job: {hit:?}"
    );
}
