use std::collections::VecDeque;

use super::contradiction::Contradictions;
use super::options::ConstrainOptions;
use ostra_cloud::doubt::Sighted;
use ostra_masks::LabelMask;

/// Takes pixels of which geometry is not sure along with the nearest ones of the same object of which it is: a few steps
/// into objects that were mended, anywhere in those that strayed, whose detached parts take what most of the object takes.
/// `mask` is what became of `tracked` so far.
pub fn spread(
    mask: &mut LabelMask,
    tracked: &LabelMask,
    sighted: &Sighted,
    found: &Contradictions,
    options: &ConstrainOptions,
) {
    let (width, count) = (mask.width as usize, mask.ids.len());
    let mut steps = vec![u32::MAX; count];
    let is_start =
        |&at: &usize| found.touched.contains(&tracked.ids[at]) && sighted.labels[at].is_some();
    let mut open: VecDeque<usize> = (0..count).filter(is_start).collect();
    open.iter().for_each(|&at| steps[at] = 0);
    while let Some(at) = open.pop_front() {
        let object = tracked.ids[at];
        if steps[at] >= options.border_px && !found.strayed.contains_key(&object) {
            continue;
        }
        let beside = [
            (at % width > 0).then(|| at - 1),
            (at % width + 1 < width).then(|| at + 1),
            at.checked_sub(width),
            (at + width < count).then(|| at + width),
        ];
        for next in beside.into_iter().flatten() {
            if tracked.ids[next] == object && steps[next] == u32::MAX {
                steps[next] = steps[at] + 1;
                mask.ids[next] = mask.ids[at];
                open.push_back(next);
            }
        }
    }
    let detached = (0..count).filter(|&at| steps[at] == u32::MAX);
    for (at, &label) in detached.filter_map(|at| Some((at, found.strayed.get(&tracked.ids[at])?))) {
        mask.ids[at] = label;
    }
}
