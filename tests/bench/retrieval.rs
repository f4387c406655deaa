//! How well similar appearance finds the image pairs that match, and the time that it takes.
//!
//! All pairs of each set are matched. A table shows which share of all pairs agrees, which share of
//! the pairs of each image with its most similar ones, and which share of the agreeing pairs these
//! are. Pair selection takes 5 similar images at first.
//!
//! `cargo bench --bench retrieval [-- banana castle dtu kitchen plant]`, by default all.

#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "a bench prints its table and may panic"
)]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use ostra_core::job::Progress;
use ostra_geometry::Camera;
use ostra_reconstruct::sfm::matching::NearestMatcher;
use ostra_reconstruct::sfm::retrieval::{Vocabulary, most_alike};
use ostra_reconstruct::sfm::{
    FeatureExtractor, Features, IntrinsicsPrior, MapCamera, MatchedImages, Sift, match_pairs,
};

#[path = "../support/data.rs"]
#[expect(
    dead_code,
    reason = "the benches share it with the integration tests and use a part"
)]
mod data;

/// Numbers of similar images that are looked at.
const COUNTS: [usize; 3] = [2, 5, 10];
/// Number of matches from which a pair agrees.
const ENOUGH: usize = 30;

/// Images of a data set: name, folder, and every how many are used.
const SETS: [(&str, &str, usize); 5] = [
    ("banana", "banana/images", 1),
    ("castle", "sceaux_castle/images", 1),
    ("dtu", "dtu_scan24/images", 1),
    ("kitchen", "redkitchen_rgbd_a/color", 3),
    ("plant", "romi_real_plant/images", 1),
];

fn main() {
    let folder = match data::find_data() {
        Ok(folder) => folder,
        Err(reason) => {
            println!("{reason}");
            return;
        }
    };
    let is_named = |name: &str| std::env::args().any(|word| word == name);
    let is_any_named = SETS.iter().any(|&(name, ..)| is_named(name));
    println!("set      images  of all   of the 2, 5, 10 most similar (of the agreeing)   time");
    for (name, images, every) in SETS {
        if !is_any_named || is_named(name) {
            measure(name, &folder.join(images), every);
        }
    }
}

fn measure(name: &str, folder: &Path, every: usize) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        println!("{name:8} {} is missing", folder.display());
        return;
    };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let (features, cameras): (Vec<Features>, Vec<MapCamera>) =
        paths.iter().step_by(every).map(|path| found(path)).unzip();
    let features: Vec<&Features> = features.iter().collect();
    let matching = matching_pairs(&features, &cameras);
    let start = Instant::now();
    let pooled = Vocabulary::learn(&features, 0).pool_all(&features);
    let ranked = COUNTS.map(|count| most_alike(&pooled, count, &BTreeSet::new()));
    let seconds = start.elapsed().as_secs_f64();
    let images = features.len();
    let all = images * (images - 1) / 2;
    let percent = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
    let shares = ranked.map(|pairs| {
        let hits = pairs.iter().filter(|pair| matching.contains(pair)).count();
        let (agree, found) = (percent(hits, pairs.len()), percent(hits, matching.len()));
        format!("{agree:3.0} % ({found:3.0} %)")
    });
    println!(
        "{name:8} {images:6}   {:3.0} %   {}   {seconds:.2} s",
        percent(matching.len(), all),
        shares.join("   ")
    );
}

/// Returns the features of an image, and a camera whose focal length is guessed.
fn found(path: &Path) -> (Features, MapCamera) {
    let image = image::open(path).unwrap().into_rgb8();
    let (width, height) = image.dimensions();
    let luma: Vec<f32> = image::DynamicImage::from(image)
        .into_luma8()
        .into_raw()
        .iter()
        .map(|&value| f32::from(value) / 255.0)
        .collect();
    let features = Sift::default().extract(&luma, width as usize, height as usize, None);
    let focal = 1.2 * f64::from(width.max(height));
    let middle = [0.5 * f64::from(width), 0.5 * f64::from(height)];
    let camera = MapCamera {
        intrinsics: Camera::pinhole(width, height, [focal; 2], middle),
        source: IntrinsicsPrior::Guessed,
    };
    (features.unwrap(), camera)
}

/// Returns all pairs of which enough matches agree.
fn matching_pairs(features: &[&Features], cameras: &[MapCamera]) -> BTreeSet<(usize, usize)> {
    let images = features.len();
    let pairs: Vec<(usize, usize)> = (0..images)
        .flat_map(|first| (first + 1..images).map(move |second| (first, second)))
        .collect();
    let matched = MatchedImages {
        features,
        cameras,
        cache: None,
    };
    let matcher = NearestMatcher::for_bytes();
    let tried = match_pairs(matched, &pairs, &matcher, 0, &Progress::default()).unwrap();
    let agrees = tried.iter().filter_map(|pair| pair.verified.as_ref());
    agrees
        .filter(|pair| pair.matches.len() >= ENOUGH)
        .map(|pair| (pair.images[0] as usize, pair.images[1] as usize))
        .collect()
}
