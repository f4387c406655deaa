use super::fpfh::{self, Descriptor};
use super::oriented::{OrientedCloud, check_voxel};
use ostra_cloud::SceneError;
use ostra_core::job::Progress;

/// A thinned cloud and descriptors of its points; made once for a cloud that is registered with many.
#[derive(Debug, Clone, PartialEq)]
pub struct DescribedCloud {
    pub(super) cloud: OrientedCloud,
    pub(super) voxel: f32,
    /// One for each of `places`.
    pub(super) descriptors: Vec<Descriptor>,
    /// Indices of the points that have a descriptor.
    pub(super) places: Vec<u32>,
}

impl DescribedCloud {
    /// Thins the cloud to `voxel` (world units, above 0) and describes its points; 5 voxels around a point should hold
    /// more than one surface, and what the two clouds share should be some 20 voxels long: 0.05 m for rooms.
    ///
    /// # Errors
    /// [`SceneError::Request`] for lists of unequal length or an edge that is no length above 0; [`SceneError::Stopped`].
    pub fn new(cloud: &OrientedCloud, voxel: f32, progress: &Progress) -> Result<Self, SceneError> {
        cloud.check()?;
        check_voxel(voxel)?;
        let cloud = cloud.thinned(voxel);
        let all = fpfh::describe(&cloud, voxel, progress)?;
        let (places, descriptors) = all
            .into_iter()
            .enumerate()
            .filter_map(|(index, found)| Some((index as u32, found?)))
            .unzip();
        Ok(Self {
            cloud,
            voxel,
            descriptors,
            places,
        })
    }
}
