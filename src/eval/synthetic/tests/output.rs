use super::*;
use ostra_cloud::SceneError;

fn decode(path: &std::path::Path) -> (png::OutputInfo, Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    (info, bytes)
}

#[test]
fn written_files_match_the_rendering() {
    let dir = tempfile::tempdir().unwrap();
    let scene = built(&SceneOptions {
        views: 2,
        ..small(1)
    });
    scene.write(dir.path(), &Progress::default()).unwrap();
    for view in scene.views() {
        let rendered = scene.render(view);
        let path = |folder: &str| dir.path().join(folder).join(format!("{}.png", view.name));
        let (info, bytes) = decode(&path("color"));
        assert_eq!((info.width, info.height), (240, 320));
        assert_eq!(bytes, rendered.image.pixels.as_flattened());
        let (info, bytes) = decode(&path("depth"));
        assert_eq!(info.bit_depth, png::BitDepth::Sixteen);
        for (step, depth) in bytes.chunks(2).zip(&rendered.depth.depths) {
            let read = f64::from(u16::from_be_bytes([step[0], step[1]])) * Scene::DEPTH_UNIT_M;
            assert!((read - f64::from(*depth)).abs() <= 0.500_1 * Scene::DEPTH_UNIT_M);
        }
        let (info, bytes) = decode(&path("truth/masks"));
        assert_eq!(info.color_type, png::ColorType::Indexed);
        assert!(
            bytes
                .iter()
                .zip(&rendered.mask.ids)
                .all(|(&byte, id)| u16::from(byte) == id.0)
        );
    }
    let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap();
    let camera = &scene.views()[0].camera;
    assert!(
        read("sparse/cameras.txt").contains(&format!("1 PINHOLE 240 320 {} ", camera.focal_px.x))
    );
    let images = read("sparse/images.txt");
    let second = images
        .lines()
        .find(|line| line.ends_with(" 001.png"))
        .unwrap();
    let numbers: Vec<f64> = second
        .split(' ')
        .take(8)
        .map(|word| word.parse().unwrap())
        .collect();
    let pose = &scene.views()[1].camera_from_world;
    let expected = [
        pose.rotation.w,
        pose.rotation.x,
        pose.rotation.y,
        pose.rotation.z,
    ];
    assert_eq!(numbers[1..5], expected);
    assert_eq!(numbers[5..8], pose.translation.to_array());
    assert!(read("truth/traits.csv").lines().count() > 70);
    let labels: Vec<ostra_masks::Label> = serde_json::from_str(&read("truth/labels.json")).unwrap();
    assert_eq!(labels.len(), scene.tree().iter().count());
}

#[test]
fn error_names_the_folder_that_cannot_be_written() {
    let dir = tempfile::tempdir().unwrap();
    let taken = dir.path().join("taken");
    std::fs::write(&taken, "a file").unwrap();
    let error = built(&SceneOptions {
        views: 1,
        ..small(1)
    })
    .write(&taken, &Progress::default())
    .unwrap_err();
    assert!(error.to_string().contains("taken"), "{error}");
}

#[test]
fn photos_are_the_images_and_cameras_of_the_recording() {
    let [all, photos] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let scene = built(&SceneOptions {
        views: 2,
        width: 60,
        height: 80,
        ..small(1)
    });
    scene.write(all.path(), &Progress::default()).unwrap();
    scene
        .write_photos(photos.path(), &Progress::default())
        .unwrap();
    let mut names: Vec<_> = std::fs::read_dir(photos.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["color", "sparse"]);
    for file in ["color/000.png", "color/001.png", "sparse/images.txt"] {
        let bytes = |dir: &tempfile::TempDir| std::fs::read(dir.path().join(file)).unwrap();
        assert!(bytes(&all) == bytes(&photos), "{file}");
    }
}

#[test]
fn stopping_ends_the_writing() {
    let dir = tempfile::tempdir().unwrap();
    let progress = Progress::default();
    progress.stop();
    let stopped = built(&small(1)).write(dir.path(), &progress);
    assert!(matches!(stopped, Err(SceneError::Stopped(_))));
}

#[test]
fn options_out_of_range_are_rejected() {
    let refused = |options: SceneOptions| Scene::build(&options).unwrap_err().to_string();
    assert!(
        refused(SceneOptions {
            views: 0,
            ..small(1)
        })
        .contains("views")
    );
    assert!(
        refused(SceneOptions {
            rows: 0,
            ..small(1)
        })
        .contains("rows")
    );
    // Cameras that look down beyond the vertical.
    assert!(
        refused(SceneOptions {
            views: 100,
            rows: 100,
            ..small(1)
        })
        .contains("all rows")
    );
    assert!(
        refused(SceneOptions {
            width: 100_000,
            ..small(1)
        })
        .contains("width")
    );
    assert!(
        refused(SceneOptions {
            distance_m: f64::NAN,
            ..small(1)
        })
        .contains("distance")
    );
    let noise = Some(SensorNoise {
        step_m: 0.0,
        ..SensorNoise::default()
    });
    assert!(refused(SceneOptions { noise, ..small(1) }).contains("step"));
    let cloud = built(&small(1)).cloud(
        &TruthOptions {
            spacing_m: 0.0,
            ..TruthOptions::default()
        },
        &Progress::default(),
    );
    assert!(cloud.unwrap_err().to_string().contains("spacing"));
}

#[test]
fn noise_has_the_requested_spread() {
    let noise = SensorNoise::default();
    let exact = built(&small(1));
    let noisy = built(&SceneOptions {
        noise: Some(noise),
        ..small(1)
    });
    let (truth, spoilt) = (exact.render(&exact.views[1]), noisy.render(&noisy.views[1]));
    assert_eq!(spoilt, noisy.render(&noisy.views[1]));
    assert_eq!(truth, noisy.render_exact(&noisy.views[1]));
    assert_eq!(truth.mask, spoilt.mask);
    let pairs = || {
        truth
            .depth
            .depths
            .iter()
            .map(|&z| f64::from(z))
            .zip(spoilt.depth.depths.iter().map(|&z| f64::from(z)))
    };
    assert!(pairs().all(|(_, z)| (z / noise.step_m - (z / noise.step_m).round()).abs() < 1e-3));
    let spread = |low: f64, high: f64| {
        let errors: Vec<f64> = pairs()
            .filter(|&(z, m)| z >= low && z < high && (m - z).abs() < 0.02)
            .map(|(z, m)| m - z)
            .collect();
        (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
    };
    let expected = |z: f64| {
        (noise.depth_base_m + noise.depth_growth * (z - 0.4_f64).powi(2)).hypot(noise.step_m / 3.46)
    };
    assert!(
        (spread(1.55, 1.65) / expected(1.6) - 1.0).abs() < 0.1,
        "{} {}",
        spread(1.55, 1.65),
        expected(1.6)
    );
    let missing = pairs().filter(|&(_, m)| m == 0.0).count();
    let flying = pairs()
        .filter(|&(z, m)| m > 0.0 && (m - z).abs() > 0.05)
        .count();
    assert!(missing > 200 && flying > 50, "{missing} {flying}");
    let colour = |a: &[[u8; 3]], b: &[[u8; 3]]| {
        let squares = a
            .as_flattened()
            .iter()
            .zip(b.as_flattened())
            .filter(|(a, _)| (20..236).contains(*a));
        let errors: Vec<f64> = squares
            .map(|(a, b)| f64::from(*a) - f64::from(*b))
            .collect();
        (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
    };
    let sigma = colour(&truth.image.pixels, &spoilt.image.pixels);
    assert!((sigma / noise.color_sigma - 1.0).abs() < 0.1, "{sigma}");
}
