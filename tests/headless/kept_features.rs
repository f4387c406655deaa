//! Tests that a repeated or stopped reconstruction reuses its features, matches and cameras.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use image::{GrayImage, Luma};
use ostra_project::{ReconstructMethod, ReconstructRequest};
use ostra_session::Event;
use ostra_session::{Command, Session};

use super::scale::{HEIGHT, Photos, WIDTH, done_with_both};
use crate::program::contents;
use crate::session::perform;

/// Returns the files of the project's sparse model, without the status of each frame.
fn model(project: &str) -> Vec<(PathBuf, Vec<u8>)> {
    contents(&Path::new(project).join("sparse"))
}

#[test]
fn repeated_reconstruction_reuses_features_and_gives_the_same_bytes() {
    let photos = Photos::new(5);
    let [once, twice] = ["once", "twice"].map(|name| photos.project(name, &[]));
    let sfm = |project: &str| {
        done_with_both(&["reconstruct", project, "--method", "sfm"].map(str::to_owned))
    };
    let first = sfm(&once);
    assert!(!first.contains("earlier run"), "{first}");
    let again = sfm(&once);
    assert!(
        again.contains("features of 5 of 5 images and matches of 10 of 10 pairs were there"),
        "{again}"
    );
    sfm(&twice);
    let bytes = |project: &str| {
        model(project)
            .into_iter()
            .map(|(_, bytes)| bytes)
            .collect::<Vec<_>>()
    };
    let kept = bytes(&once);
    assert!(kept == bytes(&twice), "with what was kept as without");
    std::fs::remove_dir_all(Path::new(&once).join("cache")).unwrap();
    assert!(!sfm(&once).contains("earlier run"));
    assert!(bytes(&once) == kept);
    // A changed image is extracted again, and so are all its matches.
    let mut image = image::open(photos.path("color/4.png"))
        .unwrap()
        .into_luma8();
    image.put_pixel(9, 9, Luma([255 - image.get_pixel(9, 9).0[0]]));
    image.save(photos.path("color/4.png")).unwrap();
    let changed = sfm(&twice);
    assert!(changed.contains("features of 4 of "), "{changed}");
}

#[test]
fn stopped_reconstruction_resumes_with_its_features() {
    let photos = Photos::new(5);
    let project = photos.project("project", &[]);
    let mut session = Session::new();
    perform(&mut session, Command::Open(project.into())).unwrap();
    let request = ReconstructRequest {
        method: ReconstructMethod::Sfm,
        ..ReconstructRequest::default()
    };
    let run = |session: &mut Session, stop_at: Option<&str>| {
        session.act(Command::Reconstruct(request.clone())).unwrap();
        session.settle(|jobs| {
            let reached = jobs
                .iter()
                .any(|job| Some(job.report.stage.as_str()) == stop_at);
            if reached {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        })
    };
    let notices = |events: &[Event]| {
        let notices = events.iter().filter_map(|event| match event {
            Event::Notice(text) => Some(text.clone()),
            _ => None,
        });
        notices.collect::<Vec<_>>().join("\n")
    };
    let stopped = run(&mut session, Some("match"));
    let ended = stopped
        .iter()
        .any(|event| matches!(event, Event::Stopped { .. } | Event::Finished { .. }));
    assert!(ended, "{stopped:?}");
    let finished = run(&mut session, None);
    assert!(
        finished
            .iter()
            .any(|event| matches!(event, Event::Finished { .. })),
        "{finished:?}"
    );
    assert!(
        notices(&finished).contains("features of 5 of 5 images"),
        "{finished:?}"
    );
}

#[test]
fn stereo_uses_existing_cameras_although_images_are_unregistered() {
    let photos = Photos::new(5);
    // Two images show nothing of the carpet.
    for k in [5_u32, 6] {
        GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
            Luma([((x / 9 + k * y / 7) * 31) as u8])
        })
        .save(photos.path(&format!("color/{k}.png")))
        .unwrap();
    }
    let project = photos.project("project", &[]);
    let reconstruct = |more: &[&str]| {
        let words = [
            &["reconstruct", &project, "--device", "cpu", "--method"][..],
            more,
        ]
        .concat();
        done_with_both(&words.into_iter().map(str::to_owned).collect::<Vec<_>>())
    };
    let found = reconstruct(&["sfm"]);
    assert!(found.contains("5.png has no camera"), "{found}");
    let cameras = model(&project);
    let message = reconstruct(&["mvs", "--max-side", "96"]);
    assert!(
        !message.contains("cameras:") && message.contains("5.png has no depth"),
        "{message}"
    );
    assert_eq!(model(&project), cameras, "the cameras stay as they are");
}
