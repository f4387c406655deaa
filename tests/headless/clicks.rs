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
    // A spot on a leaf before a wall: each is an answer to a click on the spot.
    let images = recording.path("nested");
    std::fs::create_dir(&images).unwrap();
    let mut image = image::RgbImage::from_fn(240, 180, |x, y| {
        let grain = ((x * 7 + y * 13) % 5) as u8;
        image::Rgb([90 + grain, 90, 95])
    });
    for (left, top, right, bottom, color) in [
        (60, 40, 180, 140, [60, 140, 60]),
        (100, 70, 140, 110, [150, 170, 60]),
    ] {
        for (x, y) in (left..right).flat_map(|x| (top..bottom).map(move |y| (x, y))) {
            image.put_pixel(x, y, image::Rgb(color));
        }
    }
    for frame in 0..2 {
        image.save(format!("{images}/{frame}.png")).unwrap();
    }
    let project = recording.path("sizes");
    done(&["new", &project, "--frames", &images]);
    done(&["label", &project, "thing"]);
    let mut areas = Vec::new();
    for size in ["auto", "smallest", "largest"] {
        warned(&[
            "prompt", &project, "--frame", "1", "--label", "thing", "--click", "120,90", "--size",
            size,
        ]);
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
fn prompt_outside_alone_does_not_replace_clicks_inside() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    let prompt = ["prompt", &project, "--frame", "1", "--label", "thing"];
    let with = |clicks: &[&'static str]| [&prompt[..], clicks].concat();
    done(&with(&["--click", "20,24"]));
    let before = done(&["info", &project, "--json"]);
    let refusal = refused(&with(&["--not", "2,2"]));
    assert!(
        refusal.contains("'thing' on frame 1") && refusal.contains("--click"),
        "{refusal}"
    );
    assert_eq!(done(&["info", &project, "--json"]), before);
    done(&with(&["--click", "20,24", "--not", "2,2"]));
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
