use crate::stereo::DepthEstimate;

/// Forgets connected surfaces that other views support too little: a small one stays where many views see it, as a thin
/// part's pieces are. `support` counts the views by pixel, `least` is the sum over a surface that it needs.
pub fn remove_speckles(estimate: &mut DepthEstimate, support: &[u8], least: usize, tolerance: f32) {
    let mut seen = vec![false; estimate.depths.len()];
    let mut surface = Vec::new();
    for start in 0..seen.len() {
        if seen[start] || estimate.depths[start] <= 0.0 {
            continue;
        }
        grow(estimate, start, tolerance, &mut seen, &mut surface);
        if surface
            .iter()
            .map(|&at| usize::from(support[at]))
            .sum::<usize>()
            < least
        {
            surface.iter().for_each(|&at| estimate.clear(at));
        }
    }
}

/// The pixels that are one surface with a pixel.
fn grow(
    estimate: &DepthEstimate,
    start: usize,
    tolerance: f32,
    seen: &mut [bool],
    surface: &mut Vec<usize>,
) {
    let (width, height) = (estimate.width(), estimate.height());
    surface.clear();
    surface.push(start);
    seen[start] = true;
    let mut next = 0;
    while let Some(&at) = surface.get(next) {
        next += 1;
        let (x, y) = (at % width, at / width);
        let (columns, rows) = (
            x.saturating_sub(1)..(x + 2).min(width),
            y.saturating_sub(1)..(y + 2).min(height),
        );
        for to in rows.flat_map(|row| columns.clone().map(move |column| row * width + column)) {
            let (depth, other) = (estimate.depths[at], estimate.depths[to]);
            if !seen[to] && other > 0.0 && (other - depth).abs() <= tolerance * depth {
                seen[to] = true;
                surface.push(to);
            }
        }
    }
}
