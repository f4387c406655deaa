use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{Mat2, Vec3};
use rayon::prelude::*;

use crate::rgbd::align::Aligned;
use crate::rgbd::link::{PoseGuess, align_and_check};
use crate::rgbd::pyramid::{Pyramid, PyramidLevel};
use crate::rgbd::rgbd_image::RgbdImage;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::{Frame, FrameStore};
use ostra_geometry::{Camera, Isometry, Pose, is_same_depth};

/// Number of pairs to find.
const PAIRS: usize = 40;
/// Distance in frames at which the other frame of a pair is searched: the farther, the more of the parallax shows.
const GAPS: [usize; 3] = [8, 4, 1];
/// Depths of the same surface differ by at most this share.
const SAME: f32 = 0.02;

/// Two views whose depths were aligned.
pub struct AlignedPair {
    /// Both, the source first.
    pub views: [Pyramid; 2],
    aligned: Aligned,
}

/// Frames that are assumed to have one camera for images and depths.
pub struct Recording<'a> {
    /// All frames of the project.
    pub frames: &'a [Frame],
    /// Numbers of these frames, ascending.
    pub numbers: &'a [usize],
    /// The assumed camera.
    pub camera: Camera,
    /// Reads them.
    pub store: &'a FrameStore,
}

/// A point that both views of a pair see, in the axes of each.
pub type Shared = [Vec3; 2];

impl AlignedPair {
    /// Aligns the depths of two views.
    ///
    /// Images only give the initial pose: where they are not aligned with their depths, they would
    /// pull the pose off.
    fn of(views: [&RgbdImage; 2]) -> Option<Self> {
        let blind = views.map(|view| Pyramid::new(&view.without_image()));
        let views = views.map(Pyramid::new);
        let (guess, _) =
            align_and_check(views.each_ref(), &[(Pose::IDENTITY, PoseGuess::Far)]).ok()?;
        let (aligned, _) = align_and_check(
            blind.each_ref(),
            &[(guess.target_from_source, PoseGuess::Near)],
        )
        .ok()?;
        Some(Self { views, aligned })
    }

    /// Returns the points that the depths of both show, at a level of the pyramids.
    #[must_use]
    pub fn shared(&self, level: usize) -> Vec<Shared> {
        let [source, target] = self.views.each_ref().map(|view| &view.levels[level]);
        let target_from_source = Isometry::from(&self.aligned.target_from_source);
        let both = |pixel: usize| {
            let depth = source.depths[pixel];
            let point = source.ray(pixel % source.width, pixel / source.width) * depth;
            let there = target_from_source.transform(point);
            (depth > 0.0 && meets(target, there)).then_some([point, there])
        };
        (0..source.depths.len()).filter_map(both).collect()
    }

    /// Returns how directions in the source's image are rotated in the target's.
    #[must_use]
    pub fn turn_of_image(&self) -> Mat2 {
        Mat2::from_mat3(Isometry::from(&self.aligned.target_from_source).rotation)
    }

    /// Returns the information as in [`Aligned::information`], by depth alone.
    #[must_use]
    pub fn information(&self) -> &[[f64; 6]; 6] {
        &self.aligned.information
    }

    /// Returns the mean depth of the target, in world units.
    #[must_use]
    pub fn typical_depth(&self) -> f32 {
        self.views[1].typical_depth
    }
}

fn meets(target: &PyramidLevel, point: Vec3) -> bool {
    let Some(at_px) = target.project(point) else {
        return false;
    };
    let depth = target.depths[at_px.y as usize * target.width + at_px.x as usize];
    depth > 0.0 && is_same_depth(point.z, depth, SAME)
}

impl Recording<'_> {
    /// Returns pairs of frames from all over the recording that see the same.
    ///
    /// # Errors
    /// If stopped.
    pub fn pairs(&self, progress: &Progress) -> Result<Vec<AlignedPair>, Stopped> {
        let done = AtomicUsize::new(0);
        let count = PAIRS.min(self.numbers.len());
        let from = |at: usize| {
            progress.step(done.fetch_add(1, Ordering::Relaxed), count)?;
            let Some(source) = self.view(self.numbers[at]) else {
                return Ok(None);
            };
            let mut gaps = GAPS
                .into_iter()
                .filter_map(|gap| self.view(*self.numbers.get(at + gap)?));
            Ok(gaps.find_map(|target| AlignedPair::of([&source, &target])))
        };
        let firsts: Vec<usize> = (0..count).map(|k| k * self.numbers.len() / count).collect();
        let pairs: Vec<Option<AlignedPair>> = firsts
            .into_par_iter()
            .map(from)
            .collect::<Result<_, Stopped>>()?;
        Ok(pairs.into_iter().flatten().collect())
    }

    /// Returns the registration's view of a frame; `None` if it cannot be read, which registration reports.
    fn view(&self, frame: usize) -> Option<RgbdImage> {
        let frame = &self.frames[frame];
        let (image, depth) = (
            self.store.image(frame).ok()?,
            self.store.depth(frame).ok()??,
        );
        let size = (self.camera.width, self.camera.height);
        let fits = (image.width, image.height) == size && (depth.width, depth.height) == size;
        fits.then(|| RgbdImage::new(&image, &depth, &self.camera))
    }
}
