use super::plane::Plane;
use ostra_masks::{Connectivity, Region, components};

/// A piece of a mask stays only if at least this share of it lies where the object is expected.
const EXPECTED: f32 = 0.1;
/// Pieces of fewer pixels go.
const LEAST: usize = 8;

/// Takes away pieces that lie elsewhere than the object, whose expected shape is where `expected` is above `level`, and
/// specks, unless the whole object is one.
pub(super) fn keep_expected(mask: &mut Region, expected: &Plane, level: f32) {
    let found = components(mask, Connectivity::Eight);
    let mut common = vec![0usize; found.areas.len()];
    for (&label, &expected) in found.labels.iter().zip(&expected.values) {
        if label > 0 && expected > level {
            common[label as usize - 1] += 1;
        }
    }
    let least = LEAST.min(found.areas.iter().copied().max().unwrap_or(0));
    let keep = |piece: usize| {
        let area = found.areas[piece];
        area >= least && common[piece] as f32 > EXPECTED * area as f32
    };
    let kept: Vec<bool> = (0..found.areas.len()).map(keep).collect();
    for (inside, &label) in mask.inside.iter_mut().zip(&found.labels) {
        *inside = label > 0 && kept[label as usize - 1];
    }
}
