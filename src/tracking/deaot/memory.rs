use ostra_compute::nn::{NnError, Tensor};

/// Key, value and identity.
pub(super) const PARTS: usize = 3;

/// What is kept of one picture: for every layer key, value and identity, each `[cells, channels]`.
#[derive(Debug)]
pub(super) struct Memory {
    pub layers: Vec<[Tensor; PARTS]>,
}

/// What is kept of several pictures, with at most so many.
#[derive(Debug)]
pub(super) struct LongMemory {
    /// As of one picture, all pictures' cells one after the other.
    pub memory: Memory,
    /// For each picture whether its mask was given.
    is_given: Vec<bool>,
    most: usize,
}

impl LongMemory {
    /// Of a first picture, whose mask was given.
    pub fn new(first: &Memory, most: usize) -> Self {
        Self {
            memory: Memory {
                layers: first.layers.clone(),
            },
            is_given: vec![true],
            most: most.max(1),
        }
    }

    /// One picture more. Where that is too many, the oldest goes whose mask was not given; where all were given, the
    /// oldest after the first.
    pub fn push(&mut self, picture: &Memory, is_given: bool) -> Result<(), NnError> {
        let count = self.is_given.len();
        let is_full = count >= self.most;
        if is_full && self.most == 1 {
            if is_given {
                *self = Self::new(picture, self.most);
            }
            return Ok(());
        }
        let gone = is_full.then(|| {
            self.is_given
                .iter()
                .position(|is_given| !is_given)
                .unwrap_or(1)
        });
        let all = self.memory.layers.iter_mut().zip(&picture.layers);
        for (kept, new) in all.flat_map(|(kept, new)| kept.iter_mut().zip(new)) {
            *kept = joined(kept, new, gone)?;
        }
        gone.map(|gone| self.is_given.remove(gone));
        self.is_given.push(is_given);
        Ok(())
    }
}

/// The cells of several pictures without those of picture `gone`, then those of one more.
fn joined(kept: &Tensor, new: &Tensor, gone: Option<usize>) -> Result<Tensor, NnError> {
    let (values, size) = (kept.as_floats(), new.as_floats().len());
    let (before, after) = gone.map_or((values, &[][..]), |at| {
        (&values[..at * size], &values[(at + 1) * size..])
    });
    let values = [before, after, new.as_floats()].concat();
    let channels = *new.shape().last().unwrap_or(&1);
    Tensor::floats(&[values.len() / channels, channels], values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(value: f32) -> Memory {
        let part = || Tensor::floats(&[2, 1], vec![value, value + 0.5]).unwrap();
        Memory {
            layers: vec![std::array::from_fn(|_| part())],
        }
    }

    fn kept(long: &LongMemory) -> Vec<f32> {
        let [key, _, identity] = &long.memory.layers[0];
        assert_eq!(key, identity);
        assert_eq!(key.shape(), [key.as_floats().len(), 1]);
        key.as_floats().iter().step_by(2).copied().collect()
    }

    #[test]
    fn pictures_given_stay_and_the_oldest_others_go() {
        let mut long = LongMemory::new(&of(0.0), 4);
        for at in 1..6 {
            long.push(&of(at as f32), at == 2).unwrap();
        }
        assert_eq!(kept(&long), [0.0, 2.0, 4.0, 5.0]);
        for at in 6..9 {
            long.push(&of(at as f32), true).unwrap();
        }
        assert_eq!(
            kept(&long),
            [0.0, 6.0, 7.0, 8.0],
            "the first and the latest"
        );
    }

    #[test]
    fn memory_of_one_keeps_what_was_given_last() {
        let mut long = LongMemory::new(&of(0.0), 1);
        long.push(&of(1.0), false).unwrap();
        assert_eq!(kept(&long), [0.0]);
        long.push(&of(2.0), true).unwrap();
        assert_eq!(kept(&long), [2.0]);
    }
}
