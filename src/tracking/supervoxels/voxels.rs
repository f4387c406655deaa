use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use crate::reprojection::DepthView;
use ostra_cloud::SceneError;
use ostra_cloud::points::{NormalOptions, estimate_normals};
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::lab_of_pixel;

/// Surfaces seen by several frames, with one point per cube of space.
pub struct SurfaceVoxels {
    /// Edge of a cube in world units.
    pub side: f32,
    of_cell: FxHashMap<[i32; 3], u32>,
    /// Mean position of the points in each cube, in world space.
    pub places: Vec<Vec3>,
    /// Mean colours, CIE L*a*b*.
    pub colors: Vec<Vec3>,
    /// Mean directions to the cameras that saw each cube.
    facing: Vec<Vec3>,
}

#[derive(Clone, Copy, Default)]
struct SurfaceSums {
    place: Vec3,
    color: Vec3,
    facing: Vec3,
    points: u32,
    views: u32,
}

/// A frame with depth, a camera and its image.
pub struct ColoredView {
    /// Depth and camera.
    pub view: DepthView,
    /// The frame's image.
    pub image: Arc<Image>,
}

impl SurfaceVoxels {
    /// Creates cubes of edge `side` (world units) that at least `least_views` frames see.
    pub fn of(
        views: &[ColoredView],
        side: f32,
        least_views: u32,
        progress: &Progress,
    ) -> Result<Self, SceneError> {
        let seen: Vec<FxHashMap<[i32; 3], SurfaceSums>> = views
            .par_iter()
            .map(|view| cells_of(view, side, progress))
            .collect::<Result<_, _>>()?;
        let mut all: FxHashMap<[i32; 3], SurfaceSums> = FxHashMap::default();
        for (cell, sums) in seen.into_iter().flatten() {
            let total = all.entry(cell).or_default();
            total.place += sums.place;
            total.color += sums.color;
            total.facing += sums.facing;
            total.points += sums.points;
            total.views += 1;
        }
        let mut kept: Vec<([i32; 3], SurfaceSums)> = all
            .into_iter()
            .filter(|(_, sums)| sums.views >= least_views)
            .collect();
        kept.sort_unstable_by_key(|(cell, _)| *cell);
        let mean = |of: fn(&SurfaceSums) -> Vec3| {
            kept.iter()
                .map(|(_, sums)| of(sums) / sums.points as f32)
                .collect()
        };
        Ok(Self {
            side,
            of_cell: kept
                .iter()
                .zip(0..)
                .map(|((cell, _), index)| (*cell, index))
                .collect(),
            places: mean(|sums| sums.place),
            colors: mean(|sums| sums.color),
            facing: mean(|sums| sums.facing),
        })
    }

    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Returns unit normals towards the cameras, of planes through the nearest neighbours.
    ///
    /// A normal is zero if there is no plane.
    pub fn normals(&self, neighbours: usize, progress: &Progress) -> Result<Vec<Vec3>, SceneError> {
        let mut normals =
            estimate_normals(&self.places, &[], &NormalOptions { neighbours }, progress)?;
        // The nearest camera may be on the other side of a thin object. Only the cameras that saw
        // the voxel count.
        for (normal, facing) in normals.iter_mut().zip(&self.facing) {
            *normal *= normal.dot(*facing).signum();
        }
        Ok(normals)
    }

    /// Returns the voxel at a position in world space.
    pub fn at(&self, place: Vec3) -> Option<u32> {
        self.of_cell.get(&cell(place, self.side)).copied()
    }

    /// Returns all pairs of adjacent voxels, corners included, within `reach` sides.
    pub fn pairs(&self, reach: f32) -> Vec<(u32, u32)> {
        let limit = (reach * self.side).powi(2);
        let adjacent = |index: u32| {
            let place = self.places[index as usize];
            let [x, y, z] = cell(place, self.side);
            let around = (0..27).map(move |i| [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1]);
            let others = around.filter_map(|cell| self.of_cell.get(&cell).copied());
            let is_near =
                move |other: u32| self.places[other as usize].distance_squared(place) <= limit;
            others
                .filter(move |&other| other > index && is_near(other))
                .map(move |other| (index, other))
        };
        (0..self.len() as u32)
            .into_par_iter()
            .flat_map_iter(adjacent)
            .collect()
    }

    pub fn bytes(&self) -> usize {
        self.len() * (3 * size_of::<Vec3>() + 2 * size_of::<([i32; 3], u32)>())
    }
}

fn cell(place: Vec3, side: f32) -> [i32; 3] {
    (place / side).floor().as_ivec3().to_array()
}

fn cells_of(
    colored: &ColoredView,
    side: f32,
    progress: &Progress,
) -> Result<FxHashMap<[i32; 3], SurfaceSums>, SceneError> {
    progress.check()?;
    let ColoredView { view, image } = colored;
    let mut cells: FxHashMap<[i32; 3], SurfaceSums> = FxHashMap::default();
    let (world, eye) = (
        view.to_world(),
        view.posed.camera_from_world.centre().as_vec3(),
    );
    for (at, &pixel) in image.pixels.iter().enumerate() {
        let Some(place) = view.point(at).map(&world) else {
            continue;
        };
        let sums = cells.entry(cell(place, side)).or_default();
        sums.place += place;
        sums.color += Vec3::from_array(lab_of_pixel(pixel));
        sums.facing += (eye - place).normalize_or_zero();
        sums.points += 1;
    }
    Ok(cells)
}
