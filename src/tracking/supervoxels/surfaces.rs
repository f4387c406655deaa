use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::segmentation::{BoundaryWeights, Supervoxels};
use super::tree::SupervoxelTree;
use super::voxels::{ColoredView, SurfaceVoxels};
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_core::statistics::upper_median;

/// Side of a voxel, in pixels at the median depth of the frames.
const SIDE_PX: f32 = 4.5;
/// Numbers of neighbours for normals; each gives different partitions.
const NORMAL_NEIGHBOURS: [usize; 3] = [24, 48, 80];
/// Widths of supervoxels, in sides of a voxel; each gives different partitions.
const STEP_SIDES: [f32; 3] = [3.0, 4.0, 5.0];
/// Largest share of all voxels that an answer may have.
const LARGEST_SHARE: f32 = 0.35;

/// Surfaces seen by several frames, partitioned in many ways.
///
/// A single partition is often wrong. The answer that agrees most with those of all others rarely
/// is.
///
/// One clustering of supervoxels by convexity (LCCP: S. Stein et al., "Object Partitioning Using
/// Local Convexity", CVPR 2014) finds the right object on a real shelf about every second time. The
/// settings that do so change from object to object. So nine partitions (`NORMAL_NEIGHBOURS` ×
/// `STEP_SIDES`) are each clustered by average linkage under three weightings of borders
/// (`JUDGEMENTS`) and cut at four strengths (`LEAST_STRENGTHS`). The answer has the largest mean
/// squared IoU with all others.
pub struct SurfacePartitions {
    pub voxels: SurfaceVoxels,
    separating_all: Vec<Partition>,
}

impl SurfacePartitions {
    pub fn of(views: &[ColoredView], progress: &Progress) -> Result<Self, SceneError> {
        let least_views = if views.len() > 2 { 2 } else { 1 };
        let voxels = SurfaceVoxels::of(views, side(views), least_views, progress)?;
        let mut separating_all = Vec::new();
        for neighbours in NORMAL_NEIGHBOURS {
            let normals = voxels.normals(neighbours, progress)?;
            let separating = |sides: f32| {
                let parts = Supervoxels::of(&voxels, &normals, sides * voxels.side, progress)?;
                Ok(Partition::new(parts, voxels.side))
            };
            separating_all.extend(
                STEP_SIDES
                    .into_par_iter()
                    .map(separating)
                    .collect::<Result<Vec<_>, SceneError>>()?,
            );
        }
        Ok(Self {
            voxels,
            separating_all,
        })
    }

    /// Returns the voxels that clicks select: of all answers the most typical one.
    ///
    /// Returns `None` if no answer is small enough to be an object.
    pub fn answer(&self, clicks: &[VoxelClick]) -> Option<VoxelSet> {
        let most = (LARGEST_SHARE * self.voxels.len() as f32) as u32;
        let answers: Vec<VoxelSet> = self
            .separating_all
            .par_iter()
            .flat_map_iter(|separating| separating.answers(clicks))
            .collect();
        let mut answers: Vec<VoxelSet> = answers
            .into_iter()
            .filter(|answer| answer.len() <= most)
            .collect();
        // Squared, so that many nearly equal answers outweigh many more that overlap a little.
        let likeness = |answer: &VoxelSet| {
            answers
                .iter()
                .map(|other| answer.iou(other).powi(2))
                .sum::<f32>()
        };
        let likenesses: Vec<f32> = answers.par_iter().map(likeness).collect();
        let best = (0..answers.len()).max_by(|&a, &b| likenesses[a].total_cmp(&likenesses[b]))?;
        Some(answers.swap_remove(best))
    }

    pub fn bytes(&self) -> usize {
        self.voxels.bytes()
            + self
                .separating_all
                .iter()
                .map(Partition::bytes)
                .sum::<usize>()
    }
}

/// Returns the side of a voxel: the median over the frames of its size at median depth.
fn side(views: &[ColoredView]) -> f32 {
    let width = |ColoredView { view, .. }: &ColoredView| {
        Some(SIDE_PX * view.median_depth()? / view.posed.camera.focal_px.x as f32)
    };
    let mut widths: Vec<f32> = views.iter().filter_map(width).collect();
    upper_median(&mut widths).unwrap_or(1.0)
}

/// Weightings of borders; each gives a different tree.
const JUDGEMENTS: [BoundaryWeights; 3] = [
    BoundaryWeights {
        groove_deg: 30.0,
        color: 80.0,
    },
    BoundaryWeights {
        groove_deg: 20.0,
        color: 160.0,
    },
    BoundaryWeights {
        groove_deg: 45.0,
        color: 40.0,
    },
];
/// Border strengths at which an object may end; each gives a different answer.
const LEAST_STRENGTHS: [f32; 4] = [0.4, 0.5, 0.6, 0.8];
/// Extra path length over a full border, in sides of a voxel.
const BORDER_SIDES: f32 = 1.5;
/// Reach of an exclude click, relative to its distance from the border of the answer.
///
/// The click excludes voxels this far towards the include clicks. Users click in the middle of what
/// is wrong.
const EXCLUDED_REACH: f32 = 1.5;
/// Relative depth at which an exclude click separates two objects.
///
/// The depth is relative to the deepest exclude click. Shallower clicks correct a border.
const SEPARATION_SHARE: f32 = 0.5;
/// Reach of a further include click, relative to its distance from the answer.
const INCLUDED_REACH: f32 = 2.0;

/// A click on a voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelClick {
    pub voxel: u32,
    pub include: bool,
    /// Distance to the border of the answer before the click, in world units.
    ///
    /// For an exclude click this is from inside the answer, for an include click from outside. It
    /// is infinite if there was no answer.
    pub depth: f32,
}

/// One partition of the surfaces into supervoxels, with trees that join these into objects.
struct Partition {
    parts: Supervoxels,
    trees: Vec<SupervoxelTree>,
    /// Neighbours of every supervoxel and the path lengths to them, in world units.
    ways: Vec<Vec<(u32, f32)>>,
}

impl Partition {
    /// Builds the trees and paths; `side` is that of the voxels.
    pub fn new(parts: Supervoxels, side: f32) -> Self {
        let mut ways = vec![Vec::new(); parts.len()];
        for border in &parts.borders {
            let (a, b) = (border.a as usize, border.b as usize);
            let way = parts.places[a].distance(parts.places[b]);
            let way = way + BORDER_SIDES * side * JUDGEMENTS[0].strength(border);
            ways[a].push((border.b, way));
            ways[b].push((border.a, way));
        }
        let trees = JUDGEMENTS
            .map(|judgement| SupervoxelTree::of(&parts, judgement))
            .into();
        Self { parts, trees, ways }
    }

    /// Returns the voxel sets that the clicks may select.
    ///
    /// There is one answer for each tree, strength and way to remove the part of an exclude click.
    /// That part is either what the click reaches, or also all that the tree joins with it before
    /// joining it with the include clicks.
    ///
    /// A later click only changes what lies within about its distance to the answer's border,
    /// because users click in the middle of what is wrong. The answers that also end where the tree
    /// would join the excluded part separate a book from the wall it leans on.
    pub fn answers(&self, clicks: &[VoxelClick]) -> Vec<VoxelSet> {
        let around: Vec<ClickDistances> = clicks.iter().map(|click| self.around(click)).collect();
        let mut near = vec![f32::INFINITY; self.parts.len()];
        for included in around.iter().filter(|around| around.click.include) {
            near.iter_mut()
                .zip(&included.ways)
                .for_each(|(near, way)| *near = near.min(*way));
        }
        let excluded = || around.iter().filter(|around| !around.click.include);
        let deepest = excluded()
            .map(|around| around.click.depth)
            .fold(0.0, f32::max);
        let separating =
            excluded().filter(|around| around.click.depth >= SEPARATION_SHARE * deepest);
        let separating: Vec<u32> = separating.map(|around| around.part).collect();
        let apart: &[&[u32]] = if separating.is_empty() {
            &[&[]]
        } else {
            &[&[], &separating]
        };
        let things = self
            .trees
            .iter()
            .flat_map(|tree| apart.iter().map(move |apart| (tree, tree.around(apart))));
        let taken = |(tree, closed): (&SupervoxelTree, Vec<bool>)| {
            LEAST_STRENGTHS.map(|least| {
                self.voxels(&taken(
                    |part| tree.thing(part, least, &closed),
                    &around,
                    &near,
                ))
            })
        };
        things.flat_map(taken).collect()
    }

    fn voxels(&self, inside: &[bool]) -> VoxelSet {
        VoxelSet::of(self.parts.of_voxel.len(), |voxel| {
            inside[self.parts.of_voxel[voxel] as usize]
        })
    }

    fn around(&self, click: &VoxelClick) -> ClickDistances {
        let part = self.parts.of_voxel[click.voxel as usize];
        ClickDistances {
            click: *click,
            part,
            ways: self.ways_from(part),
        }
    }

    /// Returns the shortest path length from a supervoxel to each other, in world units.
    ///
    /// Dijkstra, "A note on two problems in connexion with graphs", Numerische Mathematik 1959.
    fn ways_from(&self, part: u32) -> Vec<f32> {
        let mut shortest = vec![f32::INFINITY; self.parts.len()];
        shortest[part as usize] = 0.0;
        let mut open = BinaryHeap::from([Reverse((0, part))]);
        while let Some(Reverse((bits, part))) = open.pop() {
            // Lengths are not negative, so their bit patterns have the same order.
            let way = f32::from_bits(bits);
            if way > shortest[part as usize] {
                continue;
            }
            for &(other, step) in &self.ways[part as usize] {
                if way + step < shortest[other as usize] {
                    shortest[other as usize] = way + step;
                    open.push(Reverse(((way + step).to_bits(), other)));
                }
            }
        }
        shortest
    }

    pub fn bytes(&self) -> usize {
        let trees: usize = self.trees.iter().map(SupervoxelTree::bytes).sum();
        trees
            + self.parts.of_voxel.len() * 4
            + self.parts.borders.len() * 36
            + self.parts.len() * 40
    }
}

/// A click with the path lengths from it to all supervoxels.
struct ClickDistances {
    click: VoxelClick,
    part: u32,
    ways: Vec<f32>,
}

/// Returns which supervoxels the clicks select.
///
/// `thing` returns the supervoxels of the object that one belongs to. `near` are the shortest path
/// lengths to the include clicks.
fn taken(thing: impl Fn(u32) -> Vec<u32>, clicks: &[ClickDistances], near: &[f32]) -> Vec<bool> {
    let mut inside = vec![false; near.len()];
    for ClickDistances { click, part, ways } in clicks.iter().filter(|around| around.click.include)
    {
        for part in thing(*part) {
            inside[part as usize] |= ways[part as usize] <= INCLUDED_REACH * click.depth;
        }
    }
    for ClickDistances { click, part, ways } in clicks.iter().filter(|around| !around.click.include)
    {
        if inside[*part as usize] {
            let lead = (near[*part as usize] - 2.0 * EXCLUDED_REACH * click.depth).max(0.0);
            inside
                .iter_mut()
                .zip(near.iter().zip(ways))
                .for_each(|(inside, (near, far))| *inside &= *near < far + lead);
        }
    }
    for ClickDistances { click, part, .. } in clicks {
        inside[*part as usize] = click.include;
    }
    inside
}

/// A set of voxels, one bit each.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct VoxelSet(Vec<u64>);

impl VoxelSet {
    /// Creates the set of those of `count` voxels for which `is_in` holds.
    pub fn of(count: usize, is_in: impl Fn(usize) -> bool) -> Self {
        let word = |first: usize| {
            (first..count.min(first + 64))
                .map(|at| u64::from(is_in(at)) << (at - first))
                .sum()
        };
        Self((0..count).step_by(64).map(word).collect())
    }

    pub fn has(&self, voxel: u32) -> bool {
        self.0[voxel as usize / 64] >> (voxel % 64) & 1 == 1
    }

    pub fn len(&self) -> u32 {
        self.0.iter().map(|word| word.count_ones()).sum()
    }

    /// Returns the intersection over union; 0 if both are empty.
    pub fn iou(&self, other: &Self) -> f32 {
        let (mut both, mut either) = (0, 0);
        for (a, b) in self.0.iter().zip(&other.0) {
            both += (a & b).count_ones();
            either += (a | b).count_ones();
        }
        both as f32 / either.max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxel_sets_have_the_right_members_and_iou() {
        let thirds = VoxelSet::of(130, |at| at % 3 == 0);
        let halves = VoxelSet::of(130, |at| at % 2 == 0);
        assert_eq!((thirds.len(), halves.len()), (44, 65));
        assert!(thirds.has(129) && !thirds.has(128) && halves.has(128));
        assert!((thirds.iou(&halves) - 22.0 / 87.0).abs() < 1e-6);
        assert_eq!(
            VoxelSet::of(9, |_| false).iou(&VoxelSet::of(9, |_| false)),
            0.0
        );
    }
}
