//! Tests that clicks of `ostra prompt` are obeyed, sized and reported.

use super::recording::Recording;
use crate::program::{done, ostra, refused};

fn warned(args: &[&str]) -> String {
    let output = ostra(args);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{args:?}: {text}");
    text
}

/// Exports the masks to a folder and returns the number of labelled pixels.
fn labelled_pixels(recording: &Recording, project: &str, name: &str) -> usize {
    let folder = recording.path(name);
    done(&["masks", project, "export", &folder, "--format", "binary"]);
    let mut count = 0;
    for (path, _) in crate::program::contents(folder.as_ref()) {
        if path.extension().is_some_and(|extension| extension == "png") {
            let mask = image::open(&path).unwrap().to_luma8();
            count += mask.pixels().filter(|pixel| pixel.0[0] > 0).count();
        }
    }
    count
}

#[test]
fn size_of_the_last_prompt_can_be_changed() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    let prompt = |size: &str| {
        warned(&[
            "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24", "--size",
            size,
        ])
    };
    let mut areas = Vec::new();
    for size in ["auto", "smallest", "largest"] {
        prompt(size);
        areas.push(labelled_pixels(&recording, &project, size));
    }
    let [automatic, smallest, largest] = areas[..] else {
        panic!("{areas:?}")
    };
    assert!(
        0 < smallest && smallest <= automatic && automatic <= largest && smallest < largest,
        "{areas:?}"
    );
    let none = refused(&[
        "prompt",
        &project,
        "--frame",
        "1",
        "--label",
        "thing",
        "--box",
        "10,10,30,30",
        "--size",
        "smaller",
    ]);
    assert!(none.contains("the prompt has none"), "{none}");
    let output = ostra(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--size", "tiny",
    ]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(
        text.contains("smallest, smaller, auto, larger, largest"),
        "{text}"
    );
}

#[test]
fn click_without_effect_is_reported_and_makes_no_keyframe() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    let exclude = [
        "prompt", &project, "--frame", "1", "--label", "thing", "--not", "20,24",
    ];
    let text = warned(&exclude);
    assert!(
        text.contains("The click changed nothing: 'thing' is not here"),
        "{text}"
    );
    let removal = refused(&["prompt", &project, "--frame", "1", "--label", "thing"]);
    assert!(removal.contains("'thing' is not on frame 1"), "{removal}");
    let info = done(&["info", &project]);
    assert!(info.contains("masks: 0 keyframes"), "{info}");
}
