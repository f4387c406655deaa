use std::collections::BTreeMap;

use glam::{DVec3, I64Vec3, Vec3};
use rayon::prelude::*;

use crate::{LabelledCloud, SceneError};
use ostra_masks::LabelId;

/// One point for each cube of edge `voxel` that holds points: mean position, colour and normal; the label that most of
/// its points have (the smaller id in a tie), and as confidence the sum of that label's confidences over all its points.
///
/// # Errors
/// [`SceneError::Request`] for an edge that is no length above 0.
pub fn downsample(cloud: &LabelledCloud, voxel: f64) -> Result<LabelledCloud, SceneError> {
    if !(voxel.is_finite() && voxel > 0.0) {
        return Err(SceneError::Request(format!(
            "a voxel size of {voxel} is not possible; give a length above 0"
        )));
    }
    let cell = |position: &Vec3| {
        let I64Vec3 { x, y, z } = (position.as_dvec3() / voxel).floor().as_i64vec3();
        (z, y, x)
    };
    let mut order: Vec<((i64, i64, i64), u32)> = cloud
        .positions
        .iter()
        .enumerate()
        .map(|(index, position)| (cell(position), index as u32))
        .collect();
    order.par_sort_unstable();
    let mut thin = LabelledCloud {
        tree: cloud.tree.clone(),
        origin: cloud.origin,
        ..LabelledCloud::default()
    };
    for group in order.chunk_by(|a, b| a.0 == b.0) {
        let members: Vec<usize> = group.iter().map(|&(_, index)| index as usize).collect();
        push_mean(&mut thin, cloud, &members);
    }
    Ok(thin)
}

fn push_mean(thin: &mut LabelledCloud, cloud: &LabelledCloud, members: &[usize]) {
    let count = members.len() as f64;
    let sum = |of: &dyn Fn(usize) -> DVec3| members.iter().map(|&index| of(index)).sum::<DVec3>();
    let color = sum(&|index| DVec3::from_array(cloud.colors[index].map(f64::from))) / count;
    let (label, confidence) = winner(cloud, members);
    thin.positions
        .push((sum(&|index| cloud.positions[index].as_dvec3()) / count).as_vec3());
    thin.normals.push(
        sum(&|index| cloud.normals[index].as_dvec3())
            .as_vec3()
            .normalize_or_zero(),
    );
    thin.colors
        .push(color.to_array().map(|channel| channel.round() as u8));
    thin.labels.push(label);
    thin.confidence.push((confidence / count) as f32);
}

/// The label that most members have, and the sum of their confidences.
fn winner(cloud: &LabelledCloud, members: &[usize]) -> (LabelId, f64) {
    let mut votes: BTreeMap<LabelId, (usize, f64)> = BTreeMap::new();
    for &index in members {
        let (count, confidence) = votes.entry(cloud.labels[index]).or_default();
        *count += 1;
        *confidence += f64::from(cloud.confidence[index]);
    }
    let best = votes.iter().rev().max_by_key(|(_, (count, _))| *count);
    best.map_or((LabelId::NONE, 0.0), |(&id, &(_, confidence))| {
        (id, confidence)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_majority() {
        let mut cloud = LabelledCloud::from_positions(vec![
            Vec3::new(0.1, 0.0, 0.0),
            Vec3::new(2.5, 0.0, 0.0),
            Vec3::new(0.3, 0.0, 0.0),
            Vec3::new(0.8, 0.3, 0.0),
        ]);
        cloud.labels = vec![LabelId(5), LabelId(0), LabelId(2), LabelId(5)];
        cloud.confidence = vec![1.0, 0.0, 0.9, 0.5];
        cloud.colors = vec![[0; 3], [9; 3], [100; 3], [200; 3]];
        let thin = downsample(&cloud, 1.0).unwrap();
        assert_eq!(
            thin.positions,
            [Vec3::new(0.4, 0.1, 0.0), Vec3::new(2.5, 0.0, 0.0)]
        );
        assert_eq!(thin.labels, [LabelId(5), LabelId(0)]);
        assert_eq!(thin.confidence, [0.5, 0.0]);
        assert_eq!(thin.colors, [[100; 3], [9; 3]]);
        assert!(downsample(&cloud, 0.0).is_err() && downsample(&cloud, f64::NAN).is_err());
    }

    #[test]
    fn a_tie_goes_to_the_smaller_id() {
        let mut cloud = LabelledCloud::from_positions(vec![Vec3::ZERO; 2]);
        cloud.labels = vec![LabelId(7), LabelId(3)];
        assert_eq!(downsample(&cloud, 1.0).unwrap().labels, [LabelId(3)]);
    }
}
