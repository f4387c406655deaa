use std::collections::BTreeMap;

use glam::DVec2;

use super::state::Mapper;

/// Levels of the grids in which an image's sightings are counted: 2 × 2, 4 × 4, … cells.
const LEVELS: u32 = 5;

impl Mapper<'_> {
    /// Images that may be placed, the one whose sightings of points cover it best first (Schönberger & Frahm,
    /// "Structure-from-Motion Revisited", CVPR 2016). An image that was refused comes again once it sees a fifth more.
    pub fn candidates(&self, refused: &BTreeMap<u32, usize>) -> Vec<u32> {
        let open = (0..self.problem.images.len() as u32).filter(|&image| self.is_open(image));
        let mut ranked: Vec<(u64, u32)> = open
            .filter_map(|image| {
                let seen = self.supported(image);
                let again = refused
                    .get(&image)
                    .is_none_or(|&before| seen * 5 >= before * 6 + 5);
                (seen >= self.options.pose_inliers && again).then(|| (self.coverage(image), image))
            })
            .collect();
        ranked.sort_unstable_by_key(|&(coverage, image)| (std::cmp::Reverse(coverage), image));
        ranked.into_iter().map(|(_, image)| image).collect()
    }

    /// How many of an image's keypoints are matched with one that sees a point.
    pub fn supported(&self, image: u32) -> usize {
        self.support(image)
            .iter()
            .filter(|&&count| count > 0)
            .count()
    }

    /// Occupied cells over all levels, each worth as much as its level has cells along a side, squared.
    fn coverage(&self, image: u32) -> u64 {
        let seen = &self.problem.images[image as usize];
        let camera = &self.model.cameras[seen.camera];
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let finest = 1usize << LEVELS;
        let mut occupied = vec![false; finest * finest];
        for (at_px, _) in seen
            .keypoints
            .iter()
            .zip(self.support(image))
            .filter(|&(_, &count)| count > 0)
        {
            let cell = (*at_px / size * finest as f64)
                .clamp(DVec2::ZERO, DVec2::splat(finest as f64 - 1.0));
            occupied[cell.y as usize * finest + cell.x as usize] = true;
        }
        let mut score = 0;
        let mut side = finest;
        while side > 1 {
            score += occupied.iter().filter(|&&taken| taken).count() as u64 * (side * side) as u64;
            occupied = halved(&occupied, side);
            side /= 2;
        }
        score
    }
}

/// The grid with half as many cells along a side.
fn halved(occupied: &[bool], side: usize) -> Vec<bool> {
    let half = side / 2;
    let mut coarse = vec![false; half * half];
    for (i, _) in occupied.iter().enumerate().filter(|&(_, &taken)| taken) {
        coarse[i / side / 2 * half + i % side / 2] = true;
    }
    coarse
}
