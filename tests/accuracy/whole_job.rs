//! Tests of the complete workflow of a session on real RGB-D frames.
//!
//! The steps are: open, prompt, track, fuse, export, undo, open again.

use ostra_project::{ResultEngine, SegmenterId};
use std::ops::ControlFlow;
use std::path::Path;

use glam::DVec2;
use ostra_cloud::ply::{read_mesh, read_ply};
use ostra_core::job::Progress;
use ostra_masks::{Click, LabelId, Prompt, deepest_point, read_palette_png};
use ostra_project::{ExportRequest, FuseRequest, MaskOrigin, ReconstructRequest, ResultKind};
use ostra_session::Event;
use ostra_session::{Command, PromptRequest, Session};

use crate::data::data_dir;
use crate::session::perform;
use crate::shelf::{new_project, track};

/// Returns clicks on the deepest points of the true objects: two on frame 0 and two on frame 8.
fn clicks(data: &Path) -> Vec<PromptRequest> {
    let mut clicks = Vec::new();
    for (frame, labels) in [(0, [1, 3]), (8, [2, 4])] {
        let truth =
            read_palette_png(&data.join(format!("apc_shelf_rgbd_labels/labels/{frame:06}.png")))
                .unwrap();
        for label in labels.map(LabelId) {
            let (x, y) = deepest_point(&truth.region(label)).unwrap();
            let at_px = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let prompt = Prompt {
                clicks: vec![Click {
                    at_px,
                    include: true,
                }],
                ..Prompt::default()
            };
            clicks.push(PromptRequest {
                frame,
                label,
                prompt,
                segmenter: SegmenterId::Auto,
            });
        }
    }
    clicks
}

fn fuse() -> Command {
    Command::Fuse(FuseRequest {
        voxel: Some(0.006),
        ..FuseRequest::default()
    })
}

/// Opens the shelf, prompts four objects, tracks and fuses.
fn way_through(data: &Path, root: &Path) -> Session {
    let mut session = Session::new();
    perform(&mut session, new_project(data, root)).unwrap();
    for name in ["stems", "bunny", "tissues", "jokes"] {
        perform(
            &mut session,
            Command::AddLabel {
                name: name.into(),
                parent: None,
                color: None,
            },
        )
        .unwrap();
    }
    for prompt in clicks(data) {
        perform(&mut session, Command::Prompt(prompt)).unwrap();
    }
    let events = perform(&mut session, track()).unwrap();
    assert!(
        events.contains(&Event::Notice("tracker: geometry".into())),
        "{events:?}"
    );
    let reconstruct = ReconstructRequest::default();
    perform(&mut session, Command::Reconstruct(reconstruct)).unwrap();
    perform(&mut session, fuse()).unwrap();
    session
}

fn complete_workflow_can_be_undone_repeated_and_reopened() {
    let data = data_dir();
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("shelf");
    let mut session = way_through(&data, &root);
    let end = session.project().unwrap().clone();
    assert_eq!(end.masks.len(), 15);
    assert_eq!(
        end.masks
            .values()
            .filter(|mask| mask.origin == MaskOrigin::Keyframe)
            .count(),
        2
    );
    assert!(
        end.results.values().all(|record| !record.stale),
        "{:?}",
        end.results
    );
    assert_eq!(
        end.results[&ResultKind::Cameras].engine,
        ResultEngine::Given
    );
    let cloud = session.cloud().unwrap().clone();
    assert!(
        (1..=4).all(|id| cloud.labels.contains(&LabelId(id))),
        "every object is in the cloud"
    );
    assert_eq!(session.votes().unwrap().len(), cloud.len());

    exports(&mut session, folder.path());
    repeated(&session, &data, folder.path());
    undone_and_redone(&mut session, &end);

    drop(session);
    let mut session = Session::new();
    let events = perform(&mut session, Command::Open(root.clone())).unwrap();
    assert!(events.contains(&Event::Opened(root.clone())), "{events:?}");
    assert_eq!(session.project().unwrap(), &end);
    assert!(session.cloud().is_none(), "loaded when asked for");
    session.settle(|_| ControlFlow::Continue(()));
    assert_eq!(session.cloud().unwrap().positions, cloud.positions);
    assert_eq!(session.undo_title(), Some("Fuse"));
}

fn exports(session: &mut Session, folder: &Path) {
    let out = folder.join("out");
    let request = ExportRequest {
        cloud: Some(out.join("cloud.ply")),
        cameras: Some(out.join("sparse")),
        masks: Some(out.join("masks")),
        depths: Some(out.join("depths")),
        traits: Some(out.join("traits.csv")),
        twin: true,
        per_label: true,
        ..ExportRequest::default()
    };
    perform(session, Command::Export(request)).unwrap();
    for name in [
        "cloud.ply",
        "cloud_labels.ply",
        "cloud_bunny.ply",
        "sparse/images.txt",
        "masks/000003.png",
    ] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let file = std::fs::File::open(out.join("depths/000003.tiff")).unwrap();
    let mut depth = tiff::decoder::Decoder::new(file).unwrap();
    assert_eq!(depth.dimensions().unwrap(), (640, 480));
    let tiff::decoder::DecodingResult::F32(depth) = depth.read_image().unwrap() else {
        panic!("32-bit floats")
    };
    assert!(
        depth.iter().any(|depth| (0.2..3.0).contains(depth)),
        "depth in metres"
    );
    let traits = std::fs::read_to_string(out.join("traits.csv")).unwrap();
    assert!(traits.contains("bunny"), "{traits}");
    surface(session, &out);
}

/// Checks the mesh and the voxels that were made with the cloud.
fn surface(session: &mut Session, out: &Path) {
    let path = |name: &str| Some(out.join(name));
    let request = ExportRequest {
        mesh: path("mesh.ply"),
        voxels: path("voxels.ply"),
        per_label: true,
        ..ExportRequest::default()
    };
    perform(session, Command::Export(request)).unwrap();
    let progress = Progress::default();
    let mesh = read_mesh(&out.join("mesh.ply"), &progress).unwrap();
    let label = |vertex: u32| mesh.vertices.labels[vertex as usize];
    assert!(
        mesh.triangles.len() > 1000
            && mesh
                .triangles
                .iter()
                .all(|&[a, b, c]| label(a) == label(b) && label(b) == label(c))
    );
    let part = read_mesh(&out.join("mesh_bunny.ply"), &progress).unwrap();
    assert!(!part.triangles.is_empty() && part.triangles.len() < mesh.triangles.len());
    let voxel = session.surface_voxel().unwrap();
    let voxels = read_ply(&out.join("voxels.ply"), &progress).unwrap().cloud;
    let cloud = session.cloud().unwrap();
    assert!(
        voxels.len() > 500 && voxels.len() <= cloud.len(),
        "{} of {}",
        voxels.len(),
        cloud.len()
    );
    let centred = |along: f32| (f64::from(along) / voxel - 0.5).rem_euclid(1.0);
    assert!(
        voxels.positions[7]
            .to_array()
            .iter()
            .all(|&along| centred(along).min(1.0 - centred(along)) < 0.01)
    );
    other_formats(session, out, mesh.triangles.len(), voxels.len());
}

/// Checks the same mesh with fewer triangles, and the same voxels, in formats of other programs.
fn other_formats(session: &mut Session, out: &Path, triangles: usize, voxels: usize) {
    let path = |name: &str| Some(out.join(name));
    let export = |mesh: &str, voxels: &str| ExportRequest {
        mesh: path(mesh),
        voxels: path(voxels),
        per_label: true,
        twin: true,
        simplify: Some(0.5),
        ..ExportRequest::default()
    };
    perform(session, Command::Export(export("small.glb", "small.vox"))).unwrap();
    perform(session, Command::Export(export("small.obj", "small.npz"))).unwrap();
    for name in [
        "small_labels.glb",
        "small_bunny.glb",
        "small_bunny.vox",
        "small.mtl",
        "small_labels.npz",
        "small_bunny.npz",
    ] {
        assert!(out.join(name).is_file(), "{name}");
    }
    assert!(
        !out.join("small_labels.vox").exists(),
        "a .vox has the labels' colours already"
    );
    let obj = std::fs::read_to_string(out.join("small.obj")).unwrap();
    let faces = obj.lines().filter(|line| line.starts_with("f ")).count();
    assert!(
        faces > triangles / 10 && faces < triangles * 6 / 10,
        "{faces} of {triangles}"
    );
    assert!(obj.contains("\no bunny\nusemtl bunny\n"));
    assert!(
        std::fs::read(out.join("small.glb"))
            .unwrap()
            .starts_with(b"glTF")
    );
    assert!(std::fs::metadata(out.join("small.npz")).unwrap().len() > 21 * voxels as u64);
    for wrong in [export("mesh.stl", "v.ply"), export("mesh.ply", "v.obj")] {
        let error = perform(session, Command::Export(wrong))
            .unwrap_err()
            .to_string();
        assert!(error.contains("a name that ends in .ply, "), "{error}");
    }
}

/// Checks that the commands of a session make an equal project in another session.
fn repeated(session: &Session, data: &Path, folder: &Path) {
    let text = serde_json::to_string(session.recipe()).unwrap();
    let recipe: ostra_session::Recipe = serde_json::from_str(&text).unwrap();
    assert_eq!(&recipe, session.recipe());
    let mut again = Session::new();
    for command in recipe.commands {
        let command = match command {
            Command::New(_) => new_project(data, &folder.join("again")),
            Command::Export(_) => continue,
            command => command,
        };
        perform(&mut again, command).unwrap();
    }
    let (first, second) = (session.project().unwrap(), again.project().unwrap());
    assert_eq!(
        (&first.frames, &first.labels),
        (&second.frames, &second.labels)
    );
    assert_eq!(
        (&first.prompts, &first.masks),
        (&second.prompts, &second.masks)
    );
    assert_eq!(
        first.results.keys().collect::<Vec<_>>(),
        second.results.keys().collect::<Vec<_>>()
    );
    let bytes =
        |session: &Session| std::fs::read(session.root().unwrap().join("cloud.ply")).unwrap();
    assert!(bytes(session) == bytes(&again), "equal bytes");
}

fn undone_and_redone(session: &mut Session, end: &ostra_project::Project) {
    let cloud_file = session.root().unwrap().join("cloud.ply");
    let first = std::fs::read(&cloud_file).unwrap();
    perform(
        session,
        Command::Fuse(FuseRequest {
            voxel: Some(0.02),
            ..FuseRequest::default()
        }),
    )
    .unwrap();
    assert_ne!(std::fs::read(&cloud_file).unwrap(), first);
    perform(session, Command::Undo).unwrap();
    assert!(
        std::fs::read(&cloud_file).unwrap() == first,
        "undo brings the earlier cloud back"
    );
    assert!(session.cloud().is_none());
    session.settle(|_| ControlFlow::Continue(()));
    assert!(session.cloud().is_some_and(|cloud| cloud.len() > 10_000));
    let mut steps = 0;
    while session.undo_title().is_some() {
        perform(session, Command::Undo).unwrap();
        steps += 1;
    }
    assert_eq!(
        steps,
        4 + 4 + 3,
        "labels, prompts, track, reconstruct, fuse"
    );
    assert!(session.project().unwrap().masks.is_empty() && !cloud_file.exists());
    for _ in 0..steps {
        perform(session, Command::Redo).unwrap();
    }
    assert_eq!(**session.project().unwrap(), *end);
    assert!(std::fs::read(&cloud_file).unwrap() == first);
}

fn stopped_tracking_keeps_its_frames() {
    let data = data_dir();
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::new();
    perform(
        &mut session,
        new_project(&data, &folder.path().join("shelf")),
    )
    .unwrap();
    perform(
        &mut session,
        Command::AddLabel {
            name: "stems".into(),
            parent: None,
            color: None,
        },
    )
    .unwrap();
    perform(&mut session, Command::Prompt(clicks(&data).swap_remove(0))).unwrap();
    session.act(track()).unwrap();
    assert!(session.act(track()).is_err(), "one long job at a time");
    let mut glances = 0;
    let events = session.settle(|jobs| {
        glances += 1;
        let begun = jobs.iter().any(|job| job.report.done > 0);
        if begun {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    let stopped = events
        .iter()
        .any(|event| matches!(event, Event::Stopped { title, .. } if title == "Track"));
    let finished = events
        .iter()
        .any(|event| matches!(event, Event::Finished { title, .. } if title == "Track"));
    assert!(stopped || finished, "{events:?}");
    let tracked = session.project().unwrap().masks.len() - 1;
    let reported = session
        .project()
        .unwrap()
        .results
        .get(&ResultKind::Tracking)
        .map_or(0, |record| record.frames);
    assert_eq!(reported, tracked);
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(
        session.project().unwrap().masks.len(),
        if tracked > 0 { 1 } else { 0 }
    );
}

crate::registry::tests! {
    Data(&["apc_shelf_rgbd_labels"]) =>
        complete_workflow_can_be_undone_repeated_and_reopened,
        stopped_tracking_keeps_its_frames;
}
