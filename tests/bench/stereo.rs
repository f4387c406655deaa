//! Seconds per view of PatchMatch stereo on CPU and GPU, on a synthetic textured scene.
//!
//! Measures a search from the images only and a round with geometric consistency, and how well CPU
//! and GPU agree.
//!
//! `cargo bench --bench stereo [-- WIDTHxHEIGHT…]`, by default 640x480 and 1920x1080.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use glam::{DQuat, DVec2, DVec3};
use ostra_compute::gpu::{Device, Software};
use ostra_core::job::Progress;
use ostra_geometry::{Camera, Pose};
use ostra_reconstruct::stereo::StereoEngine;
use ostra_reconstruct::stereo::patchmatch::{
    DepthSearch, PatchMatchOptions, Plane, PlaneMap, PosedImage, Round, Tones,
};

/// Number of images: a reference and its sources.
const VIEWS: usize = 5;

#[expect(clippy::print_stdout, reason = "a bench speaks to the user")]
fn main() -> Result<(), Box<dyn Error>> {
    let mut engines = vec![StereoEngine::Cpu];
    match Device::open(Software::Allowed).and_then(|device| StereoEngine::on(Arc::new(device))) {
        Ok(engine) => engines.push(engine),
        Err(error) => println!("only the processor: {error}"),
    }
    let named: Vec<(u32, u32)> = std::env::args().filter_map(|word| size(&word)).collect();
    for (width, height) in if named.is_empty() {
        vec![(640, 480), (1920, 1080)]
    } else {
        named
    } {
        let images: Vec<Arc<PosedImage>> = (0..VIEWS)
            .map(|index| image(index, width, height))
            .collect();
        let mut cpu: Option<[PlaneMap; 2]> = None;
        for engine in &engines {
            let (founds, [first, consistent]) = timed(engine, &images)?;
            println!(
                "{width}x{height}, {} sources, on {}: {first:.2} s, consistent round {consistent:.2} s",
                VIEWS - 1,
                engine.name()
            );
            match &cpu {
                None => cpu = Some(founds),
                Some(cpu) => {
                    let shares = [share(&cpu[0], &founds[0]), share(&cpu[1], &founds[1])];
                    println!(
                        "  within 0.1 % of the processor's depth: {:.2} % and {:.2} %",
                        shares[0], shares[1]
                    );
                }
            }
        }
    }
    Ok(())
}

fn size(word: &str) -> Option<(u32, u32)> {
    let (width, height) = word.split_once('x')?;
    Some((width.parse().ok()?, height.parse().ok()?))
}

/// Returns the results of both searches and their seconds.
///
/// The second search starts from the first result and the sources' true planes.
fn timed(
    engine: &StereoEngine,
    images: &[Arc<PosedImage>],
) -> Result<([PlaneMap; 2], [f64; 2]), Box<dyn Error>> {
    let (options, progress) = (PatchMatchOptions::default(), Progress::default());
    let (reference, sources) = (&*images[0], &images[1..]);
    let task = DepthSearch {
        reference,
        sources,
        depth_range: [1.2, 8.0],
        seeds: &[],
        allowed: None,
    };
    let begun = Instant::now();
    let first = engine.search(&task, &options, &progress)?;
    let seconds = begun.elapsed().as_secs_f64();
    let others: Vec<_> = sources
        .iter()
        .map(|source| Some(Arc::new(true_planes(source))))
        .collect();
    let begun = Instant::now();
    let round = Round {
        start: &first,
        others: &others,
        before: 0,
    };
    let again = engine.search_consistent(&task, &round, &options, &progress)?;
    Ok(([first, again], [seconds, begun.elapsed().as_secs_f64()]))
}

/// Returns the percentage of pixels with CPU depth whose GPU depth agrees to 0.1 %.
fn share(cpu: &PlaneMap, gpu: &PlaneMap) -> f64 {
    let known = cpu
        .planes
        .iter()
        .zip(&gpu.planes)
        .filter(|(cpu, _)| cpu.inverse_depth > 0.0);
    let near = known
        .clone()
        .filter(|(cpu, gpu)| (gpu.inverse_depth / cpu.inverse_depth - 1.0).abs() < 1e-3);
    100.0 * near.count() as f64 / (known.count() as f64).max(1.0)
}

/// Returns the camera and pose of an image.
fn view(index: usize, width: u32, height: u32) -> (Camera, Pose) {
    let side = 0.3 * index.div_ceil(2) as f64 * if index.is_multiple_of(2) { -1.0 } else { 1.0 };
    let pose = Pose {
        rotation: DQuat::from_rotation_y(0.1 * side),
        translation: DVec3::new(-side, 0.05 * side, 0.0),
    };
    let focal = f64::from(width);
    (
        Camera::pinhole(
            width,
            height,
            [focal, focal],
            [0.5 * f64::from(width), 0.5 * f64::from(height)],
        ),
        pose,
    )
}

/// Returns the inverse depth of a slanted wall at a pixel, and the pixel's ray in the world.
fn wall(camera: &Camera, pose: &Pose, x: u32, y: u32) -> (f64, DVec3) {
    let at_px = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
    let (centre, ray) = (
        pose.centre(),
        pose.rotation.conjugate() * camera.unproject(at_px).extend(1.0),
    );
    (
        (ray.z - 0.4 * ray.x + 0.3 * ray.y) / (3.0 + 0.4 * centre.x - 0.3 * centre.y - centre.z),
        ray,
    )
}

/// Returns the wall's plane at each pixel of an image.
fn true_planes(image: &PosedImage) -> PlaneMap {
    let (width, height) = image.size();
    let inverse_depth =
        |x: usize, y: usize| wall(&image.camera, &image.camera_from_world, x as u32, y as u32).0;
    let origin = inverse_depth(0, 0);
    let slope =
        [inverse_depth(1, 0) - origin, inverse_depth(0, 1) - origin].map(|slope| slope as f32);
    let plane = |i: usize| Plane {
        inverse_depth: inverse_depth(i % width, i / width) as f32,
        slope,
    };
    let planes = (0..width * height).map(plane).collect();
    PlaneMap {
        width,
        height,
        planes,
        costs: vec![0.0; width * height],
    }
}

/// Returns the image of the textured wall from one of several places.
fn image(index: usize, width: u32, height: u32) -> Arc<PosedImage> {
    let (camera, pose) = view(index, width, height);
    let fineness = f64::from(width) / 160.0;
    let grey = |i: u32| {
        let (inverse_depth, ray) = wall(&camera, &pose, i % width, i / width);
        let x = pose.centre() + ray / inverse_depth;
        let wave = |kx: f64, ky: f64, scale: f64| (scale * (kx * x.x + ky * x.y)).sin();
        let coarse = wave(17.0, 5.0, 1.0) + wave(-7.0, 19.0, 1.0);
        (127.5 + 30.0 * (coarse + wave(29.0, -23.0, fineness) + wave(11.0, 31.0, fineness))) as f32
    };
    let luma = (0..width * height).map(grey).collect();
    let tones = Tones {
        width: width as usize,
        height: height as usize,
        luma,
        chroma: Vec::new(),
    };
    Arc::new(PosedImage::new(
        tones,
        camera,
        pose,
        PatchMatchOptions::default().coarsest_px,
    ))
}
