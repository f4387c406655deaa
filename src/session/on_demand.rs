use std::cell::Cell;
use std::sync::Arc;

/// Something of the project that a job loads when it is first asked for; the key tells which one it is.
pub(super) struct OnDemand<K, T> {
    loaded: Option<(K, Arc<T>)>,
    /// What somebody asked for since the last load was begun.
    wanted: Cell<Option<K>>,
    /// What is being loaded or could not be.
    tried: Option<K>,
}

impl<K: Copy + PartialEq, T> OnDemand<K, T> {
    /// What was loaded under this key; `None` leaves word that it is wanted.
    pub(super) fn get(&self, key: K) -> Option<&Arc<T>> {
        self.get_or(key, |_| false)
    }

    /// As [`Self::get`]; what was loaded under a key that `serves` stands until it is there.
    pub(super) fn get_or(&self, key: K, serves: impl Fn(K) -> bool) -> Option<&Arc<T>> {
        let (of, value) = self
            .loaded
            .as_ref()
            .map_or((None, None), |(of, value)| (Some(*of), Some(value)));
        if of != Some(key) {
            self.wanted.set(Some(key));
        }
        value.filter(|_| of.is_some_and(|of| of == key || serves(of)))
    }

    /// What is to be loaded now, told once.
    pub(super) fn next_wanted(&mut self) -> Option<K> {
        let wanted = self.wanted.take().filter(|&key| self.tried != Some(key))?;
        self.tried = Some(wanted);
        Some(wanted)
    }

    pub(super) fn put(&mut self, key: K, value: Arc<T>) {
        self.loaded = Some((key, value));
        self.tried = None;
    }
}

impl<K, T> Default for OnDemand<K, T> {
    fn default() -> Self {
        Self {
            loaded: None,
            wanted: Cell::new(None),
            tried: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thing_is_loaded_once_and_one_that_cannot_be_is_not_tried_for_ever() {
        let mut slot: OnDemand<u64, &str> = OnDemand::default();
        assert!(slot.get(1).is_none());
        assert_eq!(slot.next_wanted(), Some(1));
        assert!(slot.get(1).is_none());
        assert_eq!(slot.next_wanted(), None, "it is on its way");
        slot.put(1, Arc::new("one"));
        assert_eq!(slot.get(1).map(|value| **value), Some("one"));
        assert_eq!(slot.next_wanted(), None);
        assert!(slot.get(2).is_none());
        assert_eq!(slot.next_wanted(), Some(2), "another one");
        assert!(slot.get(1).is_some(), "the first stays until then");
    }
}
