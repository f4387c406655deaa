/// The middle one of some values, or the mean of the two in the middle.
///
/// # Panics
/// When there are none.
pub fn median(mut values: Vec<f32>) -> f32 {
    values.sort_unstable_by(f32::total_cmp);
    let last = values.len() - 1;
    0.5 * (values[last / 2] + values[last.div_ceil(2)])
}
