use super::described::DescribedCloud;
use super::fast::fast;
use super::matching;
use super::options::{GlobalOptions, GlobalRegistration};
use super::pairs::Pairs;
use super::sampled::sampled;
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_geometry::Pose;

/// How near the points of a pair must come to agree with a pose, in voxels.
const AGREEING: f64 = 1.5;
/// How often the pose is fitted again to the pairs that agree with it.
const REFINEMENTS: usize = 5;

/// A pose found without a guess, right to about a voxel where it is right.
///
/// Whether to believe it, `agreeing` tells. Matches are made from the shapes around points alone, so wrong ones lie
/// anywhere and hardly any wrong pose brings many of them together. In fragments of a Kinect's clip through a kitchen
/// (some 500 to 1500 matches) wrong poses had 3 to 22 that agree, at most 0.03 of `matches`; right ones had more than 27,
/// and where the fragments share half mostly more than 100. Below 40 a right one may be off by several voxels. What looks the
/// same in two places, and a thing and its mirror image, have many that agree too: that no number here shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlobalAlignment {
    /// What brings the source onto the target.
    pub target_from_source: Pose,
    /// Points whose descriptors are each other's nearest.
    pub matches: usize,
    /// How many of them the pose brings within 1.5 voxels, with normals within 45°.
    pub agreeing: usize,
}

/// Lays two clouds onto each other without a guess; `None` where too few matches agree on a pose. Both must be described with
/// the same voxels. The same input and seed give the same bytes, whatever the number of threads.
///
/// # Errors
/// [`SceneError::Request`] for clouds of different voxels, or a share that is none; [`SceneError::Stopped`].
pub fn register_globally(
    source: &DescribedCloud,
    target: &DescribedCloud,
    options: &GlobalOptions,
    progress: &Progress,
) -> Result<Option<GlobalAlignment>, SceneError> {
    if source.voxel.to_bits() != target.voxel.to_bits() {
        let voxels = [source.voxel, target.voxel];
        return Err(SceneError::Request(format!(
            "clouds with voxels of {voxels:?} cannot be matched; use one size"
        )));
    }
    if !(0.0..=1.0).contains(&options.min_share) {
        return Err(SceneError::Request(
            "the share of matches that agree must be from 0 to 1".into(),
        ));
    }
    let matches = matching::mutual(&source.descriptors, &target.descriptors, progress)?;
    let distance = AGREEING * f64::from(source.voxel);
    let pairs = Pairs::new(source, target, &matches, distance);
    let least = options
        .min_agreeing
        .max((options.min_share * matches.len() as f64).ceil() as usize)
        .max(3);
    let found = match options.method {
        GlobalRegistration::Fgr => fast(&pairs, distance, options.seed),
        GlobalRegistration::Ransac => sampled(&pairs, least, options.seed),
    };
    progress.check()?;
    let alignment = found.map(|pose| {
        let target_from_source = settled(&pairs, pose);
        let agreeing = pairs.agreeing(&target_from_source);
        GlobalAlignment {
            target_from_source,
            matches: matches.len(),
            agreeing,
        }
    });
    Ok(alignment.filter(|found| found.agreeing >= least))
}

/// The pose fitted again to what agrees with it, while that costs less.
fn settled(pairs: &Pairs, mut pose: Pose) -> Pose {
    let mut cost = pairs.cost(&pose, f64::INFINITY);
    for _ in 0..REFINEMENTS {
        let Some(refined) = pairs.refined(&pose) else {
            break;
        };
        let its_cost = pairs.cost(&refined, f64::INFINITY);
        if its_cost >= cost {
            break;
        }
        (pose, cost) = (refined, its_cost);
    }
    pose
}
