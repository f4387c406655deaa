use glam::{DVec3, IVec3, Vec2, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::material::encoded;
use super::mesh::face_normal;
use super::model::SceneMesh;
use super::noise::Dice;
use super::raster::{Raster, band_rows};
use super::render::Light;
use super::view::SyntheticView;
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelTree;

/// Options of an exact cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthOptions {
    /// Spacing on labelled surfaces, 0.0002–0.1 metres; about one point per square of it.
    pub spacing_m: f64,
    /// Spacing on the unlabelled surroundings, 0.001–0.1 metres; `None` leaves them out.
    pub surroundings_m: Option<f64>,
    /// Minimum number of views that must see a point.
    ///
    /// 0 includes all points, also on surfaces inside others (a culm under its sheath), which no
    /// camera can see.
    pub min_views: usize,
}

impl Default for TruthOptions {
    fn default() -> Self {
        Self {
            spacing_m: 0.001,
            surroundings_m: Some(0.005),
            min_views: 2,
        }
    }
}

impl TruthOptions {
    /// Checks that the spacings are in range.
    ///
    /// # Errors
    /// Returns [`SceneError::Request`] with the spacing that is out of range.
    pub fn check(&self) -> Result<(), SceneError> {
        if !(0.0002..=0.1).contains(&self.spacing_m) {
            return Err(SceneError::Request(format!(
                "a spacing of {} m is out of range; choose 0.0002 to 0.1",
                self.spacing_m
            )));
        }
        match self.surroundings_m {
            Some(spacing) if !(0.001..=0.1).contains(&spacing) => {
                Err(SceneError::Request(format!(
                    "a spacing of {spacing} m for the surroundings is out of range; choose 0.001 to 0.1"
                )))
            }
            _ => Ok(()),
        }
    }
}

/// The parts of a scene from which its exact cloud is made.
pub(super) struct TruthSource<'a> {
    pub model: &'a SceneMesh,
    pub light: &'a Light,
    pub views: &'a [SyntheticView],
    pub tree: &'a LabelTree,
    /// Seed of the positions of the points.
    pub seed: u64,
}

pub(super) fn exact_cloud(
    source: &TruthSource<'_>,
    options: &TruthOptions,
    progress: &Progress,
) -> Result<LabelledCloud, SceneError> {
    options.check()?;
    let (model, light) = (source.model, source.light);
    let spots = cover(model, source.seed, |part| {
        if model.appearances[part].label.0 == 0 {
            options.surroundings_m
        } else {
            Some(options.spacing_m)
        }
    });
    let views = if options.min_views == 0 {
        &[]
    } else {
        source.views
    };
    let observations = count_observations(model, &spots, views, progress)?;
    let mut cloud = LabelledCloud {
        tree: source.tree.clone(),
        ..LabelledCloud::default()
    };
    for (spot, (count, towards)) in spots.iter().zip(observations) {
        if count < options.min_views {
            continue;
        }
        let outward = interpolate(spot, model, |v| model.normals[v]).normalize_or(Vec3::Z);
        let normal = if towards.is_some_and(|eye| (eye - spot.x).as_vec3().dot(outward) < 0.0) {
            -outward
        } else {
            outward
        };
        let appearance = model.appearance(spot.triangle as usize);
        let uv: Vec2 = interpolate(spot, model, |v| model.uv[v]);
        cloud.positions.push(spot.x.as_vec3());
        cloud.normals.push(normal);
        cloud.colors.push(encoded(
            appearance.albedo(uv, &model.bitmaps) * light.on(spot.x, normal, normal, appearance).0,
        ));
        cloud.labels.push(appearance.label);
        cloud.confidence.push(1.0);
    }
    Ok(cloud)
}

fn interpolate<T>(spot: &Spot, model: &SceneMesh, value: impl Fn(usize) -> T) -> T
where
    T: std::ops::Mul<f32, Output = T> + std::iter::Sum,
{
    let corners = model.triangles[spot.triangle as usize];
    corners
        .iter()
        .zip(spot.shares)
        .map(|(&v, share)| value(v as usize) * share as f32)
        .sum()
}

/// Number of views per spot, and the centre of the first camera that sees it.
type SpotObservations = Vec<(usize, Option<DVec3>)>;

fn count_observations(
    model: &SceneMesh,
    spots: &[Spot],
    views: &[SyntheticView],
    progress: &Progress,
) -> Result<SpotObservations, SceneError> {
    let mut seen = vec![(0, None); spots.len()];
    for (k, view) in views.iter().enumerate() {
        progress.step(k, views.len())?;
        let eye = view.camera_from_world.centre();
        for spot in visible_spots(model, spots, view) {
            let (count, first) = seen[spot];
            seen[spot] = (count + 1, Some(first.unwrap_or(eye)));
        }
    }
    Ok(seen)
}

/// A point on a surface of a model.
#[derive(Debug, Clone, Copy)]
struct Spot {
    pub(super) triangle: u32,
    /// Barycentric coordinates, sum 1.
    pub(super) shares: [f64; 3],
    pub(super) x: DVec3,
}

/// Number of candidates per squared spacing; few gaps remain after that many.
const THROWS: usize = 8;
/// Minimum distance as a share of the spacing; it gives about one point per squared spacing.
const LEAST: f64 = 0.8;

/// Covers each part with random points at a minimum distance (dart throwing).
///
/// Source: Cook, "Stochastic sampling in computer graphics", ACM Transactions on Graphics 1986.
/// There is about one point per `spacing(part)²` square metres. Parts whose spacing is `None` are
/// left out.
fn cover(model: &SceneMesh, seed: u64, spacing: impl Fn(usize) -> Option<f64> + Sync) -> Vec<Spot> {
    let mut triangles_of = vec![Vec::new(); model.appearances.len()];
    for (triangle, &appearance) in model.appearance_of.iter().enumerate() {
        triangles_of[usize::from(appearance)].push(triangle as u32);
    }
    let covered: Vec<Vec<Spot>> = triangles_of
        .par_iter()
        .enumerate()
        .filter_map(|(part, triangles)| Some((part, triangles, spacing(part)?)))
        .map(|(part, triangles, spacing)| {
            cover_part(model, triangles, spacing, &mut Dice::new(seed, part as u64))
        })
        .collect();
    covered.concat()
}

fn cover_part(model: &SceneMesh, triangles: &[u32], spacing: f64, dice: &mut Dice) -> Vec<Spot> {
    let mut kept: Vec<Spot> = Vec::new();
    let mut grid: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
    let least = LEAST * spacing;
    for _ in 0..THROWS {
        let mut owed = dice.range(0.0, 1.0);
        for &triangle in triangles {
            owed += 0.5
                * face_normal(&model.positions, model.triangles[triangle as usize]).length()
                / spacing.powi(2);
            while owed >= 1.0 {
                owed -= 1.0;
                let spot = throw(model, triangle, dice);
                let cell = (spot.x / least).floor().as_ivec3();
                let near = |k: i32| cell + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
                let crowded =
                    |&k: &u32| kept[k as usize].x.distance_squared(spot.x) < least * least;
                if (0..27)
                    .filter_map(|k| grid.get(&near(k)))
                    .flatten()
                    .any(crowded)
                {
                    continue;
                }
                grid.entry(cell).or_default().push(kept.len() as u32);
                kept.push(spot);
            }
        }
    }
    kept
}

fn throw(model: &SceneMesh, triangle: u32, dice: &mut Dice) -> Spot {
    let (mut a, mut b) = (dice.range(0.0, 1.0), dice.range(0.0, 1.0));
    if a + b > 1.0 {
        (a, b) = (1.0 - a, 1.0 - b);
    }
    let shares = [1.0 - a - b, a, b];
    let corners = model.triangles[triangle as usize].map(|v| model.positions[v as usize]);
    let x = corners
        .iter()
        .zip(shares)
        .map(|(&corner, share)| share * corner)
        .sum();
    Spot {
        triangle,
        shares,
        x,
    }
}

/// Depth difference from which a surface occludes a point, in metres; covers rounding errors only.
const BEHIND_M: f64 = 2e-5;

/// Returns the indices of the spots that a view sees, in ascending order.
///
/// Every spot has its own ray, so the result is exact and does not depend on the image resolution.
fn visible_spots(model: &SceneMesh, spots: &[Spot], view: &SyntheticView) -> Vec<usize> {
    let raster = Raster::new(model, &view.camera, &view.camera_from_world);
    let pixels = SpotsByPixel::new(spots, view);
    let bands = (0..raster.band_count())
        .into_par_iter()
        .map(|band| seen_in_band(&raster, &pixels, view, band));
    let mut seen: Vec<usize> = bands.collect::<Vec<_>>().concat();
    seen.sort_unstable();
    seen
}

fn seen_in_band(
    raster: &Raster<'_>,
    pixels: &SpotsByPixel,
    view: &SyntheticView,
    band: usize,
) -> Vec<usize> {
    let (width, rows) = (view.camera.width, band_rows(&view.camera, band));
    let first = pixels.range(0, rows.start).start;
    let last = pixels.range(width - 1, rows.end - 1).end;
    let mut hidden = vec![false; last - first];
    for facet in raster.facets(band) {
        let (columns, rows) = facet.pixels(0..width, rows.clone());
        for row in rows {
            for column in columns.clone() {
                for place in pixels.range(column, row) {
                    let x = pixels.x_in_camera[place];
                    let nearer = facet
                        .depth(x / x.z)
                        .is_some_and(|depth| depth < x.z - BEHIND_M);
                    hidden[place - first] |= nearer;
                }
            }
        }
    }
    (first..last)
        .filter(|place| !hidden[place - first])
        .map(|place| pixels.spots[place])
        .collect()
}

/// Spots sorted by pixel.
struct SpotsByPixel {
    width: u32,
    /// Start of each pixel's spots in the lists below, with one more entry at the end.
    starts: Vec<usize>,
    spots: Vec<usize>,
    x_in_camera: Vec<DVec3>,
}

impl SpotsByPixel {
    fn new(spots: &[Spot], view: &SyntheticView) -> Self {
        let (width, height) = (view.camera.width, view.camera.height);
        let place = |(k, spot): (usize, &Spot)| {
            let x_in_camera = view.camera_from_world.transform(spot.x);
            let px = view.camera.project(x_in_camera)?;
            let inside =
                px.min_element() >= 0.0 && px.x < f64::from(width) && px.y < f64::from(height);
            inside.then(|| {
                (
                    px.y as usize * width as usize + px.x as usize,
                    k,
                    x_in_camera,
                )
            })
        };
        let mut placed: Vec<_> = spots.par_iter().enumerate().filter_map(place).collect();
        placed.sort_unstable_by_key(|&(pixel, k, _)| (pixel, k));
        let mut starts = vec![0; width as usize * height as usize + 1];
        placed
            .iter()
            .for_each(|&(pixel, ..)| starts[pixel + 1] += 1);
        (1..starts.len()).for_each(|k| starts[k] += starts[k - 1]);
        let (spots, x_in_camera) = placed.into_iter().map(|(_, k, x)| (k, x)).unzip();
        Self {
            width,
            starts,
            spots,
            x_in_camera,
        }
    }

    /// Returns the positions of a pixel's spots in the lists.
    fn range(&self, column: u32, row: u32) -> std::ops::Range<usize> {
        let pixel = row as usize * self.width as usize + column as usize;
        self.starts[pixel]..self.starts[pixel + 1]
    }
}
