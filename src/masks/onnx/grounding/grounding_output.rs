use glam::DVec2;

use super::caption::Caption;
use crate::onnx::non_maximum_suppression::non_maximum_suppression;
use crate::{Grounded, PxBox};

/// Maximum IoU of two boxes of one phrase; above it they are the same object.
const MOST_OVERLAP: f64 = 0.8;

/// Output of the network for an image and some phrases.
///
/// Can be filtered by any threshold without another run.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundingOutput {
    /// The phrases, as tokens.
    pub caption: Caption,
    /// Logit of each token for each query, `[queries, tokens]`.
    pub logits: Vec<f32>,
    /// Box of each query, `[queries, 4]`: centre, width and height as fractions of the image.
    pub boxes: Vec<f32>,
    /// Columns and rows of the image.
    pub size_px: DVec2,
}

impl GroundingOutput {
    /// Returns the objects whose score is above `least` (0–1), highest score first.
    ///
    /// A box goes to the phrase with the best matching token, and the score of that token is its
    /// score. Boxes of one phrase that overlap are reduced by non-maximum suppression.
    #[must_use]
    pub fn above(&self, least: f32) -> Vec<Grounded> {
        let mut found: Vec<Grounded> = self
            .queries()
            .into_iter()
            .filter(|one| one.score > least)
            .collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        let phrases = self
            .caption
            .phrases
            .iter()
            .flatten()
            .max()
            .map_or(0, |&last| last + 1);
        let apart = (0..phrases).flat_map(|phrase| {
            let of_phrase = found
                .iter()
                .filter(|one| one.phrase == phrase)
                .copied()
                .collect();
            non_maximum_suppression(of_phrase, MOST_OVERLAP, |one: &Grounded| one.extent)
        });
        let mut apart: Vec<Grounded> = apart.collect();
        apart.sort_by(|a, b| b.score.total_cmp(&a.score));
        apart
    }

    /// Returns every query whose box overlaps the image.
    fn queries(&self) -> Vec<Grounded> {
        let Caption { ids, phrases, .. } = &self.caption;
        // The last token of a phrase is the full stop, which does not describe the object.
        let is_stop = |at: usize| phrases.get(at + 1) != Some(&phrases[at]);
        let words = phrases.iter().enumerate().filter(|&(at, _)| !is_stop(at));
        let words: Vec<(usize, usize)> = words
            .filter_map(|(at, phrase)| Some((at, (*phrase)?)))
            .collect();
        let query = |(logits, place): (&[f32], &[f32])| {
            let best = words.iter().map(|&(at, phrase)| (logits[at], phrase));
            // The first one wins on ties.
            let (logit, phrase) = best.reduce(|a, b| if b.0 > a.0 { b } else { a })?;
            let [x, y, columns, rows] = [0, 1, 2, 3].map(|at| f64::from(place[at]));
            let (middle, half) = (DVec2::new(x, y), DVec2::new(columns, rows) / 2.0);
            let within = |corner: DVec2| (corner * self.size_px).clamp(DVec2::ZERO, self.size_px);
            let extent = PxBox {
                min_px: within(middle - half),
                max_px: within(middle + half),
            };
            let is_there = extent.max_px.cmpgt(extent.min_px).all();
            is_there.then_some(Grounded {
                phrase,
                extent,
                score: 1.0 / (1.0 + (-logit).exp()),
            })
        };
        self.logits
            .chunks_exact(ids.len())
            .zip(self.boxes.chunks_exact(4))
            .filter_map(query)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_assigned_to_the_best_matching_phrase() {
        // [CLS] red cat . dog . [SEP]
        let phrases = vec![None, Some(0), Some(0), Some(0), Some(1), Some(1), None];
        let caption = Caption {
            ids: vec![0; 7],
            positions: vec![0; 7],
            phrases,
        };
        let logits = [
            [9.0, -3.0, 1.0, 9.0, -1.0, 9.0, 9.0],  // a cat
            [9.0, -3.0, -3.0, 9.0, 2.0, 9.0, 9.0],  // a dog, higher score
            [0.0, -3.0, -3.0, 9.0, 1.5, 9.0, 9.0],  // the same dog
            [0.0, -3.0, -3.0, 9.0, -2.0, 9.0, 9.0], // background
        ];
        let boxes = [
            [0.5, 0.5, 0.5, 0.5],
            [0.25, 0.5, 0.5, 1.0],
            [0.26, 0.5, 0.5, 1.0],
            [0.5, 0.5, 0.5, 0.5],
        ];
        let (logits, boxes) = (
            logits.as_flattened().to_vec(),
            boxes.as_flattened().to_vec(),
        );
        let answer = GroundingOutput {
            caption,
            logits,
            boxes,
            size_px: DVec2::new(200.0, 100.0),
        };
        let found = answer.above(0.3);
        let found_boxes: Vec<(usize, PxBox)> =
            found.iter().map(|one| (one.phrase, one.extent)).collect();
        let part = |x0, y0, x1, y1| PxBox {
            min_px: DVec2::new(x0, y0),
            max_px: DVec2::new(x1, y1),
        };
        assert_eq!(
            found_boxes,
            [
                (1, part(0.0, 0.0, 100.0, 100.0)),
                (0, part(50.0, 25.0, 150.0, 75.0))
            ]
        );
        assert_eq!(
            answer.above(0.75),
            found[..1],
            "what is asked for moves afterwards"
        );
        assert!(
            (found[0].score - 0.880_797).abs() < 1e-5 && (found[1].score - 0.731_059).abs() < 1e-5
        );
    }
}
