//! A small synthetic recording.

use image::{GrayImage, ImageBuffer, Luma, RgbImage};
use tempfile::TempDir;

use crate::program::done;

/// A recording of four 64×48 frames: a red square at 1 m in front of a grey wall at 2 m.
///
/// The cameras stand side by side.
pub struct Recording {
    dir: TempDir,
}

impl Recording {
    pub fn new() -> Self {
        let dir = TempDir::new().unwrap();
        for folder in ["color", "depth", "sparse"] {
            std::fs::create_dir(dir.path().join(folder)).unwrap();
        }
        let mut images = String::new();
        for k in 0..4_u32 {
            // Camera k is shifted by k · 2 cm to the right. With f = 60 px the square moves by 1.2
            // px per frame.
            let left = 20.0 - 1.2 * f64::from(k);
            let inside =
                |x: u32, y: u32| (f64::from(x) + 0.5 - left).abs() < 8.0 && (14..34).contains(&y);
            let color = RgbImage::from_fn(64, 48, |x, y| {
                if inside(x, y) {
                    image::Rgb([210, 40, 30])
                } else {
                    image::Rgb([90, 90, 96 + (x + 7 * k) as u8 % 3])
                }
            });
            color
                .save(dir.path().join(format!("color/{k}.png")))
                .unwrap();
            let depth: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_fn(64, 48, |x, y| {
                Luma([if inside(x, y) { 1000 } else { 2000 }])
            });
            depth
                .save(dir.path().join(format!("depth/{k}.png")))
                .unwrap();
            images += &format!(
                "{} 1 0 0 0 {} 0 0 1 {k}.png\n\n",
                k + 1,
                -0.02 * f64::from(k)
            );
        }
        std::fs::write(
            dir.path().join("sparse/cameras.txt"),
            "1 PINHOLE 64 48 60 60 32 24\n",
        )
        .unwrap();
        std::fs::write(dir.path().join("sparse/images.txt"), images).unwrap();
        std::fs::write(dir.path().join("sparse/points3D.txt"), "").unwrap();
        Self { dir }
    }

    pub fn path(&self, name: &str) -> String {
        self.dir.path().join(name).to_str().unwrap().to_owned()
    }

    /// Writes the ground-truth masks and returns their folder; the square has 16 × 20 pixels.
    pub fn truth(&self) -> String {
        let truth = self.path("truth");
        std::fs::create_dir(&truth).unwrap();
        for k in 0..4_u32 {
            let left = 20.0 - 1.2 * f64::from(k);
            let mask = GrayImage::from_fn(64, 48, |x, y| {
                Luma([
                    u8::from((f64::from(x) + 0.5 - left).abs() < 8.0 && (14..34).contains(&y))
                        * 255,
                ])
            });
            mask.save(format!("{truth}/{k}.png")).unwrap();
        }
        truth
    }

    pub fn project(&self) -> String {
        let project = self.path("project");
        let [color, depth, sparse] = ["color", "depth", "sparse"].map(|name| self.path(name));
        done(&[
            "new",
            &project,
            "--frames",
            &color,
            "--depth",
            &depth,
            "--cameras",
            &sparse,
        ]);
        project
    }
}
