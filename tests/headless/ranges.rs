//! Tests of label changes over a range of frames, through the command line.

use std::path::Path;
use std::process::{Command, Output};

use image::{Rgb, RgbImage};

fn ostra(words: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(words)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn done(words: &str, folder: &Path) {
    let out = ostra(&words.split(' ').collect::<Vec<_>>(), folder);
    assert!(
        out.status.success(),
        "{words}: {}",
        String::from_utf8_lossy(&out.stderr)
    );
}

/// Creates a project of six frames: a red box moves to the right, a blue one stands still.
fn project(folder: &Path) {
    std::fs::create_dir(folder.join("frames")).unwrap();
    for frame in 0..6u32 {
        let image = RgbImage::from_fn(120, 80, |x, y| match (x, y) {
            (x, 10..40) if (10 + 8 * frame..40 + 8 * frame).contains(&x) => Rgb([200, 40, 40]),
            (80..110, 45..75) => Rgb([40, 60, 200]),
            _ => Rgb([120, 130, 110]),
        });
        image
            .save(folder.join(format!("frames/{frame}.png")))
            .unwrap();
    }
    done("new p --frames frames", folder);
    for (name, at) in [("red", "25,25"), ("blue", "95,60")] {
        done(&format!("label p {name}"), folder);
        done(
            &format!("prompt p --frame 0 --label {name} --click {at}"),
            folder,
        );
    }
}

/// Returns the pixel counts of labels 1 and 2 on each frame of the exported masks.
fn areas(folder: &Path) -> [[usize; 2]; 6] {
    let out = folder.join("out");
    let _ = std::fs::remove_dir_all(&out);
    done("masks p export out", folder);
    let mask = |frame| ostra_masks::read_palette_png(&out.join(format!("{frame}.png"))).unwrap();
    let count = |frame, id| mask(frame).ids.iter().filter(|at| at.0 == id).count();
    [0, 1, 2, 3, 4, 5].map(|frame| [1, 2].map(|id| count(frame, id)))
}

#[test]
fn labels_are_changed_over_a_range() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    project(folder);
    done("range p copy --frame 0 --label red --from 5", folder);
    done("range p copy --frame 0 --label blue --from 1", folder);
    done("range p interpolate --label red", folder);
    let whole = areas(folder);
    assert!(
        whole
            .iter()
            .all(|area| area.iter().all(|&area| (800..1000).contains(&area))),
        "{whole:?}"
    );
    done("range p hide --label blue --from 4", folder);
    done("range p delete --label red --from 2 --to 3", folder);
    done("range p merge --label blue --into red --to 1", folder);
    let now = areas(folder);
    for (frame, [red, blue]) in now.into_iter().enumerate() {
        let [r, b] = whole[frame];
        let expected = match frame {
            0 | 1 => [r + b, 0],
            2 | 3 => [0, b],
            _ => [r, 0],
        };
        assert_eq!([red, blue], expected, "frame {frame}");
    }
}

#[test]
fn tracker_neither_restores_deleted_labels_nor_changes_locked_ones() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    project(folder);
    done("range p delete --label red --from 2 --to 3", folder);
    done("range p lock --label blue --from 5", folder);
    done("track p --tracker flow", folder);
    let seen = areas(folder);
    let is_seen = seen.map(|[red, blue]| [red > 400, blue > 400]);
    let expected = [
        [true, true],
        [true, true],
        [false, true],
        [false, true],
        [true, true],
        [true, false],
    ];
    assert_eq!(is_seen, expected, "{seen:?}");
}

#[test]
fn impossible_change_gives_one_error_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    project(folder);
    for (words, code, says) in [
        ("range p merge --label red", 2, "--into"),
        ("range p split --label red --into blue --frame 0", 2, "--at"),
        (
            "range p merge --label red --into red",
            1,
            "merged into itself",
        ),
        ("range p delete --label green", 1, "no label 'green'"),
        (
            "range p delete --from 4 --to 2",
            1,
            "frame 4 comes after frame 2",
        ),
        ("range p lock --to 9", 1, "frames 0 to 5"),
        ("range p copy --frame 3", 1, "frame 3 has no mask"),
        ("range p show", 1, "nothing to change"),
        (
            "range p split --label red --into blue --frame 0 --at 95,60",
            1,
            "is not label 'red'",
        ),
    ] {
        let before = std::fs::read(folder.join("p/project.toml")).unwrap();
        let out = ostra(&words.split(' ').collect::<Vec<_>>(), folder);
        let text = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{words}: {text}");
        assert!(
            text.contains(says) && (code == 2 || text.trim_end().lines().count() == 1),
            "{words}: {text}"
        );
        assert_eq!(
            std::fs::read(folder.join("p/project.toml")).unwrap(),
            before
        );
    }
}
