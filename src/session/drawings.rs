use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ostra_core::job::Loader;

/// Things that are drawn on a worker thread for those who look: asked for again and again, never waited for. The latest
/// few are kept; a newer request takes the place of one that was not begun.
pub struct Drawings<K, V> {
    loader: Loader<K, V>,
    kept: Mutex<VecDeque<(K, V)>>,
}

/// Drawings kept.
const KEPT: usize = 4;

impl<K: Clone + PartialEq + Send + 'static, V: Clone + Send + 'static> Drawings<K, V> {
    /// `draw` makes a drawing; `notify` is called, on the worker's thread, when one is there.
    #[must_use]
    pub fn new(
        draw: impl Fn(&K) -> V + Send + Sync + 'static,
        notify: impl Fn() + Send + Sync + 'static,
    ) -> Self {
        Self {
            loader: Loader::new("drawings", 1, draw, notify),
            kept: Mutex::default(),
        }
    }

    /// The drawing as soon as it is there; asks for it.
    #[must_use]
    pub fn get(&self, key: &K) -> Option<V> {
        let mut kept = self.lock();
        kept.extend(self.loader.take_done());
        let surplus = kept.len().saturating_sub(KEPT);
        kept.drain(..surplus);
        let drawn = kept
            .iter()
            .find(|(other, _)| other == key)
            .map(|(_, drawn)| drawn.clone());
        if drawn.is_none() {
            self.loader.want(vec![key.clone()]);
        }
        drawn
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<(K, V)>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;

    #[test]
    fn what_was_asked_for_comes_and_the_oldest_goes() {
        let (told, notified) = channel();
        let drawings = Drawings::new(|key: &usize| 10 * key, move || told.send(()).unwrap());
        for key in 0..6 {
            assert_eq!(drawings.get(&key), None);
            notified.recv_timeout(Duration::from_secs(60)).unwrap();
            assert_eq!(drawings.get(&key), Some(10 * key));
        }
        assert_eq!((drawings.get(&2), drawings.get(&1)), (Some(20), None));
    }
}
