use std::sync::Arc;

use rayon::prelude::*;

use super::parting::{Parting, VoxelClick};
use super::supervoxels::Supervoxels;
use super::voxel_set::VoxelSet;
use super::voxels::Voxels;
use crate::carry::Viewpoint;
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
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
pub struct Surfaces {
    pub voxels: Voxels,
    partings: Vec<Parting>,
}

impl Surfaces {
    pub fn of(views: &[(Viewpoint, Arc<Image>)], progress: &Progress) -> Result<Self, SceneError> {
        let least_views = if views.len() > 2 { 2 } else { 1 };
        let voxels = Voxels::of(views, side(views), least_views, progress)?;
        let mut partings = Vec::new();
        for neighbours in NORMAL_NEIGHBOURS {
            let normals = voxels.normals(neighbours, progress)?;
            let parting = |sides: f32| {
                let parts = Supervoxels::of(&voxels, &normals, sides * voxels.side, progress)?;
                Ok(Parting::new(parts, voxels.side))
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
        self.voxels.bytes() + self.partings.iter().map(Parting::bytes).sum::<usize>()
    }
}

/// The median over the frames of how wide so many pixels are at a frame's median depth.
fn side(views: &[(Viewpoint, Arc<Image>)]) -> f32 {
    let width = |(view, _): &(Viewpoint, Arc<Image>)| {
        Some(SIDE_PX * view.median_depth()? / view.stand.camera.focal_px.x as f32)
    };
    let mut widths: Vec<f32> = views.iter().filter_map(width).collect();
    widths.sort_by(f32::total_cmp);
    widths.get(widths.len() / 2).copied().unwrap_or(1.0)
}
