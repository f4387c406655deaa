//! Checks that a project survives being killed at any moment, and a full disk.
//!
//! The child process is this test binary itself. It opens the project, then makes random edits and
//! saves without end. It prints every state that was reported as safe, until the disk refuses too
//! many of its steps. The parent kills it at random moments and opens the remaining project.

use std::hash::{Hash, Hasher};
use std::io::{BufRead, BufReader, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, Instant};

use glam::DVec2;
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_masks::LabelId;
use ostra_project::Project;
use ostra_session::Event;
use ostra_session::{Command, NewProject, PaintRequest, RangeChange, RangeRequest, Session};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const ROOT: &str = "OSTRA_TEST_CRASH_ROOT";
/// Message for a step that cannot be written.
const UNSAVED: &str = "cannot be saved and was not made";
/// Number of such steps after which the child ends by itself.
const ENOUGH_REFUSED: usize = 6;

fn fingerprint(project: &Project) -> u64 {
    let mut hasher = rustc_hash::FxHasher::default();
    format!("{project:?}").hash(&mut hasher);
    hasher.finish()
}

fn state(session: &Session) -> u64 {
    fingerprint(session.project().expect("a project is open"))
}

fn opened(root: &Path) -> Session {
    let mut session = Session::new();
    session.act(Command::Open(root.to_owned())).unwrap();
    let events = session.settle(|_| ControlFlow::Continue(()));
    assert!(
        events.iter().any(|event| matches!(event, Event::Opened(_))),
        "{events:?}"
    );
    // A kill in the middle of a line is reported; anything else would be an error.
    let is_torn = |text: &String| text.contains("journal.jsonl: its last line is incomplete");
    let warnings = events
        .iter()
        .filter(|event| matches!(event, Event::Warning(text) if !is_torn(text)));
    assert_eq!(warnings.count(), 0, "{events:?}");
    session
}

fn made(folder: &Path) -> PathBuf {
    let images = folder.join("pictures");
    std::fs::create_dir(&images).unwrap();
    for k in 0..4 {
        image::RgbImage::new(48, 32)
            .save(images.join(format!("{k}.png")))
            .unwrap();
    }
    let root = folder.join("project");
    let sources = vec![FrameFolder {
        frames: images,
        depth: None,
    }];
    let open = OpenRequest {
        sources,
        ..OpenRequest::default()
    };
    let new = NewProject {
        root: root.clone(),
        open,
        cameras: None,
        intrinsics: None,
    };
    let mut session = Session::new();
    session.act(Command::New(new)).unwrap();
    session.settle(|_| ControlFlow::Continue(()));
    assert!(session.project().is_some());
    root
}

/// Returns a random command, which may not fit the state.
fn random_command(project: &Project, random: &mut Pcg64Mcg) -> Command {
    let frame = random.random_range(0..project.frames.len());
    let labels: Vec<LabelId> = project.labels.iter().map(|label| label.id).collect();
    let label = labels
        .get(random.random_range(0..labels.len().max(1)))
        .copied()
        .unwrap_or_default();
    match random.random_range(0..20) {
        0 => Command::AddLabel {
            name: format!("label {}", random.random_range(0..30)),
            parent: None,
            color: None,
        },
        1 => Command::RemoveLabel(label),
        2 => Command::ClearMask { frame },
        3..7 => Command::Undo,
        7..10 => Command::Redo,
        10..13 => random_range(project, frame, label, random),
        _ => {
            let point = |random: &mut Pcg64Mcg| {
                DVec2::new(
                    random.random_range(0.0..48.0),
                    random.random_range(0.0..32.0),
                )
            };
            let points_px = (0..6).map(|_| point(random)).collect();
            let radius_px = random.random_range(0.5..6.0);
            Command::Paint(PaintRequest {
                frame,
                label,
                points_px,
                radius_px,
                erase: false,
                replace: true,
                snap: false,
            })
        }
    }
}

/// Returns a random change of a label from frame `from` to the last frame.
fn random_range(project: &Project, from: usize, label: LabelId, random: &mut Pcg64Mcg) -> Command {
    let change = match random.random_range(0..7) {
        0 => RangeChange::Delete,
        1 => RangeChange::Restore,
        2 => RangeChange::Lock,
        3 => RangeChange::Unlock,
        4 => RangeChange::Hide,
        5 => RangeChange::Show,
        _ => RangeChange::Copy {
            frame: random.random_range(0..project.frames.len()),
        },
    };
    let to = project.frames.len() - 1;
    Command::Range(RangeRequest {
        labels: vec![label],
        from,
        to,
        change,
        replace: false,
    })
}

/// Runs the child process; does nothing unless the parent asks for it.
pub fn child() {
    let Some(root) = std::env::var_os(ROOT) else {
        return;
    };
    let seed = std::process::id().into();
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut session = opened(Path::new(&root));
    let mut out = std::io::stdout();
    let mut refused = 0;
    while refused < ENOUGH_REFUSED {
        let before = state(&session);
        writeln!(out, "safe {before}").unwrap();
        if random.random_ratio(1, 12) {
            if let Err(error) = session.save() {
                writeln!(out, "unsaved {error:#}").unwrap();
            }
        } else {
            let command = random_command(&session.project().unwrap().clone(), &mut random);
            if let Err(error) = session.act(command) {
                assert_eq!(state(&session), before, "a refused command changes nothing");
                writeln!(out, "refused {error:#}").unwrap();
                refused += usize::from(format!("{error:#}").contains(UNSAVED));
            }
        }
        session.poll();
    }
}

fn start(root: &Path, shell: Option<&str>) -> Child {
    let exe = std::env::current_exe().unwrap();
    let args = [
        "crash::child",
        "--exact",
        "--nocapture",
        "--test-threads",
        "1",
    ];
    let mut process = match shell {
        None => Process::new(&exe),
        Some(before) => {
            let mut process = Process::new("sh");
            process
                .arg("-c")
                .arg(format!("{before}; exec \"$0\" \"$@\""))
                .arg(&exe);
            process
        }
    };
    process
        .args(args)
        .env(ROOT, root)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Reads the child's output until `enough`, kills the child, and returns all its lines.
fn kill_when(child: &mut Child, mut enough: impl FnMut(&str) -> bool) -> Vec<String> {
    let mut lines = Vec::new();
    let mut out = BufReader::new(child.stdout.take().unwrap());
    let mut line = String::new();
    while out.read_line(&mut line).unwrap() > 0 {
        let stop = enough(&line);
        lines.push(std::mem::take(&mut line));
        if stop {
            break;
        }
    }
    child.kill().unwrap();
    child.wait().unwrap();
    while out.read_line(&mut line).unwrap() > 0 {
        lines.push(std::mem::take(&mut line));
    }
    lines
}

/// Returns the last state that the child printed as safe; an incomplete last line does not count.
fn last_safe(lines: &[String]) -> Option<u64> {
    let whole = lines.iter().rev().filter(|line| line.ends_with('\n'));
    whole
        .filter_map(|line| line.split("safe ").nth(1)?.trim().parse().ok())
        .next()
}

/// Checks that the project is in the safe state or one step away.
///
/// That step was in progress when the child was killed.
fn check(root: &Path, safe: u64) {
    let mut session = opened(root);
    let found = state(&session);
    if found == safe {
        return;
    }
    for (there, back) in [
        (Command::Undo, Command::Redo),
        (Command::Redo, Command::Undo),
    ] {
        if session.act(there).is_ok() {
            let near = state(&session);
            session.act(back).unwrap();
            assert_eq!(state(&session), found);
            if near == safe {
                return;
            }
        }
    }
    panic!("the project is {found:x}, not {safe:x} nor a step from it");
}

/// Kills the child at `kills` random moments.
pub fn kill_at_random_moments(kills: u64) {
    let folder = tempfile::tempdir().unwrap();
    let root = made(folder.path());
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let (mut safe, mut reported) = (state(&opened(&root)), 0);
    for _ in 0..kills {
        let until = Duration::from_micros(random.random_range(0..40_000));
        let mut begun = None;
        let mut child = start(&root, None);
        let lines = kill_when(&mut child, |line| {
            begun.is_none()
                && line.contains("safe ")
                && begun.replace(Instant::now()).is_none()
                && until.is_zero()
                || begun.is_some_and(|begun: Instant| begun.elapsed() >= until)
        });
        reported += lines.len();
        safe = last_safe(&lines).unwrap_or(safe);
        check(&root, safe);
        safe = state(&opened(&root));
    }
    assert!(
        reported as u64 > 5 * kills,
        "the child was at work: {reported} lines"
    );
}

/// Checks that a full disk loses nothing.
///
/// A limit on the size of files stands for a full disk: writes fail in the middle.
#[cfg(unix)]
pub fn fill_the_disk() {
    let folder = tempfile::tempdir().unwrap();
    let root = made(folder.path());
    for (blocks, is_recipe_full) in [(4, false), (7, false), (12, false), (12, true)] {
        if is_recipe_full {
            let empty_lines = "\n".repeat(blocks * 512 - 20);
            std::fs::write(root.join("recipe.jsonl"), empty_lines).unwrap();
        }
        let mut child = start(&root, Some(&format!("trap '' XFSZ; ulimit -f {blocks}")));
        let lines = kill_when(&mut child, |line| line.contains("test result"));
        let refused = lines.iter().filter(|line| line.contains(UNSAVED)).count();
        assert_eq!(refused, ENOUGH_REFUSED, "{}", lines.concat());
        check(&root, last_safe(&lines).unwrap());
    }
}
