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
