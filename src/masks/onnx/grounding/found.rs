use glam::DVec2;

use super::caption::Caption;
use crate::masks::onnx::boxes::without_doubles;
use crate::masks::{Grounded, PxBox};

/// Boxes of one phrase that overlap by more are one thing.
const MOST_OVERLAP: f64 = 0.8;

/// What the network found, the surest first. `logits` tell, for each query, how much it is what a token says:
/// `[queries, width]`, of which the first columns are the caption's tokens; `boxes` where it lies, `[queries, 4]`: middle,
/// width and height as shares of a picture of `size` pixels. A box goes to the phrase whose tokens it fits best, its
/// score is that of the best token, and counts above `least`.
#[must_use]
pub fn grounded(
    caption: &Caption,
    logits: &[f32],
    width: usize,
    boxes: &[f32],
    size: DVec2,
    least: f32,
) -> Vec<Grounded> {
    // The token before a phrase's end is the full stop, which says nothing of the thing.
    let last_of = |at: usize| caption.phrases.get(at + 1) != Some(&caption.phrases[at]);
    let tokens = caption.phrases.iter().enumerate().filter(|&(at, _)| !last_of(at));
    let tokens: Vec<(usize, usize)> = tokens.filter_map(|(at, phrase)| Some((at, (*phrase)?))).collect();
    let query = |(logits, place): (&[f32], &[f32])| {
        let best = tokens.iter().map(|&(at, phrase)| (logits[at], phrase));
        // Of equal ones the first.
        let (logit, phrase) = best.reduce(|a, b| if b.0 > a.0 { b } else { a })?;
        let [x, y, columns, rows] = [0, 1, 2, 3].map(|at| f64::from(place[at]));
        let (middle, half) = (DVec2::new(x, y), DVec2::new(columns, rows) / 2.0);
        let within = |corner: DVec2| (corner * size).clamp(DVec2::ZERO, size);
        let extent = PxBox { min_px: within(middle - half), max_px: within(middle + half) };
        let score = 1.0 / (1.0 + (-logit).exp());
        let is_there = score > least && extent.max_px.cmpgt(extent.min_px).all();
        is_there.then_some(Grounded { phrase, extent, score })
    };
    let mut found: Vec<Grounded> = logits.chunks_exact(width).zip(boxes.chunks_exact(4)).filter_map(query).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let phrases = caption.phrases.iter().flatten().max().map_or(0, |&last| last + 1);
    let apart = (0..phrases).flat_map(|phrase| {
        let of_phrase = found.iter().filter(|one| one.phrase == phrase).copied().collect();
        without_doubles(of_phrase, MOST_OVERLAP, |one: &Grounded| one.extent)
    });
    let mut apart: Vec<Grounded> = apart.collect();
    apart.sort_by(|a, b| b.score.total_cmp(&a.score));
    apart
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_go_to_the_phrase_that_fits_best() {
        // [CLS] red cat . dog . [SEP]
        let phrases = vec![None, Some(0), Some(0), Some(0), Some(1), Some(1), None];
        let caption = Caption { ids: vec![0; 7], positions: vec![0; 7], phrases };
        let logits = [
            [9.0, -3.0, 1.0, 9.0, -1.0, 9.0, 9.0, 9.0],  // a cat
            [9.0, -3.0, -3.0, 9.0, 2.0, 9.0, 9.0, 9.0],  // a dog, surer
            [0.0, -3.0, -3.0, 9.0, 1.5, 9.0, 9.0, 9.0],  // the same dog
            [0.0, -3.0, -3.0, 9.0, -2.0, 9.0, 9.0, 9.0], // nothing
        ];
        let boxes = [[0.5, 0.5, 0.5, 0.5], [0.25, 0.5, 0.5, 1.0], [0.26, 0.5, 0.5, 1.0], [0.5, 0.5, 0.5, 0.5]];
        let size = DVec2::new(200.0, 100.0);
        let found = grounded(&caption, logits.as_flattened(), 8, boxes.as_flattened(), size, 0.3);
        let told: Vec<(usize, PxBox)> = found.iter().map(|one| (one.phrase, one.extent)).collect();
        let part = |x0, y0, x1, y1| PxBox { min_px: DVec2::new(x0, y0), max_px: DVec2::new(x1, y1) };
        assert_eq!(told, [(1, part(0.0, 0.0, 100.0, 100.0)), (0, part(50.0, 25.0, 150.0, 75.0))]);
        assert!((found[0].score - 0.880_797).abs() < 1e-5 && (found[1].score - 0.731_059).abs() < 1e-5);
    }
}
