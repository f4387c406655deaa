use super::source::Views;
use crate::SceneError;
use ostra_masks::LabelId;

/// Frames looked at.
const FRAMES: usize = 8;
/// Pixels of a frame looked at: every so many.
const PIXEL_STEP: usize = 37;
/// Labelled pixels among those that are enough to go by.
const ENOUGH_LABELLED: usize = 20;

/// What one pixel covers at the median depth, rounded to two digits: the finest detail that most pixels can show. Where
/// masks have labels, only labelled pixels count: a plant stands nearer than the wall behind it. `None` when no frame
/// has a depth above 0.
///
/// # Errors
/// What reading a depth says.
pub fn pixel_footprint(views: &dyn Views, usable: &[usize]) -> Result<Option<f64>, SceneError> {
    let step = usable.len().div_ceil(FRAMES).max(1);
    let (mut labelled, mut all) = (Vec::new(), Vec::new());
    for &index in usable.iter().step_by(step) {
        let (Some((camera, _)), Some(depth)) =
            (views.frames()[index].posed_camera(), views.depth(index)?)
        else {
            continue;
        };
        let focal = camera.focal_px.max_element() as f32;
        let mask = views.mask(index);
        let has_label = |pixel: usize| {
            mask.as_ref()
                .and_then(|mask| mask.ids.get(pixel))
                .is_some_and(|&id| id != LabelId::NONE)
        };
        for (pixel, &depth) in depth.depths.iter().enumerate().step_by(PIXEL_STEP) {
            if depth > 0.0 && depth.is_finite() {
                all.push(depth / focal);
                labelled.extend(has_label(pixel).then_some(depth / focal));
            }
        }
    }
    let enough = labelled.len() >= ENOUGH_LABELLED;
    Ok(median(if enough { labelled } else { all }).map(two_digits))
}

fn median(mut values: Vec<f32>) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    let (_, median, _) = values.select_nth_unstable_by(middle, f32::total_cmp);
    Some(f64::from(*median))
}

pub(super) fn two_digits(value: f64) -> f64 {
    let unit = 10f64.powi(value.log10().floor() as i32 - 1);
    let steps = (value / unit).round();
    // Dividing by whole powers of ten gives the number that a person would write: 0.0034, not 0.0034000000000000002.
    if unit < 1.0 {
        steps / (1.0 / unit).round()
    } else {
        steps * unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_a_person_would_write() {
        assert_eq!(two_digits(0.003_412), 0.0034);
        assert_eq!(two_digits(0.099_9), 0.1);
        assert_eq!(two_digits(123.0), 120.0);
        assert_eq!(two_digits(1.26), 1.3);
    }
}
