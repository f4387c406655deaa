use std::fs;

use super::*;

fn image(path: PathBuf, width: u32, height: u32) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::RgbImage::from_pixel(width, height, image::Rgb([90, 80, 70]))
        .save(path)
        .unwrap();
}

fn depth(path: PathBuf) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::ImageBuffer::from_pixel(16, 12, image::Luma([1500_u16]))
        .save(path)
        .unwrap();
}

fn look(paths: &[PathBuf]) -> Survey {
    let request = SurveyRequest {
        paths: paths.to_vec(),
        depth_unit: 0.001,
        ..SurveyRequest::default()
    };
    survey_frames(&request, &Progress::default()).unwrap()
}

/// Writes three images of 16 × 12 pixels below `folder`, with depth next to them.
fn recording(folder: &Path) {
    for k in 0..3 {
        image(folder.join(format!("color/{k}.png")), 16, 12);
        depth(folder.join(format!("depth/{k}.png")));
    }
}

fn found(frames: usize, folder: &Path) -> Option<FoundDepth> {
    Some(FoundDepth {
        frames,
        folder: folder.canonicalize().unwrap(),
    })
}

#[test]
fn photos_are_counted_and_other_sizes_are_noticed() {
    let root = tempfile::tempdir().unwrap();
    let photos = root.path().join("rice/images");
    for k in 0..4 {
        image(photos.join(format!("{k}.png")), 16, 12);
    }
    image(photos.join("4.png"), 12, 16);
    fs::write(photos.join("5.png"), "cut off").unwrap();
    let survey = look(std::slice::from_ref(&photos));
    assert_eq!((survey.frames.len(), survey.is_video()), (6, false));
    assert_eq!(survey.size().unwrap().0, (16, 12));
    assert_eq!((survey.depth.as_ref(), survey.error.as_ref()), (None, None));
    assert!(
        survey.warnings[0].starts_with("1 of 6 images cannot be read and is shown as a grey tile"),
        "{:?}",
        survey.warnings
    );
    assert_eq!(
        survey.root,
        Some(root.path().join("rice-ostra")),
        "named by the folder that says what it is, and not inside the data"
    );
}

#[test]
fn depth_and_cameras_next_to_the_images_are_found() {
    let root = tempfile::tempdir().unwrap();
    let data = root.path().join("shelf");
    recording(&data);
    fs::create_dir(data.join("sparse")).unwrap();
    let mut poses = String::new();
    for k in 0..3 {
        poses += &format!("{} 1 0 0 0 0 0 {k} 1 {k}.png\n\n", k + 1);
    }
    fs::write(data.join("sparse/images.txt"), poses).unwrap();
    fs::write(
        data.join("sparse/cameras.txt"),
        "1 PINHOLE 16 12 20 20 8 6\n",
    )
    .unwrap();
    for place in [data.join("color"), data.clone()] {
        let survey = look(std::slice::from_ref(&place));
        assert_eq!(survey.error, None);
        assert_eq!(survey.depth, found(3, &data.join("depth")), "{place:?}");
        let cameras = survey.cameras.unwrap();
        assert_eq!((cameras.frames, cameras.path), (3, data.join("sparse")));
        assert_eq!(survey.root, Some(root.path().join("shelf-ostra")));
    }
}

#[test]
fn folders_of_images_and_depth_given_together_are_one_source() {
    let root = tempfile::tempdir().unwrap();
    recording(root.path());
    let [color, depth] = ["color", "depth"].map(|name| root.path().join(name));
    for paths in [[color.clone(), depth.clone()], [depth, color]] {
        let survey = look(&paths);
        assert_eq!(survey.frames.len(), 3);
        assert_eq!(survey.depth, found(3, &root.path().join("depth")));
    }
}

#[test]
fn depth_that_does_not_fit_is_left_out_with_a_warning() {
    let root = tempfile::tempdir().unwrap();
    for k in 0..2 {
        image(root.path().join(format!("color/{k}.png")), 32, 24);
        depth(root.path().join(format!("depth/{k}.png")));
    }
    let survey = look(&[root.path().join("color")]);
    assert_eq!((survey.error, survey.depth), (None, None));
    assert_eq!(survey.sources[0].depth, None);
    assert!(
        survey.warnings[0].contains("is left out") && survey.warnings[0].contains("does not fit"),
        "{:?}",
        survey.warnings
    );
}

#[test]
fn selected_files_are_one_frame_each() {
    let root = tempfile::tempdir().unwrap();
    let files: Vec<PathBuf> = (0..5)
        .map(|k| root.path().join(format!("plant/{k}.png")))
        .collect();
    files.iter().for_each(|file| image(file.clone(), 16, 12));
    let survey = look(&[3, 1, 2].map(|number: usize| files[number].clone()));
    let names: Vec<&str> = survey.frames.iter().map(|frame| &*frame.name).collect();
    assert_eq!(names, ["1.png", "2.png", "3.png"], "in natural order");
    assert_eq!(survey.root, Some(root.path().join("plant-ostra")));
}

#[test]
fn files_that_cannot_be_opened_are_reported() {
    let root = tempfile::tempdir().unwrap();
    let survey = look(&[root.path().join("nothing")]);
    assert!(survey.error.unwrap().contains("no such file or folder"));
    fs::create_dir(root.path().join("empty")).unwrap();
    let survey = look(&[root.path().join("empty")]);
    assert!(survey.error.unwrap().contains("no images in this folder"));
}

#[test]
fn suggested_folder_is_free() {
    let root = tempfile::tempdir().unwrap();
    let photos = root.path().join("rice");
    image(photos.join("1.png"), 16, 12);
    fs::create_dir(root.path().join("rice-ostra")).unwrap();
    fs::write(root.path().join("rice-ostra/notes.txt"), "").unwrap();
    assert_eq!(
        suggested_root(&photos),
        Some(root.path().join("rice-ostra-2"))
    );
    let video = root.path().join("walk.mp4");
    fs::write(&video, "").unwrap();
    assert_eq!(suggested_root(&video), Some(root.path().join("walk-ostra")));
}
