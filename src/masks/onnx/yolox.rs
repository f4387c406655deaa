use std::path::Path;

use glam::DVec2;

use super::coco_classes::{CLASSES, class_of};
use super::non_maximum_suppression::non_maximum_suppression;
use super::resize::resized;
use crate::{GroundRequest, Grounded, MaskError, PxBox, TextGrounder};
use ostra_compute::nn::{Network, NnError, Tensor, load};
use ostra_core::image::ImageSize;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::Image;

/// Detects the 80 object classes of COCO with a small network; other words are rejected.
///
/// Ge, Liu, Wang, Li, Sun: "YOLOX: Exceeding YOLO Series in 2021", arXiv 2107.08430.
#[derive(Debug)]
pub struct Yolox {
    network: Network,
}

/// Side of the square that the network sees, pixels.
const SIDE: usize = 416;
/// Pixels of the square along each side of a cell, in the order of the network's output.
const STRIDES: [usize; 3] = [8, 16, 32];
/// Number of values per cell: centre, size, objectness, and one score per class.
const VALUES: usize = 5 + CLASSES.len();
/// Value of the padding around the image.
const PADDING: f32 = 114.0;
/// Default score threshold.
const LEAST_SCORE: f32 = 0.3;
/// Maximum IoU of two boxes of one class; above it they are the same object.
const MOST_OVERLAP: f64 = 0.45;

impl Yolox {
    /// Loads the network `yolox` from a model folder.
    ///
    /// # Errors
    /// Fails if it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path) -> Result<Self, NnError> {
        let missing = || NnError::Request("the catalogue has no file for `yolox`".to_owned());
        Ok(Self {
            network: load(folder, "yolox")?.pop().ok_or_else(missing)?,
        })
    }

    fn run(&self, image: &Image, scale: f64, progress: &Progress) -> Result<Vec<f32>, MaskError> {
        let input = Tensor::floats(&[1, 3, SIDE, SIDE], fed(image, scale))?;
        let is_wanted = || progress.check().is_ok();
        let given = self
            .network
            .run_while(&[("images", &input)], &is_wanted)?
            .ok_or(Stopped)?;
        let cells: usize = STRIDES.iter().map(|stride| (SIDE / stride).pow(2)).sum();
        let output = given
            .first()
            .filter(|output| output.shape() == [1, cells, VALUES]);
        let path = self.network.path().display();
        let unfit = || {
            MaskError::Network(format!(
                "{path}: does not give {cells} cells of {VALUES} values"
            ))
        };
        Ok(output.ok_or_else(unfit)?.as_floats().to_vec())
    }
}

impl TextGrounder for Yolox {
    fn name(&self) -> &'static str {
        "yolox"
    }

    fn vocabulary(&self) -> Option<&'static [&'static str]> {
        Some(&CLASSES)
    }

    fn ground(
        &self,
        image: &Image,
        request: &GroundRequest<'_>,
        progress: &Progress,
    ) -> Result<Vec<Grounded>, MaskError> {
        let classes = classes(request.phrases)?;
        if image.pixels.is_empty() {
            return Err(MaskError::Request(
                "there is nothing to find in an empty image; open another".into(),
            ));
        }
        progress.step(0, 1)?;
        let scale = scale(image);
        let given = self.run(image, scale, progress)?;
        let least = request.threshold.unwrap_or(LEAST_SCORE);
        let size = DVec2::new(image.width.into(), image.height.into());
        let mut found = Vec::new();
        for (phrase, class) in classes.into_iter().enumerate() {
            let mut of_class = things(&given, class, least, scale, size);
            // Stable sort: of equal scores that of the first cell.
            of_class.sort_by(|a, b| b.0.total_cmp(&a.0));
            let apart = non_maximum_suppression(of_class, MOST_OVERLAP, |(_, extent)| *extent);
            found.extend(apart.into_iter().map(|(score, extent)| Grounded {
                phrase,
                extent,
                score,
            }));
        }
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        progress.step(1, 1)?;
        Ok(found)
    }
}

/// Returns the class of each phrase.
fn classes(phrases: &[String]) -> Result<Vec<usize>, MaskError> {
    if phrases.is_empty() {
        return Err(MaskError::Request(
            "there is nothing to search for; enter one or more words".into(),
        ));
    }
    let unknown = |phrase: &str| {
        let words = CLASSES.join(", ");
        MaskError::Request(format!("yolox does not know '{phrase}'; it knows {words}"))
    };
    phrases
        .iter()
        .map(|phrase| class_of(phrase).ok_or_else(|| unknown(phrase)))
        .collect()
}

/// Returns the number of pixels of the square per pixel of the image.
fn scale(image: &Image) -> f64 {
    SIDE as f64 / f64::from(image.width.max(image.height))
}

/// Returns the image in the upper left of the square: blue, green and red planes, 0–255.
fn fed(image: &Image, scale: f64) -> Vec<f32> {
    let shown = |count: u32| ((f64::from(count) * scale) as usize).clamp(1, SIDE);
    let (columns, rows) = (shown(image.width), shown(image.height));
    let small = resized(&image.pixels, image.size(), ImageSize::new(columns, rows));
    let mut planes = vec![PADDING; 3 * SIDE * SIDE];
    for (channel, plane) in planes.chunks_exact_mut(SIDE * SIDE).enumerate() {
        for (out, row) in plane
            .chunks_exact_mut(SIDE)
            .zip(small.chunks_exact(columns))
        {
            out.iter_mut()
                .zip(row)
                .for_each(|(out, pixel)| *out = f32::from(pixel[2 - channel]));
        }
    }
    planes
}

/// Returns score and box, in image pixels, of every cell that detects an object of a class.
fn things(given: &[f32], class: usize, least: f32, scale: f64, size: DVec2) -> Vec<(f32, PxBox)> {
    let in_level = |stride: usize| (0..(SIDE / stride).pow(2)).map(move |at| (stride, at));
    let cells = STRIDES
        .into_iter()
        .flat_map(in_level)
        .zip(given.chunks_exact(VALUES));
    let thing = |((stride, at), values): ((usize, usize), &[f32])| {
        let score = values[4] * values[5 + class];
        let number = |at: usize| f64::from(values[at]);
        let cell = DVec2::new((at % (SIDE / stride)) as f64, (at / (SIDE / stride)) as f64);
        let middle = (DVec2::new(number(0), number(1)) + cell) * stride as f64;
        let half = DVec2::new(number(2).exp(), number(3).exp()) * stride as f64 / 2.0;
        let within = |corner: DVec2| (corner / scale).clamp(DVec2::ZERO, size);
        let extent = PxBox {
            min_px: within(middle - half),
            max_px: within(middle + half),
        };
        let is_there = score > least && extent.max_px.cmpgt(extent.min_px).all();
        is_there.then_some((score, extent))
    };
    cells.filter_map(thing).collect()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use ostra_compute::nn::Runtime;

    /// Loads the network.
    fn ready() -> Yolox {
        Runtime::find().unwrap();
        Yolox::load(&folder("OSTRA_MODELS", "../../../shared/models")).unwrap()
    }

    fn folder(variable: &str, default: &str) -> PathBuf {
        let default = || Path::new(env!("CARGO_MANIFEST_DIR")).join(default);
        std::env::var_os(variable).map_or_else(default, PathBuf::from)
    }

    fn read_image(path: &str) -> Image {
        let path = folder("OSTRA_DATA", "../../../shared/data").join(path);
        let image = image::open(&path).unwrap().to_rgb8();
        let pixels = image.pixels().map(|pixel| pixel.0).collect();
        Image {
            width: image.width(),
            height: image.height(),
            pixels,
        }
    }

    fn ground(
        yolox: &Yolox,
        image: &Image,
        phrases: &[&str],
        threshold: Option<f32>,
    ) -> Vec<Grounded> {
        let phrases: Vec<String> = phrases.iter().map(|&phrase| phrase.to_owned()).collect();
        yolox
            .ground(
                image,
                &GroundRequest {
                    phrases: &phrases,
                    threshold,
                },
                &Progress::default(),
            )
            .unwrap()
    }

    /// Returns the share of a box that is yellow.
    fn yellow(image: &Image, extent: &PxBox) -> f64 {
        let (min, max) = (extent.min_px.as_uvec2(), extent.max_px.as_uvec2());
        let pixels = (min.y..max.y).flat_map(|y| (min.x..max.x).map(move |x| image.at(x, y)));
        let is_yellow = |[r, g, b]: [u8; 3]| r > 110 && i32::from(r.min(g)) - i32::from(b) > 50;
        let (mut all, mut count) = (0, 0);
        pixels.for_each(|pixel| {
            all += 1;
            count += i32::from(is_yellow(pixel));
        });
        f64::from(count) / f64::from(all.max(1))
    }

    #[test]
    #[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
    fn bananas_are_found_on_photos_of_bananas() {
        let (yolox, mut on) = (ready(), 0);
        for number in [423, 427, 431, 435] {
            let image = read_image(&format!("banana/images/DSC_0{number}.jpg"));
            let found = ground(&yolox, &image, &["dog", "bananas"], None);
            println!("{number}: {found:?}");
            assert!(
                found.iter().all(|one| one.phrase == 1),
                "there is no dog on {number}: {found:?}"
            );
            assert!(found.windows(2).all(|pair| pair[0].score >= pair[1].score));
            on += usize::from(found.iter().any(|one| yellow(&image, &one.extent) > 0.25));
        }
        assert_eq!(on, 4, "a yellow box on every photo");
    }

    /// Returns the bounding box of the white pixels of an image.
    fn extent(truth: &Image) -> PxBox {
        let width = truth.width as usize;
        let inside = truth
            .pixels
            .iter()
            .enumerate()
            .filter(|(_, pixel)| pixel[0] > 127);
        let corners = inside.map(|(at, _)| DVec2::new((at % width) as f64, (at / width) as f64));
        let (min_px, max_px) = corners
            .map(|at| (at, at + 1.0))
            .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            .unwrap();
        PxBox { min_px, max_px }
    }

    #[test]
    #[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
    fn boxes_match_the_ground_truth() {
        let yolox = ready();
        for (clip, phrase) in [("blackswan", "bird"), ("car-shadow", "a car")] {
            let image = read_image(&format!("davis2016/JPEGImages/{clip}/00000.jpg"));
            let truth = extent(&read_image(&format!(
                "davis2016/Annotations/{clip}/00000.png"
            )));
            let found = ground(&yolox, &image, &[phrase], None);
            println!(
                "{clip}: {:.2} of {truth:?}, {found:?}",
                found[0].extent.iou(&truth)
            );
            assert!(found[0].extent.iou(&truth) > 0.8, "{clip}: {found:?}");
            assert!(ground(&yolox, &image, &[phrase], Some(0.99)).is_empty());
        }
    }

    #[test]
    #[ignore = "needs real data sets (OSTRA_DATA), networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
    fn unknown_words_are_rejected_with_a_list_of_the_known_ones() {
        let yolox = ready();
        let image = Image {
            width: 2,
            height: 2,
            pixels: vec![[0; 3]; 4],
        };
        for (phrases, reported) in [
            (vec!["banana".to_owned(), "panicle".to_owned()], "'panicle'"),
            (Vec::new(), "nothing to search for"),
        ] {
            let asked = GroundRequest {
                phrases: &phrases,
                threshold: None,
            };
            let text = yolox
                .ground(&image, &asked, &Progress::default())
                .unwrap_err()
                .to_string();
            assert!(text.contains(reported) && !text.contains('\n'), "{text}");
            assert_eq!(text.contains("dining table"), phrases.len() == 2, "{text}");
        }
        assert_eq!(yolox.vocabulary().unwrap().len(), 80);
        let stopped = Progress::default();
        stopped.stop();
        let phrases = ["cat".to_owned()];
        let asked = GroundRequest {
            phrases: &phrases,
            threshold: None,
        };
        assert!(matches!(
            yolox.ground(&image, &asked, &stopped),
            Err(MaskError::Stopped(_))
        ));
    }
}
