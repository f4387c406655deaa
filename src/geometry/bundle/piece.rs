use glam::{DVec2, DVec3};

use super::groups::Groups;

/// One observation, sorted to its point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    pub image: u32,
    pub at_px: DVec2,
}

/// A few hundred points with all that see them: the unit of work for one thread.
#[derive(Debug, Clone, Default)]
pub(super) struct Piece {
    /// Which points of the bundle these are.
    pub ids: Vec<u32>,
    /// Where they are.
    pub points: Vec<DVec3>,
    /// Where they would be after the step that is tried.
    pub tried: Vec<DVec3>,
    /// Observations of point `p` are `starts[p]..starts[p + 1]`, by the block of their image.
    pub starts: Vec<u32>,
    pub sightings: Vec<Sighting>,
    /// One group per observation.
    pub by_sighting: Groups,
    /// One group per point: its poses in the order of its observations, then intrinsics; none when points are fixed.
    pub by_point: Groups,
}

impl Piece {
    /// The observations of one point.
    #[inline(always)]
    pub fn sightings_of(&self, point: usize) -> std::ops::Range<usize> {
        self.starts[point] as usize..self.starts[point + 1] as usize
    }
}
