const LIGHT: usize = 16;
const CHROMA: usize = 24;
const BINS: usize = LIGHT * CHROMA * CHROMA;
/// Share of a colour that neither side has shown.
const UNSEEN: f32 = 1e-4;
/// Largest odds, natural logarithm.
const MOST: f32 = 3.0;

/// The bin of a Lab colour.
pub(super) fn bin_of([l, a, b]: [f32; 3]) -> u16 {
    let bin = |value: f32, least: f32, range: f32, bins: usize| {
        (((value - least) / range * bins as f32).max(0.0) as usize).min(bins - 1)
    };
    let (l, a, b) = (
        bin(l, 0.0, 100.0, LIGHT),
        bin(a, -80.0, 160.0, CHROMA),
        bin(b, -80.0, 160.0, CHROMA),
    );
    ((l * CHROMA + a) * CHROMA + b) as u16
}

/// How often an object and its surroundings show each colour: smoothed histograms over Lab.
#[derive(Clone)]
pub(super) struct ColorModel {
    object: Vec<f32>,
    around: Vec<f32>,
}

impl ColorModel {
    /// From the pixels' bins; `is_object` and `is_around` tell which pixels count.
    pub fn new(bins: &[u16], is_object: &[bool], is_around: &[bool]) -> Self {
        Self {
            object: histogram(bins, is_object),
            around: histogram(bins, is_around),
        }
    }

    /// Natural logarithm of the odds that each bin's colour is the object's, −3 to 3.
    pub fn odds(&self) -> Vec<f32> {
        let odds = |(&object, &around): (&f32, &f32)| {
            ((object + UNSEEN) / (around + UNSEEN))
                .ln()
                .clamp(-MOST, MOST)
        };
        self.object.iter().zip(&self.around).map(odds).collect()
    }

    /// Moves this share of the way to another model.
    pub fn learn(&mut self, other: &Self, share: f32) {
        let blend = |mine: &mut [f32], other: &[f32]| {
            mine.iter_mut()
                .zip(other)
                .for_each(|(mine, other)| *mine += share * (other - *mine));
        };
        blend(&mut self.object, &other.object);
        blend(&mut self.around, &other.around);
    }

    /// How alike the object's colours are in two models, 0–1 (Bhattacharyya's coefficient).
    pub fn likeness(&self, other: &Self) -> f32 {
        self.object
            .iter()
            .zip(&other.object)
            .map(|(a, b)| (a * b).sqrt())
            .sum::<f32>()
            .min(1.0)
    }
}

/// Shares of the bins, smoothed; all 0 where nothing counts.
fn histogram(bins: &[u16], counts: &[bool]) -> Vec<f32> {
    let mut shares = vec![0.0; BINS];
    let mut total = 0.0f32;
    for (&bin, _) in bins.iter().zip(counts).filter(|(_, counts)| **counts) {
        shares[usize::from(bin)] += 1.0;
        total += 1.0;
    }
    for (step, length) in [(1, CHROMA), (CHROMA, CHROMA), (CHROMA * CHROMA, LIGHT)] {
        smooth(&mut shares, step, length);
    }
    shares.iter_mut().for_each(|share| *share /= total.max(1.0));
    shares
}

/// Weights 1 2 1 along one axis, the ends repeated.
fn smooth(values: &mut [f32], step: usize, length: usize) {
    for first in (0..values.len()).filter(|at| (at / step).is_multiple_of(length)) {
        let mut before = values[first];
        for at in 0..length {
            let place = first + at * step;
            let here = values[place];
            let after = if at + 1 < length {
                values[place + step]
            } else {
                here
            };
            values[place] = (before + 2.0 * here + after) / 4.0;
            before = here;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_the_object_have_good_odds() {
        let (red, blue, green) = (
            bin_of([50.0, 60.0, 40.0]),
            bin_of([30.0, 20.0, -60.0]),
            bin_of([60.0, -50.0, 50.0]),
        );
        let bins = [red, red, blue, blue];
        let model = ColorModel::new(
            &bins,
            &[true, true, false, false],
            &[false, false, true, true],
        );
        let odds = model.odds();
        assert!(odds[usize::from(red)] > 2.0 && odds[usize::from(blue)] < -2.0);
        assert!(odds[usize::from(green)].abs() < 1e-3);
        assert!((model.likeness(&model) - 1.0).abs() < 1e-5);
        assert!((model.object.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    }
}
