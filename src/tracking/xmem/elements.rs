use std::ops::Range;

/// What is remembered of the cells of pictures: a key that is found by looking alike, and a value for every object.
#[derive(Debug, Clone)]
pub(super) struct Elements {
    /// Parts of a key and of a value.
    pub widths: Widths,
    /// `[elements][key]`.
    pub keys: Vec<f32>,
    /// `[elements]`: how narrowly each is matched, at least 1.
    pub shrinkages: Vec<f32>,
    /// `[elements][key]`: which parts of a key count; empty where that is not remembered.
    pub selections: Vec<f32>,
    /// By object `[elements][value]`.
    pub values: Vec<Vec<f32>>,
    /// `[elements]`: how much was taken of each since it is here, and in how many frames it could be.
    uses: Vec<f32>,
    lives: Vec<f32>,
}

/// Parts of a key and of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Widths {
    pub key: usize,
    pub value: usize,
}

/// What a new element has lived, so that its usage is no division by 0.
const BORN: f32 = 1e-7;

impl Elements {
    /// Nothing, for this number of objects.
    pub fn new(widths: Widths, objects: usize) -> Self {
        let none = Vec::new;
        let values = vec![Vec::new(); objects];
        Self {
            widths,
            keys: none(),
            shrinkages: none(),
            selections: none(),
            values,
            uses: none(),
            lives: none(),
        }
    }

    pub fn len(&self) -> usize {
        self.shrinkages.len()
    }

    pub fn key(&self, element: usize) -> &[f32] {
        row(&self.keys, element, self.widths.key)
    }

    pub fn selection(&self, element: usize) -> &[f32] {
        row(&self.selections, element, self.widths.key)
    }

    /// The same keys with other values, by object `[elements][value]`.
    pub fn with_values(&self, values: Vec<Vec<f32>>) -> Self {
        Self {
            values,
            ..self.clone()
        }
    }

    /// Adds the elements of another, as new ones.
    pub fn add(&mut self, other: &Self) {
        self.keys.extend_from_slice(&other.keys);
        self.shrinkages.extend_from_slice(&other.shrinkages);
        self.selections.extend_from_slice(&other.selections);
        self.values
            .iter_mut()
            .zip(&other.values)
            .for_each(|(own, other)| own.extend_from_slice(other));
        self.uses.resize(self.len(), 0.0);
        self.lives.resize(self.len(), BORN);
    }

    /// Takes out a range, with its usage.
    pub fn take(&mut self, range: Range<usize>) -> Self {
        let Widths { key, value } = self.widths;
        let wide = |width: usize| range.start * width..range.end * width;
        Self {
            widths: self.widths,
            keys: self.keys.drain(wide(key)).collect(),
            shrinkages: self.shrinkages.drain(range.clone()).collect(),
            selections: self.selections.drain(wide(key)).collect(),
            values: self
                .values
                .iter_mut()
                .map(|values| values.drain(wide(value)).collect())
                .collect(),
            uses: self.uses.drain(range.clone()).collect(),
            lives: self.lives.drain(range).collect(),
        }
    }

    /// A frame passed in which any of the elements could be used.
    pub fn live(&mut self) {
        self.lives.iter_mut().for_each(|lives| *lives += 1.0);
    }

    /// So much was taken of an element.
    pub fn use_of(&mut self, element: usize, share: f32) {
        self.uses[element] += share;
    }

    /// How much was taken of each element per frame.
    pub fn usages(&self) -> Vec<f32> {
        self.uses
            .iter()
            .zip(&self.lives)
            .map(|(uses, lives)| uses / lives)
            .collect()
    }

    /// Forgets the least used, and all that are used no more than the last of those, so that at most `most` stay.
    pub fn forget(&mut self, most: usize) {
        let Some(surplus) = self.len().checked_sub(most).filter(|&surplus| surplus > 0) else {
            return;
        };
        let usages = self.usages();
        let mut sorted = usages.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        let stays: Vec<bool> = usages
            .iter()
            .map(|&usage| usage > sorted[surplus - 1])
            .collect();
        let Widths { key, value } = self.widths;
        keep(&mut self.keys, &stays, key);
        keep(&mut self.selections, &stays, key);
        self.values
            .iter_mut()
            .for_each(|values| keep(values, &stays, value));
        [&mut self.shrinkages, &mut self.uses, &mut self.lives]
            .into_iter()
            .for_each(|list| keep(list, &stays, 1));
    }
}

/// One element's part of a list.
pub(super) fn row(list: &[f32], element: usize, width: usize) -> &[f32] {
    &list[element * width..][..width]
}

fn keep(list: &mut Vec<f32>, stays: &[bool], width: usize) {
    let mut at = 0;
    list.retain(|_| {
        at += 1;
        stays[(at - 1) / width]
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Elements whose key, shrinkage and values are their number.
    fn numbered(numbers: Range<usize>) -> Elements {
        let mut elements = Elements::new(Widths { key: 2, value: 3 }, 2);
        let all = |width: usize| {
            numbers
                .clone()
                .flat_map(|at| vec![at as f32; width])
                .collect::<Vec<_>>()
        };
        (elements.keys, elements.shrinkages, elements.values) =
            (all(2), all(1), vec![all(3), all(3)]);
        elements.selections = all(2);
        elements
    }

    #[test]
    fn least_used_are_forgotten_in_all_lists() {
        let mut elements = Elements::new(Widths { key: 2, value: 3 }, 2);
        elements.add(&numbered(0..4));
        elements.live();
        elements.add(&numbered(4..6));
        elements.live();
        for (element, share) in [(0, 0.8), (1, 0.2), (2, 0.8), (3, 0.1), (4, 0.3), (5, 0.5)] {
            elements.use_of(element, share);
        }
        // Per frame: 0.4, 0.1, 0.4, 0.05, 0.3, 0.5.
        elements.forget(3);
        assert_eq!(elements.shrinkages, [0.0, 2.0, 5.0]);
        assert_eq!(elements.keys, [0.0, 0.0, 2.0, 2.0, 5.0, 5.0]);
        assert_eq!(
            elements.values[1],
            [0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 5.0, 5.0, 5.0]
        );
        assert_eq!(elements.usages().len(), 3);
        elements.forget(3);
        assert_eq!(elements.len(), 3, "as many as may stay do");
        elements.forget(2);
        assert_eq!(elements.shrinkages, [5.0], "equals go together");
    }

    #[test]
    fn range_is_taken_out_of_all_lists() {
        let mut elements = Elements::new(Widths { key: 2, value: 3 }, 2);
        elements.add(&numbered(0..5));
        elements.use_of(2, 0.7);
        elements.live();
        let taken = elements.take(1..3);
        assert_eq!(
            (taken.shrinkages.clone(), taken.usages()),
            (vec![1.0, 2.0], vec![0.0, 0.7 / (1.0 + BORN)])
        );
        assert_eq!(elements.keys, [0.0, 0.0, 3.0, 3.0, 4.0, 4.0]);
        assert_eq!(
            elements.values[0],
            [0.0, 0.0, 0.0, 3.0, 3.0, 3.0, 4.0, 4.0, 4.0]
        );
    }
}
