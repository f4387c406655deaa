//! Tests of masks and labels that other programs write.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use image::{GrayAlphaImage, GrayImage, Luma, LumaA};
use tempfile::TempDir;

/// A project of three 64×48 images.
struct Images {
    dir: TempDir,
}

impl Images {
    fn new() -> Self {
        let dir = TempDir::new().unwrap();
        std::fs::create_dir(dir.path().join("color")).unwrap();
        for k in 0..3_u8 {
            let image = GrayImage::from_fn(64, 48, |x, y| Luma([(x * 3 + y) as u8 + k]));
            image
                .save(dir.path().join(format!("color/{k}.png")))
                .unwrap();
        }
        let images = Self { dir };
        images.run(&[
            "new",
            &images.path("project"),
            "--frames",
            &images.path("color"),
        ]);
        images
    }

    fn path(&self, name: &str) -> String {
        self.dir.path().join(name).to_str().unwrap().to_owned()
    }

    /// Writes a text file and returns its folder.
    fn file(&self, name: &str, text: &str) -> String {
        let path: PathBuf = self.path(name).into();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path.parent().unwrap().to_str().unwrap().to_owned()
    }

    /// Writes a mask for every image and returns their folder.
    fn masks(&self, name: &str, value: impl Fn(u32, u32) -> u8) -> String {
        std::fs::create_dir_all(self.path(name)).unwrap();
        for k in 0..3 {
            GrayImage::from_fn(64, 48, |x, y| Luma([value(x, y)]))
                .save(self.path(&format!("{name}/{k}.png")))
                .unwrap();
        }
        self.path(name)
    }

    fn run(&self, args: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_ostra"))
            .args(args)
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .output()
            .unwrap()
    }

    /// Imports masks and returns the warnings.
    fn import(&self, masks: &str, more: &[&str]) -> String {
        let output = self.run(&[&["masks", &self.path("project"), "import", masks], more].concat());
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{text}");
        text
    }

    /// Imports masks that must be refused and returns the error.
    fn refused(&self, masks: &str, more: &[&str]) -> String {
        let output = self.run(&[&["masks", &self.path("project"), "import", masks], more].concat());
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{text}");
        text
    }

    /// Returns the paths of the project's labels.
    fn labels(&self) -> Vec<String> {
        let out = self.path("exported");
        let output = self.run(&[
            "masks",
            &self.path("project"),
            "export",
            &out,
            "--overwrite",
        ]);
        if !output.status.success() {
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(
                self.run(&["masks", &self.path("project"), "export", &out])
                    .status
                    .success(),
                "{text}"
            );
        }
        let text = std::fs::read_to_string(Path::new(&out).join("labels.json")).unwrap();
        let list: Vec<serde_json::Value> = serde_json::from_str(&text).unwrap();
        list.iter()
            .map(|label| label["name"].as_str().unwrap().to_owned())
            .collect()
    }
}

fn disc(x: u32, y: u32) -> f64 {
    (f64::from(x) - 30.2).hypot(f64::from(y) - 22.7)
}

#[test]
fn soft_masks_become_one_label() {
    let images = Images::new();
    let soft = images.masks("soft", |x, y| {
        (((12.0 - disc(x, y)) / 4.0 + 0.5).clamp(0.0, 1.0) * 255.0) as u8
    });
    assert!(images.import(&soft, &[]).contains("soft edges"));
    assert_eq!(images.labels(), ["1"]);
}

#[test]
fn void_value_gets_no_label() {
    let images = Images::new();
    let void = images.masks("void", |x, y| match disc(x, y) {
        ..10.0 => 1,
        ..12.0 => 255,
        ..16.0 => 2,
        _ => 0,
    });
    let warnings = images.import(&void, &[]);
    assert!(
        warnings.contains("of 3 masks have the value 255"),
        "{warnings}"
    );
    assert_eq!(images.labels(), ["1", "2"]);
}

#[test]
fn white_cut_outs_are_read_from_their_alpha_channel() {
    let images = Images::new();
    std::fs::create_dir(images.path("cut")).unwrap();
    for k in 0..3 {
        let mask = GrayAlphaImage::from_fn(64, 48, |x, y| {
            LumaA([255, if disc(x, y) < 10.0 { 255 } else { 0 }])
        });
        mask.save(images.path(&format!("cut/{k}.png"))).unwrap();
    }
    assert!(
        images
            .import(&images.path("cut"), &[])
            .contains("3 masks are cut-outs")
    );
    assert_eq!(images.labels(), ["1"]);
}

#[test]
fn label_files_of_other_programs_are_ignored() {
    let images = Images::new();
    let masks = images.masks("set/masks", |x, _| (x / 32) as u8);
    images.file("set/labels.json", r#"{"classes": ["leaf"]}"#);
    assert!(
        images
            .import(&masks, &[])
            .contains("labels.json was not used")
    );
    images.file("set/masks/labels.json", r#"["leaf"]"#);
    assert!(
        images
            .import(&masks, &[])
            .contains("labels.json was not used")
    );
    images.file("set/masks/labels.json", r#"[{"id": 0, "name": "leaf"}]"#);
    assert!(
        images
            .import(&masks, &[])
            .contains("labels.json was not used")
    );
    images.file(
        "set/masks/labels.json",
        r#"[{"id": 1, "name": "leaf", "parent": 2}]"#,
    );
    assert!(
        images
            .refused(&masks, &[])
            .contains("damaged list of labels")
    );
}

#[test]
fn coco_files_of_other_programs() {
    let images = Images::new();
    let coco = |name: &str, annotations: &str| {
        let text = format!(
            "\u{feff}{{\"images\": [{{\"id\": \"1\", \"file_name\": \"0.png\", \"width\": 64, \"height\": 48}}, \
             {{\"id\": 9, \"file_name\": \"0.png\", \"width\": 64, \"height\": 48}}], \
             \"categories\": [{{\"id\": 1, \"name\": \"leaf\", \"supercategory\": \"rice\", \"color\": \"#a60f2f\"}}, \
             {{\"id\": 2, \"name\": \"leaf\", \"supercategory\": \"weed\"}}], \"annotations\": {annotations}}}"
        );
        images.file(&format!("{name}/annotations.json"), &text)
    };
    let both = coco(
        "both",
        r#"[{"id": "a-b", "image_id": 1, "category_id": "1", "iscrowd": false, "area": NaN, "segmentation": [[1, 1, 9, 1, 9, 9]]},
            {"id": 2, "image_id": "9", "category_id": 2, "bbox": null, "segmentation": [[21, 1, 29, 1, 29, 9], [3, 3]]}]"#,
    );
    let warnings = images.import(&both, &["--format", "coco"]);
    for part in [
        "listed more than once",
        "1 polygons of fewer than three corners were left out (annotation 2)",
    ] {
        assert!(warnings.contains(part), "{warnings}");
    }
    let mut labels = images.labels();
    labels.sort();
    assert_eq!(labels, ["leaf", "leaf (weed)", "rice", "weed"]);
    let bad = coco(
        "bad",
        r#"[{"id": 2, "image_id": 1, "category_id": 1, "segmentation": [[3, 3]]}]"#,
    );
    assert!(
        images
            .refused(&bad, &["--format", "coco"])
            .contains("no annotation can be used")
    );
}

#[test]
fn yolo_names_are_found_or_reported_missing() {
    let line = "0 0.1 0.1 0.5 0.1 0.5 0.5\r\n1 0.6 0.6 0.9 0.6 0.9 0.9\r\n";
    for (file, text) in [
        ("labels/classes.txt", "\u{feff}leaf\r\nstem\r\n"),
        ("my-set.yaml", "names:\n  0: leaf\n  1: stem\n"),
    ] {
        let images = Images::new();
        images.file("set/labels/0.txt", line);
        images.file(&format!("set/{file}"), text);
        assert!(
            !images
                .import(&images.path("set"), &["--format", "yolo"])
                .contains("no class names")
        );
        assert_eq!(images.labels(), ["leaf", "stem"]);
    }
    let images = Images::new();
    images.file("set/labels/0.txt", line);
    assert!(
        images
            .import(&images.path("set"), &["--format", "yolo"])
            .contains("no class names were found")
    );
}

#[test]
fn large_headers_are_read_or_refused_quickly() {
    let images = Images::new();
    let labels: String = (1..=4000)
        .map(|id| format!("comment label {id} 0 a\n"))
        .collect();
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    images.file(
        "many.ply",
        &format!("ply\nformat ascii 1.0\n{labels}element vertex 1\n{xyz}end_header\n0 0 0\n"),
    );
    let many = images.path("many.ply");
    let eval = |cloud: &str| {
        images.run(&[
            "eval", "cloud", "--truth", cloud, "--result", cloud, "--within", "1",
        ])
    };
    let output = eval(&many);
    assert!(
        output.status.success(),
        "a list of 4000 labels of one name is read: {output:?}"
    );
    assert!(
        String::from_utf8_lossy(&output.stdout).contains("matched            1.0000"),
        "{output:?}"
    );
    images.file(
        "faces.ply",
        &format!("ply\nformat ascii 1.0\nelement vertex 9000000000\n{xyz}end_header\n0 0 0\n"),
    );
    let faces = images.path("faces.ply");
    let output = eval(&faces);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code() == Some(1) && text.contains("lists 9000000000"),
        "{text}"
    );
}
