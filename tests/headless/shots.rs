//! Tests of images and videos of the cloud, through the command line.

use std::path::Path;
use std::process::Command;

use super::recording::Recording;
use crate::program::{done, refused};

/// Returns a project whose red thing is labelled on all four frames and fused.
fn voted(recording: &Recording) -> String {
    let project = recording.project();
    done(&["label", &project, "thing", "--color", "#d02818"]);
    done(&[
        "prompt", &project, "--frame", "1", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    assert!(refused(&["shot", &project, &recording.path("early.png")]).contains("fuse"));
    done(&["fuse", &project, "--voxel", "0.01"]);
    project
}

#[test]
fn every_colouring_gives_the_expected_colour() {
    let recording = Recording::new();
    let project = voted(&recording);
    let shot = recording.path("shot.png");
    let wanted = [
        ("rgb", [210, 40, 30]),
        ("labels", [208, 40, 24]),
        ("confidence", [253, 231, 37]),
        ("conflict", [68, 1, 84]),
        ("views", [253, 231, 37]),
        ("normals", [128, 128, 0]),
    ];
    for (color, wanted) in wanted {
        done(&[
            "shot", &project, &shot, "--color", color, "--size", "200x160",
        ]);
        let image = image::open(&shot).unwrap().to_rgb8();
        assert_eq!(image.dimensions(), (200, 160));
        let middle = image.get_pixel(100, 80).0;
        assert!(
            middle.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) <= 8),
            "{color}: {middle:?}"
        );
    }
    done(&[
        "shot", &project, &shot, "--color", "height", "--size", "200x160",
    ]);
    let image = image::open(&shot).unwrap().to_rgb8();
    let [above, below] = [55, 105].map(|y| image.get_pixel(100, y).0);
    assert!(
        above[0] > below[0] && above[1] > below[1],
        "yellow {above:?} is above violet {below:?}"
    );
    let message = refused(&[
        "shot", &project, &shot, "--color", "views", "--model", "mesh",
    ]);
    assert!(message.contains("--model cloud"), "{message}");
}

#[test]
fn transparent_image_covers_only_drawn_pixels() {
    let recording = Recording::new();
    let project = voted(&recording);
    for (model, partly) in [("cloud", false), ("mesh", true)] {
        let shot = recording.path("shot.png");
        done(&[
            "shot",
            &project,
            &shot,
            "--model",
            model,
            "--transparent",
            "--size",
            "400x100",
        ]);
        let image = image::open(&shot).unwrap();
        assert!(image.color().has_alpha(), "{model}");
        let image = image.to_rgba8();
        assert_eq!(
            (image.get_pixel(200, 50).0[3], image.get_pixel(2, 50).0[3]),
            (255, 0),
            "{model}"
        );
        let between = image
            .pixels()
            .filter(|pixel| !matches!(pixel.0[3], 0 | 255))
            .count();
        assert_eq!(between > 0, partly, "{model}: borders of a mesh are smooth");
    }
}

/// Returns a command that writes a turntable video of six images.
fn turntable<'a>(project: &'a str, shot: &'a str, video: &'a str, size: &'a str) -> [&'a str; 11] {
    [
        "shot",
        project,
        shot,
        "--size",
        size,
        "--turntable",
        video,
        "--seconds",
        "1",
        "--fps",
        "6",
    ]
}

#[test]
fn turntable_video_without_ffmpeg_names_the_missing_program() {
    let recording = Recording::new();
    let project = voted(&recording);
    let (shot, video) = (recording.path("shot.png"), recording.path("turn.mp4"));
    let words = turntable(&project, &shot, &video, "161x120");
    let without = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(words)
        .env("PATH", "")
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&without.stderr).into_owned();
    assert!(
        without.status.code() == Some(1) && message.contains("install ffmpeg"),
        "{message}"
    );
}

#[test]
#[ignore = "needs ffmpeg: add --include-ignored"]
fn turntable_video_has_the_requested_images() {
    let recording = Recording::new();
    let project = voted(&recording);
    let (shot, video) = (recording.path("shot.png"), recording.path("turn.mp4"));
    let words = turntable(&project, &shot, &video, "161x120");
    done(&words);
    let count = "-v error -count_frames -select_streams v:0 -show_entries stream=width,height,nb_read_frames -of csv=p=0";
    let probed = Command::new("ffprobe")
        .args(count.split(' '))
        .arg(&video)
        .output()
        .unwrap();
    assert_eq!(
        String::from_utf8_lossy(&probed.stdout).trim(),
        "162,120,6",
        "odd sides get a column more"
    );
    assert!(!Path::new(&recording.path("turn.part.mp4")).exists());
}

/// On a full disk ffmpeg may truncate a video and still exit successfully.
#[cfg(unix)]
#[test]
#[ignore = "needs ffmpeg: add --include-ignored"]
fn truncated_video_is_an_error() {
    use std::os::unix::fs::PermissionsExt;
    let recording = Recording::new();
    let project = voted(&recording);
    let (shot, video) = (recording.path("shot.png"), recording.path("turn.mp4"));
    let programs = recording.path("programs");
    std::fs::create_dir(&programs).unwrap();
    let path = std::env::var("PATH").unwrap();
    let short = format!(
        "#!/bin/sh\nfor last; do :; done\nPATH='{path}' ffmpeg \"$@\" || exit\nfile=${{last#file:}}\n\
         head -c 1500 \"$file\" > \"$file.short\"\nmv \"$file.short\" \"$file\"\n"
    );
    std::fs::write(format!("{programs}/ffmpeg"), short).unwrap();
    std::fs::set_permissions(
        format!("{programs}/ffmpeg"),
        PermissionsExt::from_mode(0o755),
    )
    .unwrap();
    let words = turntable(&project, &shot, &video, "160x120");
    let output = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(words)
        .env("PATH", format!("{programs}:{path}"))
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.code() == Some(1) && message.contains("of 6 images"),
        "{message}"
    );
    assert!(!Path::new(&video).exists());
    done(&words);
}
