use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

use rayon::prelude::*;

use super::segmentation::{BoundaryWeights, Supervoxels};
use super::tree::Tree;
use super::voxels::Voxels;
use crate::reprojection::DepthView;
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_core::statistics::upper_median;
use ostra_frames::Image;

/// Side of a voxel, in pixels at the median depth of the frames.
const SIDE_PX: f32 = 4.5;
/// Neighbours that normals are laid through; each gives other partings.
const NORMAL_NEIGHBOURS: [usize; 3] = [24, 48, 80];
/// Widths of supervoxels, in sides of a voxel; each gives other partings.
const STEP_SIDES: [f32; 3] = [3.0, 4.0, 5.0];
/// An answer that takes more of all voxels than this is no thing.
const LARGEST_SHARE: f32 = 0.35;

/// What some frames see in space, parted in many ways. A single way errs easily; the answer that agrees most with those of
/// all the others rarely does.
///
/// One clustering of supervoxels by convexity (LCCP: S. Stein et al., "Object Partitioning Using Local Convexity", CVPR 2014)
/// finds the right object on a real shelf about every second time, and which settings do changes from object to object. So nine
/// partitions (`NORMAL_NEIGHBOURS` × `STEP_SIDES`) are each clustered by average linkage under three weightings of borders
/// (`JUDGEMENTS`) and cut at four strengths (`LEAST_STRENGTHS`); the answer has the largest mean squared IoU with all
/// others.
pub struct Surfaces {
    pub voxels: Voxels,
    partings: Vec<Partition>,
}

impl Surfaces {
    pub fn of(views: &[(DepthView, Arc<Image>)], progress: &Progress) -> Result<Self, SceneError> {
        let least_views = if views.len() > 2 { 2 } else { 1 };
        let voxels = Voxels::of(views, side(views), least_views, progress)?;
        let mut partings = Vec::new();
        for neighbours in NORMAL_NEIGHBOURS {
            let normals = voxels.normals(neighbours, progress)?;
            let parting = |sides: f32| {
                let parts = Supervoxels::of(&voxels, &normals, sides * voxels.side, progress)?;
                Ok(Partition::new(parts, voxels.side))
            };
            partings.extend(
                STEP_SIDES
                    .into_par_iter()
                    .map(parting)
                    .collect::<Result<Vec<_>, SceneError>>()?,
            );
        }
        Ok(Self { voxels, partings })
    }

    /// The voxels that clicks ask for: of all answers the one that is most like the others. `None` where no answer is a
    /// thing.
    pub fn answer(&self, clicks: &[VoxelClick]) -> Option<VoxelSet> {
        let most = (LARGEST_SHARE * self.voxels.len() as f32) as u32;
        let answers: Vec<VoxelSet> = self
            .partings
            .par_iter()
            .flat_map_iter(|parting| parting.answers(clicks))
            .collect();
        let mut answers: Vec<VoxelSet> = answers
            .into_iter()
            .filter(|answer| answer.len() <= most)
            .collect();
        // Squared, so that many which are nearly the same outweigh many more that are a little alike.
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
        self.voxels.bytes() + self.partings.iter().map(Partition::bytes).sum::<usize>()
    }
}

/// The median over the frames of how wide so many pixels are at a frame's median depth.
fn side(views: &[(DepthView, Arc<Image>)]) -> f32 {
    let width = |(view, _): &(DepthView, Arc<Image>)| {
        Some(SIDE_PX * view.median_depth()? / view.posed.camera.focal_px.x as f32)
    };
    let mut widths: Vec<f32> = views.iter().filter_map(width).collect();
    upper_median(&mut widths).unwrap_or(1.0)
}

/// Ways to judge borders; each gives another tree.
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
/// Strengths from which on a border may be where a thing ends; each gives another answer.
const LEAST_STRENGTHS: [f32; 4] = [0.4, 0.5, 0.6, 0.8];
/// How much longer than itself a way is over a full border, in sides of a voxel.
const BORDER_SIDES: f32 = 1.5;
/// How far the part that an exclude click means reaches towards the include clicks, in distances from the click to the rim
/// of the answer: who clicks on what is wrong clicks in its middle.
const EXCLUDED_REACH: f32 = 1.5;
/// Exclude clicks at least this deep, as a share of the deepest, part two things; the others put a border right.
const PARTING_SHARE: f32 = 0.5;
/// How far the part that a further include click means reaches, in distances from the click to the answer.
const INCLUDED_REACH: f32 = 2.0;

/// A click on a voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelClick {
    pub voxel: u32,
    pub include: bool,
    /// From an exclude click to the rim of the answer before it, from an include click to that answer, world units;
    /// infinite where there was none.
    pub depth: f32,
}

/// One way to part surfaces into supervoxels, and these into things.
struct Partition {
    parts: Supervoxels,
    trees: Vec<Tree>,
    /// For every supervoxel its neighbours and the way to them, world units.
    ways: Vec<Vec<(u32, f32)>>,
}

impl Partition {
    /// `side` is that of the voxels.
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
            .map(|judgement| Tree::of(&parts, judgement))
            .into();
        Self { parts, trees, ways }
    }

    /// The voxels that clicks may mean, one answer for each tree, strength and way to take out what exclude clicks mean: as far
    /// as they reach, and all that hangs together with them more than with the include clicks.
    ///
    /// A later click only changes what lies within about its distance to the answer's border, because users click in the middle
    /// of what is wrong. The answers that also end where the tree would join the excluded part separate a book from the wall it
    /// leans on.
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
        let parting = excluded().filter(|around| around.click.depth >= PARTING_SHARE * deepest);
        let parting: Vec<u32> = parting.map(|around| around.part).collect();
        let apart: &[&[u32]] = if parting.is_empty() {
            &[&[]]
        } else {
            &[&[], &parting]
        };
        let things = self
            .trees
            .iter()
            .flat_map(|tree| apart.iter().map(move |apart| (tree, tree.around(apart))));
        let taken = |(tree, closed): (&Tree, Vec<bool>)| {
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

    /// The shortest way from a supervoxel to each (Dijkstra, "A note on two problems in connexion with graphs", Numerische
    /// Mathematik 1959), world units.
    fn ways_from(&self, part: u32) -> Vec<f32> {
        let mut shortest = vec![f32::INFINITY; self.parts.len()];
        shortest[part as usize] = 0.0;
        let mut open = BinaryHeap::from([Reverse((0, part))]);
        while let Some(Reverse((bits, part))) = open.pop() {
            // Ways are not negative, so their bits order as they do.
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
        let trees: usize = self.trees.iter().map(Tree::bytes).sum();
        trees
            + self.parts.of_voxel.len() * 4
            + self.parts.borders.len() * 36
            + self.parts.len() * 40
    }
}

/// A click with the ways from it to all supervoxels.
struct ClickDistances {
    click: VoxelClick,
    part: u32,
    ways: Vec<f32>,
}

/// Which supervoxels clicks take; `thing` gives those of the thing that one belongs to, `near` are the shortest ways to the
/// include clicks.
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

/// Which of many voxels belong to something: one bit each.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct VoxelSet(Vec<u64>);

impl VoxelSet {
    /// Those of `count` voxels that `is_in` holds for.
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

    /// Intersection over union; 0 where both are empty.
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
    fn sets_know_their_voxels() {
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
