//! Tests of suggestions for unlabelled objects, through the command line.

use std::path::Path;
use std::process::Command;

use image::{Rgb, RgbImage};

const SIZE: (u32, u32) = (320, 240);

fn ostra(words: &str, folder: &Path) -> String {
    let words: Vec<&str> = words.split(' ').collect();
    let out = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(&words)
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "{words:?}: {}",
        String::from_utf8_lossy(&out.stderr)
    );
    String::from_utf8(out.stdout).unwrap()
}

/// Returns a texture of 5 px cells that is a fixed function of the position.
fn grain(x: u32, y: u32, salt: u32) -> u8 {
    let cell = (x / 5)
        .wrapping_mul(7_349)
        .wrapping_add((y / 5).wrapping_mul(9_151))
        .wrapping_add(salt);
    (cell.wrapping_mul(cell) >> 7 & 127) as u8
}

/// Returns the left edge of the box, which moves on its own over sliding, textured ground.
fn box_left(frame: u32) -> u32 {
    90 + 4 * frame
}

fn image(frame: u32) -> RgbImage {
    RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let (u, v) = (x.wrapping_sub(box_left(frame)), y.wrapping_sub(80));
        if u < 60 && v < 50 {
            let value = 90 + grain(u, v, 5);
            Rgb([value, value, 255 - value])
        } else {
            Rgb([grain(x + 500 + frame, y + 300, 0); 3])
        }
    })
}

/// Returns the frame and pixel of each line.
fn found(text: &str) -> Vec<(u32, u32, u32)> {
    let moves = text
        .lines()
        .filter(|line| line.contains("moves on its own"));
    let numbers = moves.map(|line| {
        let frame = line
            .strip_prefix("frame ")
            .unwrap()
            .split(':')
            .next()
            .unwrap();
        let (x, y) = line
            .rsplit_once(", at ")
            .unwrap()
            .1
            .split_once(',')
            .unwrap();
        (
            frame.parse().unwrap(),
            x.parse().unwrap(),
            y.parse().unwrap(),
        )
    });
    numbers.collect()
}

#[test]
fn independently_moving_object_is_suggested_until_it_is_labelled() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("frames")).unwrap();
    for frame in 0..6 {
        image(frame)
            .save(folder.join(format!("frames/{frame}.png")))
            .unwrap();
    }
    ostra("new p --frames frames", folder);
    ostra("label p ground", folder);
    ostra("label p box", folder);
    ostra(
        "trace p --frame 0 --label ground --point 20,200 --point 60,200",
        folder,
    );
    let offered = found(&ostra("suggest p", folder));
    assert_eq!(offered.len(), 1, "{offered:?}");
    let (frame, x, y) = offered[0];
    let left = box_left(frame);
    assert!(
        frame == 0 && (left + 10..left + 50).contains(&x) && (90..120).contains(&y),
        "{offered:?}"
    );
    let corners = format!("{},80,{},130", box_left(0), box_left(0) + 60);
    ostra(
        &format!("prompt p --frame 0 --label box --click {x},{y} --box {corners}"),
        folder,
    );
    assert_eq!(found(&ostra("suggest p", folder)), []);
}

#[test]
fn unreadable_frames_are_named_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("frames")).unwrap();
    for frame in 0..6 {
        image(frame)
            .save(folder.join(format!("frames/{frame}.png")))
            .unwrap();
    }
    ostra("new p --frames frames", folder);
    ostra("label p ground", folder);
    for frame in [0, 2, 5] {
        ostra(
            &format!("trace p --frame {frame} --label ground --point 20,200 --point 60,200"),
            folder,
        );
    }
    for frame in [0, 5] {
        std::fs::write(folder.join(format!("frames/{frame}.png")), "").unwrap();
    }
    let suggest = || {
        Command::new(env!("CARGO_BIN_EXE_ostra"))
            .args(["suggest", "p"])
            .current_dir(folder)
            .output()
            .unwrap()
    };
    let out = suggest();
    let message = String::from_utf8_lossy(&out.stderr);
    let lines: Vec<&str> = message
        .lines()
        .filter(|line| line.contains("passed over"))
        .collect();
    assert!(out.status.success() && lines.len() == 1, "{message}");
    assert!(
        lines[0].contains("2 frames cannot be read") && lines[0].contains("0.png, 5.png"),
        "{message}"
    );
    std::fs::write(folder.join("frames/2.png"), "").unwrap();
    let out = suggest();
    let message = String::from_utf8_lossy(&out.stderr);
    assert!(
        out.status.code() == Some(1) && message.contains("0.png: the file is empty"),
        "none is left: {message}"
    );
}

#[test]
fn proposals_name_the_missing_network() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("frames")).unwrap();
    image(0).save(folder.join("frames/0.png")).unwrap();
    ostra("new p --frames frames", folder);
    let program = || Command::new(env!("CARGO_BIN_EXE_ostra"));
    let requested = ["suggest", "p", "--frame", "0"];
    // No network is installed in this folder.
    let out = program()
        .args(requested)
        .current_dir(folder)
        .env("XDG_DATA_HOME", folder)
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&out.stderr);
    assert!(
        out.status.code() == Some(1) && message.contains("install Segment Anything"),
        "{message}"
    );
}
