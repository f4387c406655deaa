use glam::{DVec2, DVec3};
use rayon::prelude::*;
use rustc_hash::FxHashSet;

use super::views::{Views, nearest_corner, pixel_footprint, two_digits};
use super::visibility::posed_view;
use super::voxel_map::{AXIS_SHIFTS, VoxelPosition, cell_key};
use crate::SceneError;
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// Maximum number of sampled frames.
const FRAMES: usize = 48;
/// Approximate number of sampled pixels per frame.
const PIXELS: f64 = 80_000.0;
/// Number of cell sizes at which cells are counted, each twice the previous one.
const LEVELS: usize = 3;
/// Width of the smallest cells, in sampling steps between pixels.
///
/// With fewer steps, some cells that frames see would stay empty.
const CELL_STEPS: f64 = 2.0;
/// Target number of voxels of a cloud if no voxel size is given.
///
/// Layers of the same surface are merged afterwards, which leaves 2 to 4 million points. A kitchen
/// in 167 Kinect frames gives 3 million points. At 1 cm they are as complete as the 15 million
/// points of one voxel per pixel.
const DEFAULT_VOXELS: f64 = 4e6;

/// How finely and how often the frames measure surfaces; default voxel sizes derive from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Width of a pixel at the median depth, in world units.
    ///
    /// If there are labelled pixels, the median is over those.
    pub footprint: f64,
    /// Average number of frames that see the same place on a surface.
    pub views: f64,
    /// Edge length of the smallest counted cells, in world units.
    cell: f64,
    /// Estimated number of cells that all frames fill.
    ///
    /// The entries are for cells of edge `cell`, twice that edge and so on.
    filled: [f64; LEVELS],
}

/// Number of cells filled by the sampled frames.
struct Counted {
    /// Cells filled by all sampled frames, per cell size.
    all: [usize; LEVELS],
    /// Cells filled by every second sampled frame, per cell size.
    half: [usize; LEVELS],
    /// Sum over the frames of the number of smallest cells that each fills.
    by_frame: usize,
}

impl Coverage {
    /// Measures coverage from the depths of a sample of frames.
    ///
    /// With `only_labelled`, surfaces count only where masks have labels. Returns `None` if no
    /// frame has a depth above 0.
    ///
    /// # Errors
    ///
    /// Returns the error of a depth that cannot be read. Returns [`SceneError::Stopped`] if the job
    /// is stopped.
    pub fn measure(
        views: &dyn Views,
        usable: &[usize],
        only_labelled: bool,
        progress: &Progress,
    ) -> Result<Option<Self>, SceneError> {
        let Some(footprint) = pixel_footprint(views, usable)? else {
            return Ok(None);
        };
        let looked_at: Vec<usize> = usable
            .iter()
            .copied()
            .step_by(usable.len().div_ceil(FRAMES).max(1))
            .collect();
        let pixels = |&index: &usize| {
            f64::from(views.frames()[index].width) * f64::from(views.frames()[index].height)
        };
        let step = (looked_at.iter().map(pixels).fold(1.0, f64::max) / PIXELS)
            .sqrt()
            .round()
            .max(1.0);
        let cell = CELL_STEPS * step * footprint;
        let grid = CellGrid {
            origin: nearest_corner(views, &looked_at),
            cell,
            step: step as usize,
            only_labelled,
        };
        let keys = |&index: &usize| -> Result<Vec<u64>, SceneError> {
            progress.check()?;
            grid.keys(views, index)
        };
        let frames: Vec<Vec<u64>> = looked_at.par_iter().map(keys).collect::<Result<_, _>>()?;
        let counted = Counted::of(&frames, progress)?;
        let filled =
            std::array::from_fn(|level| counted.in_frames(level, looked_at.len(), usable.len()));
        let share = usable.len() as f64 / looked_at.len().max(1) as f64;
        let views = (counted.by_frame as f64 * share / filled[0]).max(1.0);
        Ok((counted.all[0] > 0).then_some(Self {
            footprint,
            views,
            cell,
            filled,
        }))
    }

    /// Estimates how many cells of edge length `edge` the surfaces fill.
    #[must_use]
    pub fn cells(&self, edge: f64) -> f64 {
        let level = (edge / self.cell).log2();
        // A surface has two dimensions; noise adds to them, small objects reduce them.
        let slope = |first: usize| {
            (self.filled[first] / self.filled[first + 1])
                .log2()
                .clamp(1.0, 3.0)
        };
        let first = usize::from(level > 1.0);
        self.filled[first] * ((first as f64 - level) * slope(first)).exp2()
    }

    /// Returns the smallest edge length at which surfaces fill at most about `cells` cells.
    #[must_use]
    pub fn edge_for(&self, cells: f64) -> f64 {
        let (mut low, mut high) = (self.cell * 1e-6, self.cell * 1e6);
        while high / low > 1.001 {
            let middle = (low * high).sqrt();
            if self.cells(middle) > cells {
                low = middle;
            } else {
                high = middle;
            }
        }
        high
    }

    /// Returns the default voxel size of a cloud.
    ///
    /// This is the width of a pixel, or more if that would give more points than are useful.
    #[must_use]
    pub fn point_voxel(&self) -> f64 {
        let proportionate = self.edge_for(DEFAULT_VOXELS);
        if proportionate > self.footprint {
            two_digits(proportionate)
        } else {
            self.footprint
        }
    }
}

/// A grid of cells that pixels fall into.
struct CellGrid {
    origin: DVec3,
    /// Edge length of a cell.
    cell: f64,
    /// Sampling step between pixels, along rows and columns.
    step: usize,
    only_labelled: bool,
}

impl CellGrid {
    /// Returns the sorted, unique keys of the cells that a frame fills.
    fn keys(&self, views: &dyn Views, index: usize) -> Result<Vec<u64>, SceneError> {
        let (Some(view), Some(depth)) = (posed_view(&views.frames()[index])?, views.depth(index)?)
        else {
            return Ok(Vec::new());
        };
        let mask = views.mask(index).filter(|_| self.only_labelled);
        let is_wanted = |at: usize| match &mask {
            Some(mask) => mask.ids.get(at).is_some_and(|&id| id != LabelId::NONE),
            None => !self.only_labelled,
        };
        let (centre, world_from_camera) = (view.centre() - self.origin, view.rotation.transpose());
        let mut keys = Vec::new();
        for y in (0..depth.height).step_by(self.step) {
            for x in (0..depth.width).step_by(self.step) {
                let at = y as usize * depth.width as usize + x as usize;
                let along = depth.depths.get(at).copied().map_or(0.0, f64::from);
                if !(along > 0.0 && along.is_finite() && is_wanted(at)) {
                    continue;
                }
                let ray = view
                    .camera
                    .unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
                    .extend(1.0);
                let in_grid = (centre + world_from_camera * (ray * along)) / self.cell;
                keys.extend(
                    VoxelPosition::holding(in_grid.as_vec3()).map(|cell| cell_key(cell.index)),
                );
            }
        }
        keys.sort_unstable();
        keys.dedup();
        Ok(keys)
    }
}

impl Counted {
    fn of(frames: &[Vec<u64>], progress: &Progress) -> Result<Self, SceneError> {
        let mut cells: FxHashSet<u64> = FxHashSet::default();
        for keys in frames.iter().step_by(2) {
            progress.check()?;
            cells.extend(keys);
        }
        let half = by_size(&cells);
        for keys in frames.iter().skip(1).step_by(2) {
            progress.check()?;
            cells.extend(keys);
        }
        Ok(Self {
            all: by_size(&cells),
            half,
            by_frame: frames.iter().map(Vec::len).sum(),
        })
    }

    /// Extrapolates from the sampled frames to the number of cells that all `frames` fill.
    ///
    /// Each doubling of the number of frames is assumed to add the same factor as the last one did.
    fn in_frames(&self, level: usize, looked_at: usize, frames: usize) -> f64 {
        let all = self.all[level].max(1) as f64;
        let growth = all / self.half[level].max(1) as f64;
        all * growth
            .clamp(1.0, 2.0)
            .powf((frames as f64 / looked_at.max(1) as f64).log2())
    }
}

/// Counts cells at every size, each twice as large as the previous one.
fn by_size(cells: &FxHashSet<u64>) -> [usize; LEVELS] {
    let mut counts = [cells.len(); LEVELS];
    let mut larger: FxHashSet<u64> = cells.iter().map(|&key| twice_as_large(key)).collect();
    for count in &mut counts[1..] {
        *count = larger.len();
        larger = larger.iter().map(|&key| twice_as_large(key)).collect();
    }
    counts
}

/// Returns the key of the cell of twice the edge length that contains the cell `key`.
///
/// Keys count from far below the origin, so halving rounds down.
fn twice_as_large(key: u64) -> u64 {
    AXIS_SHIFTS.iter().fold(0, |larger, &shift| {
        larger | (key >> shift & 0x1F_FFFF) >> 1 << shift
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cell_counts_extrapolate_to_other_edge_lengths() {
        let coverage = Coverage {
            footprint: 0.001,
            views: 3.0,
            cell: 0.004,
            filled: [64e4, 16e4, 4e4],
        };
        for (edge, cells) in [
            (0.001, 1024e4),
            (0.002, 256e4),
            (0.004, 64e4),
            (0.012, 71e3),
            (0.064, 2500.0),
        ] {
            assert!(
                (coverage.cells(edge) / cells - 1.0).abs() < 0.01,
                "{edge}: {}",
                coverage.cells(edge)
            );
            assert!(
                (coverage.edge_for(cells) / edge - 1.0).abs() < 0.01,
                "{cells}: {}",
                coverage.edge_for(cells)
            );
        }
        assert_eq!(coverage.point_voxel(), 0.0016);
        let small = Coverage {
            filled: [6400.0, 1600.0, 400.0],
            ..coverage
        };
        assert_eq!(small.point_voxel(), 0.001, "as fine as the pixels are");
    }

    #[test]
    fn cells_on_both_sides_of_the_origin_have_different_parents() {
        let twice = |index: [i32; 3]| twice_as_large(cell_key(index));
        assert_eq!(twice([-1, 0, 7]), twice([-2, 1, 6]));
        assert_ne!(twice([-1, 0, 0]), twice([0, 0, 0]));
    }

    #[test]
    fn cell_count_grows_with_frames_at_the_sampled_rate() {
        let counted = |half, all| Counted {
            all: [all; LEVELS],
            half: [half; LEVELS],
            by_frame: 0,
        };
        assert_eq!(
            counted(1000, 1000).in_frames(0, 48, 480),
            1000.0,
            "all is seen"
        );
        assert!(
            (counted(500, 1000).in_frames(0, 48, 480) - 10_000.0).abs() < 1.0,
            "every frame sees another place"
        );
    }
}
