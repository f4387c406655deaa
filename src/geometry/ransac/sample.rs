use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Draws different indices below a count.
pub(super) struct Sampler {
    random: Pcg64Mcg,
    count: usize,
}

impl Sampler {
    pub fn new(seed: u64, count: usize) -> Self {
        Self {
            random: Pcg64Mcg::seed_from_u64(seed),
            count,
        }
    }

    /// Fills `sample` with different indices, each as likely as the others; `sample` may not be longer than the count.
    pub fn uniform(&mut self, sample: &mut [usize]) {
        self.fill(sample, |share| share);
    }

    /// Fills `sample` with different indices, low ones far more often: half of them come from the first eighth.
    pub fn early(&mut self, sample: &mut [usize]) {
        self.fill(sample, |share| share * share * share);
    }

    /// The probability that an index of an early and of a uniform sample is among those given.
    pub fn shares(&self, places: &[u32]) -> [f64; 2] {
        let count = self.count as f64;
        let below = |place: f64| (place / count).cbrt();
        let early = places
            .iter()
            .map(|&place| below(f64::from(place) + 1.0) - below(f64::from(place)))
            .sum();
        [early, places.len() as f64 / count]
    }

    fn fill(&mut self, sample: &mut [usize], place: impl Fn(f64) -> f64) {
        for i in 0..sample.len() {
            sample[i] = loop {
                let share: f64 = self.random.random();
                let drawn = ((place(share) * self.count as f64) as usize).min(self.count - 1);
                if !sample[..i].contains(&drawn) {
                    break drawn;
                }
            };
        }
    }
}
