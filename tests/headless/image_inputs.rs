//! Tests of images, depth maps, camera files and folders of other programs and damaged disks.

use std::path::Path;
use std::process::Command;

use image::{
    DynamicImage, GrayAlphaImage, ImageBuffer, Luma, LumaA, Rgb, RgbImage, Rgba, RgbaImage,
};
use ostra_core::job::Progress;
use ostra_frames::{FrameFolder, FrameStore, OpenRequest, Opened, open};
use serde_json::Value;
use tiff::encoder::{TiffEncoder, colortype};

use super::recording::Recording;
use crate::program::{done, refused};

/// Runs a command that must succeed and returns its standard error output.
fn warned(args: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_ostra"))
        .args(args)
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{args:?}: {text}");
    text
}

fn frames_of(project: &str) -> Vec<Value> {
    let info: Value = serde_json::from_str(&done(&["info", project, "--json"])).unwrap();
    info["frames"].as_array().unwrap().clone()
}

fn opened(folder: &Path) -> Opened {
    let sources = vec![FrameFolder {
        frames: folder.into(),
        depth: None,
    }];
    open(
        &OpenRequest {
            sources,
            ..OpenRequest::default()
        },
        &Progress::default(),
    )
    .unwrap()
}

fn store() -> FrameStore {
    FrameStore::new(1 << 24)
}

fn reference() -> RgbImage {
    RgbImage::from_fn(64, 48, |x, y| {
        Rgb([x as u8 * 3, y as u8 * 4, (x * y % 251) as u8])
    })
}

#[test]
fn transparent_pixels_hide_their_colours() {
    let root = tempfile::tempdir().unwrap();
    let color = |x: u32| {
        if x < 32 {
            [255, 0, 255, 0]
        } else {
            [10, 200, 30, 255]
        }
    };
    RgbaImage::from_fn(64, 48, |x, _| Rgba(color(x)))
        .save(root.path().join("a.png"))
        .unwrap();
    RgbaImage::from_fn(64, 48, |x, _| Rgba(color(x)))
        .save(root.path().join("b.webp"))
        .unwrap();
    RgbaImage::from_fn(64, 48, |x, _| Rgba(color(x)))
        .save(root.path().join("c.tif"))
        .unwrap();
    let grey = |x: u32| {
        if x < 32 {
            LumaA([255, 0])
        } else {
            LumaA([40, 255])
        }
    };
    GrayAlphaImage::from_fn(64, 48, |x, _| grey(x))
        .save(root.path().join("d.png"))
        .unwrap();
    reference().save(root.path().join("e.png")).unwrap();
    let deep =
        DynamicImage::ImageRgba8(RgbaImage::from_fn(64, 48, |x, _| Rgba(color(x)))).into_rgba16();
    deep.save(root.path().join("f.png")).unwrap();
    let opened = opened(root.path());
    let warning = opened
        .warnings
        .iter()
        .find(|line| line.contains("alpha"))
        .unwrap();
    assert!(
        warning.starts_with("5 of 6 images have an alpha channel")
            && warning.contains("a.png, b.webp, c.tif")
    );
    let store = store();
    for frame in &opened.frames {
        let (image, opaque) = (
            store.image(frame).unwrap(),
            store.opaque_pixels(frame).unwrap(),
        );
        if frame.name == "e.png" {
            assert!(opaque.is_none() && image.at(9, 9) == reference().get_pixel(9, 9).0);
            continue;
        }
        assert_eq!(image.at(3, 3), [128; 3], "{}", frame.name);
        let solid = if frame.name == "d.png" {
            [40; 3]
        } else {
            [10, 200, 30]
        };
        assert_eq!(image.at(40, 3), solid, "{}", frame.name);
        let row = &opaque.unwrap()[64 * 20..64 * 21];
        assert!(
            row[..35].iter().all(|&opaque| !opaque) && row[35..].iter().all(|&opaque| opaque),
            "{}",
            frame.name
        );
    }
}

#[test]
fn opaque_alpha_channel_is_not_reported() {
    let root = tempfile::tempdir().unwrap();
    for name in ["a.png", "b.png"] {
        DynamicImage::ImageRgb8(reference())
            .into_rgba8()
            .save(root.path().join(name))
            .unwrap();
    }
    let opened = opened(root.path());
    assert!(opened.warnings.is_empty(), "{:?}", opened.warnings);
}

#[test]
fn float_images_of_usual_ranges_keep_their_colours() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    let encoder =
        |name: &str| TiffEncoder::new(std::fs::File::create(path(name)).unwrap()).unwrap();
    let scaled = |white: f32| {
        reference()
            .as_raw()
            .iter()
            .map(|&v| f32::from(v) / 255.0 * white)
            .collect::<Vec<f32>>()
    };
    for (name, white) in [("1.tif", 1.0), ("255.tif", 255.0), ("65535.tif", 65535.0)] {
        encoder(name)
            .write_image::<colortype::RGB32Float>(64, 48, &scaled(white))
            .unwrap();
    }
    let half: Vec<f32> = (0..64 * 48)
        .flat_map(|k| [51.0, 102.0, 204.0, if k % 64 < 32 { 0.0 } else { 255.0 }])
        .collect();
    encoder("alpha.tif")
        .write_image::<colortype::RGBA32Float>(64, 48, &half)
        .unwrap();
    let opened = opened(root.path());
    let warning = opened
        .warnings
        .iter()
        .find(|line| line.contains("divided"))
        .unwrap();
    assert!(
        warning.contains("3 images") && warning.contains("255.tif by 255, 65535.tif by 65535"),
        "{warning}"
    );
    for frame in &opened.frames {
        let image = store().image(frame).unwrap();
        if frame.name == "alpha.tif" {
            assert_eq!(
                (image.at(3, 3), image.at(40, 3)),
                ([128; 3], [51, 102, 204])
            );
            assert!(!store().opaque_pixels(frame).unwrap().unwrap()[3]);
        } else {
            assert_eq!(
                image.pixels.as_flattened(),
                reference().as_raw(),
                "{}",
                frame.name
            );
        }
    }
    for (k, value) in [f32::NAN, -20.0, 1e6].into_iter().enumerate() {
        let folder = path(&format!("refused {k}"));
        std::fs::create_dir(&folder).unwrap();
        let mut values = scaled(1.0);
        values[100] = value;
        encoder(&format!("refused {k}/a.tif"))
            .write_image::<colortype::RGB32Float>(64, 48, &values)
            .unwrap();
        let project = path("project").display().to_string();
        let error = refused(&["new", &project, "--frames", &folder.display().to_string()]);
        assert!(
            error.contains("a.tif: colours as floats must go from 0 to 1, 255 or 65535"),
            "{error}"
        );
    }
}

#[test]
fn unsupported_format_is_refused_with_its_path_and_a_hint() {
    let root = tempfile::tempdir().unwrap();
    for (name, bytes, hint) in [
        ("a.heic", &b"\0\0\0\x18ftypheic\0\0\0\0"[..], "heif-convert"),
        (
            "without ending",
            b"\0\0\0\x18ftypheic\0\0\0\0",
            "heif-convert",
        ),
        ("b.DNG", b"II*\0\x08\0\0\0", "magick"),
        ("c.bmp", b"BM", "magick"),
    ] {
        let path = root.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let project = root.path().join("project").display().to_string();
        let error = refused(&["new", &project, "--frames", path.to_str().unwrap()]);
        assert!(
            error.contains(hint) && !error.contains("video"),
            "{name}: {error}"
        );
    }
}

#[test]
fn unusual_image_encodings_keep_their_colours() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name);
    let expected = reference();
    DynamicImage::ImageRgb8(reference())
        .into_rgb16()
        .save(path("16bit.png"))
        .unwrap();
    expected
        .save_with_format(path("png named.jpg"), image::ImageFormat::Png)
        .unwrap();
    expected
        .save_with_format(path("upper.PNG"), image::ImageFormat::Png)
        .unwrap();
    // Some scanners and GDAL write BigTIFF.
    let mut big = TiffEncoder::new_big(std::fs::File::create(path("big.tif")).unwrap()).unwrap();
    big.write_image::<colortype::RGB8>(64, 48, expected.as_raw())
        .unwrap();
    let opened = opened(root.path());
    assert_eq!(
        (opened.frames.len(), opened.warnings.len()),
        (4, 0),
        "{:?}",
        opened.warnings
    );
    for frame in &opened.frames {
        assert_eq!(
            store().image(frame).unwrap().pixels.as_flattened(),
            expected.as_raw(),
            "{}",
            frame.name
        );
    }
}

#[test]
fn system_and_network_storage_folders_are_skipped() {
    let root = tempfile::tempdir().unwrap();
    let put = |name: &str| {
        let path = root.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        reference()
            .save_with_format(path, image::ImageFormat::Png)
            .unwrap();
    };
    put("IMG_1.png");
    for name in [
        "@eaDir/IMG_1.png/SYNOPHOTO_THUMB_XL.jpg",
        "#recycle/old.png",
        "sub/@Recycle/old.png",
        "lost+found/x.png",
        "__MACOSX/IMG_1.png",
        ".thumbnails/1.png",
        ".@__thumb/IMG_1.png",
        "._IMG_1.png",
        "$RECYCLE.BIN/a.png",
        "SYNOPHOTO_THUMB_M.jpg",
    ] {
        put(name);
    }
    let project = root.path().join("project").display().to_string();
    let warnings = warned(&["new", &project, "--frames", root.path().to_str().unwrap()]);
    assert!(
        warnings.contains("7 folders or thumbnails of the system are left out: #recycle, "),
        "{warnings}"
    );
    assert_eq!(frames_of(&project).len(), 1);
    // A folder that the user names explicitly is not skipped.
    assert_eq!(opened(&root.path().join("#recycle")).frames.len(), 1);
}

#[test]
fn unreadable_images_are_counted_and_named() {
    let root = tempfile::tempdir().unwrap();
    let photos = root.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    reference().save(photos.join("a.png")).unwrap();
    for name in ["b.HEIC", "c.heic", "d.bmp", "e.CR2", "notes.txt"] {
        std::fs::write(photos.join(name), "x").unwrap();
    }
    let project = root.path().join("project").display().to_string();
    let warnings = warned(&["new", &project, "--frames", photos.to_str().unwrap()]);
    assert!(
        warnings.contains("4 images are left out")
            && warnings.contains("b.HEIC, c.heic, d.bmp and 1 more")
    );
    assert!(warnings.contains("heif-convert"), "{warnings}");
    assert_eq!(frames_of(&project).len(), 1);
    std::fs::remove_file(photos.join("a.png")).unwrap();
    let error = refused(&[
        "new",
        &root.path().join("p2").display().to_string(),
        "--frames",
        photos.to_str().unwrap(),
    ]);
    assert!(
        error.contains("no images in this folder") && error.contains("heif-convert"),
        "{error}"
    );
}

#[test]
fn one_damaged_photo_does_not_refuse_its_folder() {
    let root = tempfile::tempdir().unwrap();
    let text = |name: &str| root.path().join(name).display().to_string();
    for folder in ["photos", "more"] {
        std::fs::create_dir(text(folder)).unwrap();
        for name in ["1.png", "2.png"] {
            reference()
                .save(root.path().join(folder).join(name))
                .unwrap();
        }
        let damaged = root.path().join(folder).join("DSC_0427.jpg");
        std::fs::write(damaged, "cut off").unwrap();
    }
    let project = text("project");
    for command in [
        ["new", &project, "--frames", &text("photos")],
        ["add", &project, "--frames", &text("more")],
    ] {
        let warnings = warned(&command);
        assert!(
            warnings.contains("1 of 3 images cannot be read and is shown as a grey tile")
                && warnings.contains("DSC_0427.jpg"),
            "{warnings}"
        );
    }
    assert_eq!(frames_of(&project).len(), 6);
    for name in ["1.png", "2.png"] {
        std::fs::write(root.path().join("photos").join(name), "").unwrap();
    }
    refused(&["new", &text("none"), "--frames", &text("photos")]);
}

#[test]
fn damaged_images_are_named_and_the_rest_is_processed() {
    let recording = Recording::new();
    let color = |k: u32| recording.path(&format!("color/{k}.png"));
    let whole = std::fs::read(color(1)).unwrap();
    std::fs::write(color(1), &whole[..whole.len() - 30]).unwrap(); // truncated
    std::fs::write(color(2), "").unwrap(); // empty
    let project = recording.path("project");
    let [frames, depth, sparse] = ["color", "depth", "sparse"].map(|name| recording.path(name));
    let warnings = warned(&[
        "new",
        &project,
        "--frames",
        &frames,
        "--depth",
        &depth,
        "--cameras",
        &sparse,
    ]);
    assert!(
        warnings.contains("2 of 4 images cannot be read and are shown as grey tiles"),
        "{warnings}"
    );
    assert!(
        warnings.contains("1.png: the image is damaged")
            && warnings.contains("2.png: the file is empty")
    );
    assert_eq!(frames_of(&project).len(), 4, "they keep their places");
    let fused = warned(&["fuse", &project, "--voxel", "0.02"]);
    assert!(
        fused.contains("cannot be read") && fused.contains("1.png"),
        "{fused}"
    );
    // Image exports and scaling continue without them, too.
    let [flat, depths] = ["flat", "depths"].map(|name| recording.path(name));
    let exported = warned(&[
        "export",
        &project,
        "--undistorted",
        &flat,
        "--depths",
        &depths,
    ]);
    assert!(
        exported.contains("2 frames whose image cannot be read are left out"),
        "{exported}"
    );
    let names = |folder: &str| std::fs::read_dir(folder).unwrap().count();
    // Depth comes from separate files; that of an image without a size cannot be checked against
    // it.
    assert_eq!(
        (names(&format!("{flat}/images")), names(&depths)),
        (2, 3 + 1),
        "with the list of exports"
    );
    let model = std::fs::read_to_string(format!("{flat}/sparse/images.txt")).unwrap();
    assert!(
        model.contains("0.png") && model.contains("3.png") && !model.contains("1.png"),
        "{model}"
    );
    // With the file restored, the frame is complete again.
    std::fs::write(color(1), &whole).unwrap();
    assert!(!warned(&["fuse", &project, "--voxel", "0.02"]).contains("1.png"));
}

#[test]
fn simulated_user_skips_unreadable_frames() {
    let recording = Recording::new();
    let (project, truth) = (recording.project(), recording.truth());
    for file in ["color/1.png", "depth/2.png"] {
        std::fs::write(recording.path(file), "").unwrap();
    }
    let message = warned(&[
        "eval",
        "interact",
        "--frames",
        &project,
        "--truth",
        &truth,
        "--tracker",
        "geometry",
    ]);
    assert!(
        message.contains("2 frames cannot be read") && message.contains("1.png, 2.png"),
        "{message}"
    );
}

#[test]
fn clicks_and_geometry_tracker_continue_without_an_unreadable_depth() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "thing"]);
    std::fs::write(recording.path("depth/1.png"), "").unwrap();
    let prompt = |frame: &str| {
        warned(&[
            "prompt", &project, "--frame", frame, "--label", "thing", "--click", "20,24",
        ])
    };
    let message = prompt("1");
    assert!(
        message.contains("1.png has a depth that cannot be read"),
        "{message}"
    );
    assert!(
        !prompt("0").contains("cannot be read"),
        "a neighbour's depth is of no concern"
    );
    let message = warned(&["track", &project, "--tracker", "geometry"]);
    assert!(
        message.contains("1 frame cannot be read") && message.contains("1.png"),
        "{message}"
    );
    assert_eq!(frames_of(&project)[3]["mask"], "tracked");
}

#[test]
fn exported_depths_and_other_float_depths_are_read_back() {
    let recording = Recording::new();
    let project = recording.project();
    let (exported, again, color) = (
        recording.path("exported"),
        recording.path("again"),
        recording.path("color"),
    );
    done(&["export", &project, "--depths", &exported]);
    let warnings = warned(&["new", &again, "--frames", &color, "--depth", &exported]);
    assert!(
        warnings.contains("4 depths are floats: one unit is taken for 1 m"),
        "{warnings}"
    );
    let back = recording.path("back");
    done(&["export", &again, "--depths", &back]);
    for k in 0..4 {
        let [first, second] =
            [&exported, &back].map(|folder| std::fs::read(format!("{folder}/{k}.tiff")).unwrap());
        assert_eq!(first, second);
    }
    let refused = refused(&["new", &recording.path("p3"), "--frames", &exported]);
    assert!(
        refused.contains("is depth, not an image; give it with --depth"),
        "{refused}"
    );
}

#[test]
fn depth_of_every_sample_type_is_in_metres_and_unknown_is_zero() {
    let root = tempfile::tempdir().unwrap();
    let request = |name: &str, unit: f64| {
        let [frames, depth] = ["color", name].map(|folder| root.path().join(folder));
        let sources = vec![FrameFolder {
            frames,
            depth: Some(depth),
        }];
        OpenRequest {
            sources,
            depth_unit: unit,
            ..OpenRequest::default()
        }
    };
    for folder in ["color", "f32", "f64", "u32", "i16"] {
        std::fs::create_dir(root.path().join(folder)).unwrap();
    }
    RgbImage::new(3, 2)
        .save(root.path().join("color/a.png"))
        .unwrap();
    let encoder = |name: &str| {
        TiffEncoder::new(std::fs::File::create(root.path().join(name).join("a.tif")).unwrap())
            .unwrap()
    };
    let floats = [1.5, f32::NAN, f32::INFINITY, -1.0, f32::NEG_INFINITY, 0.25];
    encoder("f32")
        .write_image::<colortype::Gray32Float>(3, 2, &floats)
        .unwrap();
    encoder("f64")
        .write_image::<colortype::Gray64Float>(3, 2, &floats.map(f64::from))
        .unwrap();
    encoder("u32")
        .write_image::<colortype::Gray32>(3, 2, &[1500, 0, u32::MAX, 0, 0, 250])
        .unwrap();
    encoder("i16")
        .write_image::<colortype::GrayI16>(3, 2, &[1500, -1, i16::MAX, i16::MIN, 0, 250])
        .unwrap();
    for name in ["f32", "f64", "u32", "i16"] {
        let opened = open(&request(name, 0.001), &Progress::default()).unwrap();
        let depth = store().depth(&opened.frames[0]).unwrap().unwrap();
        assert_eq!(depth.depths, [1.5, 0.0, 0.0, 0.0, 0.0, 0.25], "{name}");
    }
}

#[test]
fn unsupported_variants_are_not_called_damaged() {
    let root = tempfile::tempdir().unwrap();
    let path = root.path().join("five bands.tif");
    let mut encoder = TiffEncoder::new(std::fs::File::create(&path).unwrap()).unwrap();
    let mut page = encoder.new_image::<colortype::Gray8>(4, 3).unwrap();
    // Photometric interpretation 3 is a colour palette.
    page.encoder()
        .write_tag(tiff::tags::Tag::PhotometricInterpretation, 3_u16)
        .unwrap();
    page.write_data(&[0; 12]).unwrap();
    let error = refused(&[
        "new",
        &root.path().join("p").display().to_string(),
        "--frames",
        path.to_str().unwrap(),
    ]);
    assert!(
        error.contains("colour palette")
            && error.contains("not supported")
            && !error.contains("damaged"),
        "{error}"
    );
}

/// Returns a PNG that declares this size and ends after its header.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut whole = std::io::Cursor::new(Vec::new());
    RgbImage::new(1, 1)
        .write_to(&mut whole, image::ImageFormat::Png)
        .unwrap();
    let mut bytes = whole.into_inner();
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let crc = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&crc.to_be_bytes());
    bytes
}

fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            if crc & 1 == 1 {
                crc >> 1 ^ 0xedb8_8320
            } else {
                crc >> 1
            }
        })
    };
    !bytes.iter().fold(u32::MAX, step)
}

/// Returns a lossy WebP whose canvas and frame differ in size.
fn webp(canvas: (u32, u32), frame: u16) -> Vec<u8> {
    let side = |side: u32| (side - 1).to_le_bytes()[..3].to_vec();
    let mut body = b"WEBPVP8X\x0a\0\0\0\0\0\0\0".to_vec();
    body.extend([side(canvas.0), side(canvas.1)].concat());
    body.extend(b"VP8 \x0a\0\0\0\x10\0\0\x9d\x01\x2a");
    body.extend([frame.to_le_bytes(), frame.to_le_bytes()].concat());
    [b"RIFF", &(body.len() as u32).to_le_bytes()[..], &body].concat()
}

#[test]
fn sizes_are_checked_before_anything_is_decoded() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "a"]);
    for (bytes, size) in [
        (png_header(65_535, 3000), "65535 × 3000"),
        (webp((600, 600), 600), "600 × 600"),
    ] {
        std::fs::write(recording.path("color/0.png"), bytes).unwrap();
        let error = refused(&[
            "prompt", &project, "--frame", "0", "--label", "a", "--click", "5,5",
        ]);
        assert!(
            error.contains(&format!("it is {size} pixels now but was 64 × 48")),
            "{error}"
        );
    }
    std::fs::write(recording.path("color/0.png"), webp((64, 48), 16_383)).unwrap();
    let error = refused(&[
        "prompt", &project, "--frame", "0", "--label", "a", "--click", "5,5",
    ]);
    assert!(
        error.contains("its frames have another size than its header"),
        "{error}"
    );
    for (width, height) in [(1 << 28, 1), (16_000, 16_000), (70_000, 2), (0, 5)] {
        std::fs::write(recording.path("bomb.png"), png_header(width, height)).unwrap();
        let error = refused(&[
            "new",
            &recording.path("p2"),
            "--frames",
            &recording.path("bomb.png"),
        ]);
        assert!(error.contains("bomb.png"), "{error}");
    }
}

#[test]
fn cameras_of_impossible_size_in_a_project_are_refused() {
    let recording = Recording::new();
    let project = recording.project();
    let file = format!("{project}/project.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    for (old, new) in [
        ("width = 64", "width = 4000000000"),
        ("width = 64", "width = 63"),
        ("height = 48", "height = 0"),
    ] {
        assert!(text.contains(old));
        std::fs::write(&file, text.replacen(old, new, 1)).unwrap();
        let error = refused(&["export", &project, "--undistorted", &recording.path("out")]);
        assert!(
            error.contains("project.toml") && error.contains("pixels"),
            "{error}"
        );
    }
}

#[test]
fn lost_frames_have_no_camera() {
    let recording = Recording::new();
    let [color, poses] = ["color", "poses"].map(|name| recording.path(name));
    std::fs::create_dir(&poses).unwrap();
    for (k, value) in [(0, "1"), (1, "nan"), (2, "-inf"), (3, "0")] {
        let row = |k: usize| {
            (0..4)
                .map(|at| if at == k { value } else { "0" })
                .collect::<Vec<_>>()
                .join(" ")
        };
        let last = if value == "1" {
            "0 0 0 1".into()
        } else {
            row(3)
        };
        std::fs::write(
            format!("{poses}/{k}.txt"),
            [row(0), row(1), row(2), last].join("\r\n"),
        )
        .unwrap();
    }
    let project = recording.path("project");
    let warnings = warned(&[
        "new",
        &project,
        "--frames",
        &color,
        "--cameras",
        &poses,
        "--intrinsics",
        "60,60,32,24",
    ]);
    assert!(
        warnings.contains("3 of 4 frames have no usable camera")
            && warnings.contains("1.png, 2.png, 3.png")
    );
    assert_eq!(warnings.matches("finite").count(), 1, "{warnings}");
    let posed: Vec<bool> = frames_of(&project)
        .iter()
        .map(|frame| frame["camera"].as_bool().unwrap())
        .collect();
    assert_eq!(posed, [true, false, false, false]);
}

#[test]
fn byte_order_marks_in_camera_files_are_skipped() {
    let recording = Recording::new();
    let color = recording.path("color");
    let with_mark =
        |path: &str, text: &str| std::fs::write(path, format!("\u{feff}{text}")).unwrap();
    for name in ["cameras.txt", "images.txt", "points3D.txt"] {
        let path = recording.path(&format!("sparse/{name}"));
        with_mark(
            &path,
            &std::fs::read_to_string(&path)
                .unwrap()
                .replace('\n', "\r\n"),
        );
    }
    let k = recording.path("K.txt");
    with_mark(&k, "60 0 31.5\n0 60 23.5\n0 0 1\n");
    let log = recording.path("utf16.log");
    let text: String = (0..4)
        .map(|k| format!("{k} {k} {}\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", k + 1))
        .collect();
    let units: Vec<u8> = format!("\u{feff}{text}")
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    std::fs::write(&log, units).unwrap();
    for (name, cameras) in [("p1", recording.path("sparse")), ("p2", log)] {
        let project = recording.path(name);
        done(&[
            "new",
            &project,
            "--frames",
            &color,
            "--cameras",
            &cameras,
            "--intrinsics",
            &k,
        ]);
        assert!(
            frames_of(&project)
                .iter()
                .all(|frame| frame["camera"] == true)
        );
    }
}

#[cfg(unix)]
#[test]
fn named_pipes_are_refused_immediately() {
    let recording = Recording::new();
    let project = recording.project();
    done(&["label", &project, "a"]);
    let [pipe, color] = ["pipe", "color"].map(|name| recording.path(name));
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    for args in [
        &["new", &recording.path("p1"), "--frames", &pipe][..],
        &[
            "new",
            &recording.path("p3"),
            "--frames",
            &color,
            "--cameras",
            &pipe,
        ],
        &[
            "new",
            &recording.path("p4"),
            "--frames",
            &color,
            "--intrinsics",
            &pipe,
        ],
    ] {
        let error = refused(args);
        assert!(
            error.contains("a named pipe, not a regular file"),
            "{args:?}: {error}"
        );
        assert_eq!(error.matches("a named pipe").count(), 1, "{error}");
    }
    std::fs::remove_file(recording.path("color/0.png")).unwrap();
    std::fs::rename(&pipe, recording.path("color/0.png")).unwrap();
    let error = refused(&[
        "prompt", &project, "--frame", "0", "--label", "a", "--click", "5,5",
    ]);
    assert!(error.contains("a named pipe"), "{error}");
}

#[test]
fn one_unusable_depth_does_not_discard_the_others() {
    let recording = Recording::new();
    let [color, depth, project] = ["color", "depth", "project"].map(|name| recording.path(name));
    ImageBuffer::<Luma<u16>, Vec<u16>>::new(32, 24)
        .save(format!("{depth}/2.png"))
        .unwrap();
    let warnings = warned(&["new", &project, "--frames", &color, "--depth", &depth]);
    assert!(
        warnings.contains("1 depths cannot be used")
            && warnings.contains("2.png: depth of 32 × 24"),
        "{warnings}"
    );
    let with_depth: Vec<bool> = frames_of(&project)
        .iter()
        .map(|frame| frame["depth"].as_bool().unwrap())
        .collect();
    assert_eq!(with_depth, [true, true, false, true]);
}

#[test]
fn fusion_without_its_images_names_the_missing_one() {
    let recording = Recording::new();
    let project = recording.project();
    std::fs::rename(recording.path("color"), recording.path("moved")).unwrap();
    for more in [&[][..], &["--voxel", "0.01"]] {
        let message = refused(&[&["fuse", &project], more].concat());
        assert!(
            message.contains("color") && message.contains("ostra relocate"),
            "{message}"
        );
    }
}

#[test]
fn registration_without_its_images_names_the_missing_one() {
    let recording = Recording::new();
    let project = recording.project();
    std::fs::rename(recording.path("color"), recording.path("moved")).unwrap();
    for method in ["rgbd", "sfm"] {
        let message = refused(&["reconstruct", &project, "--method", method]);
        assert!(
            message.contains("color") && message.contains("ostra relocate"),
            "{method}: {message}"
        );
    }
}
