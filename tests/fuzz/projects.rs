//! Fuzz targets for project folders with one damaged file, and for recipes.

use ostra_project::SegmenterId;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use glam::DVec2;
use image::{ImageBuffer, Luma};
use ostra_cloud::fuse::read_votes;
use ostra_frames::cameras::IntrinsicsSource;
use ostra_frames::{FrameFolder, OpenRequest};
use ostra_masks::{Click, LabelId, Prompt};
use ostra_project::{FuseRequest, Project, ResultKind};
use ostra_session::Event;
use ostra_session::{
    CleanRequest, Command, NewProject, PaintRequest, PromptRequest, RangeChange, RangeRequest,
    Recipe, Session, TraceRequest,
};

use crate::harness::{Seed, fuzz, scratch};
use crate::seeds;

/// Returns the files of a sample project and of the images it was made from.
///
/// The project has two RGB-D frames with a label, masks, a cloud and some history.
fn sample() -> &'static [Seed] {
    static SAMPLE: OnceLock<Vec<Seed>> = OnceLock::new();
    SAMPLE.get_or_init(|| {
        let folder = tempfile::tempdir_in(scratch()).unwrap();
        let root = folder.path().join("project");
        make_project(folder.path(), &root);
        let mut files = Vec::new();
        collect(folder.path(), folder.path(), &mut files);
        assert!(
            files.len() > 12,
            "{:?}",
            files.iter().map(|file| &file.path).collect::<Vec<_>>()
        );
        files
    })
}

fn make_project(folder: &Path, root: &Path) {
    for name in ["color", "depth", "pose"] {
        std::fs::create_dir(folder.join(name)).unwrap();
    }
    for k in 0..2 {
        std::fs::write(folder.join(format!("color/{k}.png")), seeds::color_png()).unwrap();
        let depth: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_pixel(16, 12, Luma([1000]));
        depth.save(folder.join(format!("depth/{k}.png"))).unwrap();
        let pose = format!("1 0 0 {}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", 0.02 * f64::from(k));
        std::fs::write(folder.join(format!("pose/{k}.txt")), pose).unwrap();
    }
    let sources = vec![FrameFolder {
        frames: folder.join("color"),
        depth: Some(folder.join("depth")),
    }];
    let new = NewProject {
        root: root.to_owned(),
        open: OpenRequest {
            sources,
            ..OpenRequest::default()
        },
        cameras: Some(folder.join("pose")),
        intrinsics: Some(IntrinsicsSource::Values([20.0, 20.0, 8.0, 6.0])),
    };
    let mut session = Session::new();
    let add = |name: &str| Command::AddLabel {
        name: name.into(),
        parent: None,
        color: None,
    };
    for command in [
        Command::New(new),
        add("leaf"),
        paint(),
        Command::Fuse(FuseRequest::default()),
    ] {
        done(&mut session, command);
    }
    session.save().unwrap();
    for command in [add("stem"), add("root"), Command::Undo] {
        done(&mut session, command);
    }
}

fn paint() -> Command {
    let points_px = vec![DVec2::new(4.0, 4.0), DVec2::new(10.0, 6.0)];
    Command::Paint(PaintRequest {
        frame: 0,
        label: LabelId(1),
        points_px,
        radius_px: 2.0,
        erase: false,
        replace: true,
        snap: false,
    })
}

fn done(session: &mut Session, command: Command) {
    session.act(command).unwrap();
    let events = session.settle(|_| ControlFlow::Continue(()));
    assert!(
        !events
            .iter()
            .any(|event| matches!(event, Event::Failed { .. })),
        "{events:?}"
    );
}

fn collect(root: &Path, folder: &Path, files: &mut Vec<Seed>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            collect(root, &path, files);
        } else {
            let below = path
                .strip_prefix(root)
                .unwrap()
                .to_str()
                .unwrap()
                .replace('\\', "/");
            files.push(Seed::new(&below, std::fs::read(&path).unwrap()));
        }
    }
}

/// Waits for the running jobs; a panic of a job is a finding.
fn settle(session: &mut Session) {
    for event in session.settle(|_| ControlFlow::Continue(())) {
        if let Event::Failed { error, .. } = event {
            assert!(
                !error.contains("panic") && !error.contains("unexpected fault"),
                "{error}"
            );
        }
    }
}

/// Opens the project, edits it, fuses again and saves. Returns whether it was fused.
///
/// Each step may fail, but only with an error message.
fn use_project(root: &Path) -> bool {
    let mut session = Session::new();
    if session.act(Command::Open(root.to_owned())).is_err() {
        return false;
    }
    settle(&mut session);
    let frames = session.project().map_or(0, |project| project.frames.len());
    for frame in 0..frames.min(3) {
        let frame = session
            .project()
            .map(|project| project.frames[frame].clone());
        let _ = frame.map(|frame| (session.store().image(&frame), session.store().depth(&frame)));
    }
    let add = Command::AddLabel {
        name: "fuzzed".into(),
        parent: None,
        color: None,
    };
    for command in [
        add,
        paint(),
        Command::Undo,
        Command::Redo,
        Command::Fuse(FuseRequest::default()),
    ] {
        let _ = session.act(command);
        settle(&mut session);
    }
    let _ = session.save();
    session.cloud().is_some_and(|cloud| !cloud.is_empty())
        && session.project().is_some_and(|project| !is_stale(project))
}

fn is_stale(project: &Project) -> bool {
    project
        .results
        .get(&ResultKind::Cloud)
        .is_none_or(|record| record.stale)
}

#[test]
fn project_folders() {
    let files = sample();
    let whole = tempfile::tempdir_in(scratch()).unwrap();
    place_all(whole.path(), files);
    assert!(
        use_project(&whole.path().join("project")),
        "the undamaged project is fused"
    );
    fuzz!("project folders", 400, files.to_vec(), |folder, damaged| {
        place_all(
            folder,
            files.iter().filter(|file| file.path != damaged.path),
        );
        use_project(&folder.join("project"));
        for file in files
            .iter()
            .filter(|file| !file.path.starts_with("project/") && file.path != damaged.path)
        {
            assert!(
                std::fs::read(folder.join(&file.path)).unwrap() == file.bytes,
                "{} was changed",
                file.path
            );
        }
        clear(folder);
    });
}

fn place_all<'a>(folder: &Path, files: impl IntoIterator<Item = &'a Seed>) {
    for file in files {
        let path = folder.join(&file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &file.bytes).unwrap();
    }
}

fn clear(folder: &Path) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            std::fs::remove_dir_all(path).unwrap();
        } else {
            std::fs::remove_file(path).unwrap();
        }
    }
}

#[test]
fn votes() {
    let votes = sample()
        .iter()
        .filter(|file| file.path == "project/votes.bin")
        .cloned()
        .collect::<Vec<_>>();
    fuzz!("votes", 10_000, votes, |_, seed| {
        let _ = read_votes(seed.bytes.as_slice());
    });
}

/// Returns commands that only change the open project.
fn recipe_commands() -> Vec<Command> {
    let prompt = Prompt {
        clicks: vec![Click {
            at_px: DVec2::splat(5.0),
            include: true,
        }],
        ..Prompt::default()
    };
    let trace = TraceRequest {
        frame: 1,
        label: LabelId(1),
        points_px: vec![DVec2::new(1.0, 1.0), DVec2::new(12.0, 9.0)],
        replace: false,
    };
    vec![
        Command::AddLabel {
            name: "a".into(),
            parent: None,
            color: Some([1, 2, 3]),
        },
        paint(),
        Command::Prompt(PromptRequest {
            frame: 1,
            label: LabelId(1),
            prompt,
            segmenter: SegmenterId::Builtin,
        }),
        Command::Trace(trace),
        Command::Clean(CleanRequest {
            frame: 0,
            label: LabelId(1),
            holes_below_px: 5,
            islands_below_px: 5,
        }),
        Command::Range(RangeRequest {
            labels: vec![LabelId(1)],
            from: 0,
            to: 1,
            change: RangeChange::Delete,
            replace: false,
        }),
        Command::Undo,
        Command::Redo,
    ]
}

/// Returns whether a command only changes the open project.
fn stays_inside(command: &Command) -> bool {
    use Command as C;
    matches!(
        command,
        C::AddLabel { .. }
            | C::Paint(_)
            | C::Prompt(_)
            | C::Clean(_)
            | C::Trace(_)
            | C::Undo
            | C::Redo
            | C::Range(_)
    )
}

/// Fuzzes the steps of a recipe that only change the open project.
#[test]
fn recipes() {
    let text = serde_json::to_vec_pretty(&Recipe {
        format: 1,
        commands: recipe_commands(),
    })
    .unwrap();
    let files = sample();
    fuzz!(
        "recipes",
        3000,
        [Seed::new("recipe.json", text)],
        |folder, seed| {
            let Ok(recipe) = serde_json::from_slice::<Recipe>(&seed.bytes) else {
                return;
            };
            place_all(folder, files);
            let mut session = Session::new();
            session.act(Command::Open(folder.join("project"))).unwrap();
            settle(&mut session);
            for command in recipe.commands {
                if stays_inside(&command) {
                    let _ = session.act(command);
                    settle(&mut session);
                }
            }
            drop(session);
            clear(folder);
        }
    );
}
