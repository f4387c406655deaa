use std::sync::Arc;

use super::field::Field;
use super::level::{Level, MAX_SOURCES, Source};
use super::options::PatchMatchOptions;
use super::picture::Picture;
use super::plane::Plane;
use super::random::Dice;
use super::regions::Regions;
use super::search::Search;
use super::window::Window;

/// A level of the pyramid, 0 = the finest.
pub fn level<'a>(
    search: &Search<'_>,
    number: usize,
    options: &'a PatchMatchOptions,
    window: &'a Window,
    allowed: Option<&'a [bool]>,
) -> Level<'a> {
    let reference = search.reference;
    let comparable = search
        .sources
        .iter()
        .filter(|source| source.levels.len() > number);
    let sources: Vec<Source> = comparable
        .take(MAX_SOURCES)
        .map(|source| Source {
            transfer: reference.transfer(source, number),
            texture: Arc::clone(&source.levels[number]),
            found: None,
        })
        .collect();
    let [near, far] = search.depth_range.map(|depth| (1.0 / depth) as f32);
    let picture = Arc::clone(&reference.levels[number]);
    let centre = (0.5 * picture.width as f32, 0.5 * picture.height as f32);
    let step = pixel_step(&sources, centre, 0.5 * (near + far));
    Level {
        regions: Regions::new(picture.width, picture.height),
        picture,
        raster: reference.raster(number),
        sources,
        range: [far, near],
        step,
        allowed,
        hints: Vec::new(),
        pull: 0.0,
        options,
        window,
    }
}

/// Change of inverse depth that moves the middle of the picture by a pixel in the median source.
fn pixel_step(sources: &[Source], (x, y): (f32, f32), w: f32) -> f32 {
    let change = 1e-3 * w;
    let seen = |source: &Source, w: f32| {
        let [u, v, z] = source.transfer.apply(x, y, w);
        [u / z, v / z]
    };
    let step = |source: &Source| {
        let (a, b) = (seen(source, w), seen(source, w + change));
        change / (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-6)
    };
    let mut steps: Vec<f32> = sources
        .iter()
        .map(step)
        .filter(|step| step.is_finite())
        .collect();
    steps.sort_unstable_by(f32::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(change)
}

/// Pixels of a level of which any pixel of the finest is to be worked on.
pub fn coarse_mask(allowed: &[bool], picture: &Picture, number: usize) -> Vec<bool> {
    let (width, height) = picture.size();
    let level = &picture.levels[number];
    let mut coarse = vec![false; level.width * level.height];
    for (at, _) in allowed
        .iter()
        .enumerate()
        .filter(|(_, allowed)| **allowed)
        .take(width * height)
    {
        let (x, y) = ((at % width) >> number, (at / width) >> number);
        if x < level.width && y < level.height {
            coarse[y * level.width + x] = true;
        }
    }
    coarse
}

/// Depths from anywhere in the range, evenly in inverse depth, and those of the seeds.
pub fn random_field(level: &Level<'_>, seeds: &[(usize, usize, f32)], number: usize) -> Field {
    let (width, height) = (level.picture.width, level.picture.height);
    let [low, high] = level.range;
    let mut field = Field::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let mut dice = Dice::new(level.options.seed, u32::MAX, (y * width + x) as u32);
            let inverse_depth = low + (high - low) * dice.unit();
            let slope = level
                .raster
                .focal
                .map(|focal| 0.5 * dice.signed() * inverse_depth / focal);
            field.set(
                x,
                y,
                Plane {
                    inverse_depth,
                    slope,
                },
                super::ncc::WORST,
            );
        }
    }
    for &(x, y, depth) in seeds {
        let (x, y) = (x >> number, y >> number);
        if x < width && y < height {
            field.set(
                x,
                y,
                Plane {
                    inverse_depth: 1.0 / depth,
                    slope: [0.0; 2],
                },
                super::ncc::WORST,
            );
        }
    }
    field
}

/// The coarse pixel that a fine one is part of.
pub fn coarse_pixel((x, y): (usize, usize), (width, height): (usize, usize)) -> (usize, usize) {
    ((x / 2).min(width - 1), (y / 2).min(height - 1))
}

/// The planes of a coarser field at each of its pixels' four.
pub fn finer_field(level: &Level<'_>, coarser: &Field) -> Field {
    let (width, height) = (level.picture.width, level.picture.height);
    let mut field = Field::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let (column, row) = coarse_pixel((x, y), (coarser.width, coarser.height));
            let (plane, _) = coarser.at(column, row);
            field.set(
                x,
                y,
                plane.enlarged((x, y), (column, row)),
                super::ncc::WORST,
            );
        }
    }
    field
}
