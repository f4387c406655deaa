use super::memory::{LongMemory, Memory};
use super::network::{Features, OBJECTS, Running, Seen, told};
use super::options::DeaotOptions;
use ostra_compute::nn::Tensor;
use ostra_masks::MaskError;

/// What is remembered of up to ten objects that are told apart in one run.
#[derive(Debug)]
pub(super) struct Group {
    /// Number of its first object; 0 is nothing.
    first: usize,
    long: LongMemory,
    short: Memory,
    /// Pictures since one was remembered for long.
    since: usize,
}

impl Group {
    /// Of group `at`, from 0, and a picture in which its objects are given; `numbers` row by row at the network's size
    /// of `shown` (columns, rows).
    pub fn new(
        networks: Running<'_>,
        at: usize,
        picture: (&Features, &[usize], (usize, usize)),
        options: &DeaotOptions,
    ) -> Result<Self, MaskError> {
        let first = at * OBJECTS + 1;
        let (features, numbers, shown) = picture;
        let short = networks.remember(features, &one_hot(numbers, first, shown)?)?;
        Ok(Self {
            first,
            long: LongMemory::new(&short, options.most_remembered),
            short,
            since: 0,
        })
    }

    /// A further picture in which the objects are given.
    pub fn remember(
        &mut self,
        networks: Running<'_>,
        (features, numbers, shown): (&Features, &[usize], (usize, usize)),
    ) -> Result<(), MaskError> {
        self.short = networks.remember(features, &one_hot(numbers, self.first, shown)?)?;
        self.long.push(&self.short, true).map_err(told)?;
        self.since = 0;
        Ok(())
    }

    /// The objects in the next picture.
    pub fn propagate(
        &mut self,
        networks: Running<'_>,
        features: &Features,
    ) -> Result<Seen, MaskError> {
        self.since += 1;
        networks.propagate(features, &self.long.memory, &self.short)
    }

    /// Keeps of that picture what the next one needs, now that its mask is known.
    pub fn keep(
        &mut self,
        networks: Running<'_>,
        seen: Seen,
        (numbers, shown): (&[usize], (usize, usize)),
        options: &DeaotOptions,
    ) -> Result<(), MaskError> {
        self.short = networks.identify(seen, &one_hot(numbers, self.first, shown)?)?;
        if self.since >= options.remembered_every {
            self.long.push(&self.short, false).map_err(told)?;
            self.since = 0;
        }
        Ok(())
    }
}

/// `[1, 11, rows, columns]`: one where a channel's object is; what is not of this group is nothing.
fn one_hot(
    numbers: &[usize],
    first: usize,
    (columns, rows): (usize, usize),
) -> Result<Tensor, MaskError> {
    let mut planes = vec![0.0; (OBJECTS + 1) * numbers.len()];
    for (at, &number) in numbers.iter().enumerate() {
        let channel = (number + 1)
            .checked_sub(first)
            .filter(|channel| *channel <= OBJECTS)
            .unwrap_or(0);
        planes[channel * numbers.len() + at] = 1.0;
    }
    Tensor::floats(&[1, OBJECTS + 1, rows, columns], planes).map_err(told)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_of_other_groups_are_nothing() {
        let mask = one_hot(&[0, 1, 10, 11, 12, 20, 21], 11, (7, 1)).unwrap();
        let channel = |at: usize| {
            (0..=OBJECTS)
                .filter(|channel| mask.as_floats()[channel * 7 + at] > 0.0)
                .collect::<Vec<_>>()
        };
        let channels: Vec<Vec<usize>> = (0..7).map(channel).collect();
        assert_eq!(channels, [[0], [0], [0], [1], [2], [10], [0]]);
    }
}
