use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ostra_core::job::Loader;

/// Values that are drawn on a worker thread and polled without waiting.
///
/// The latest few drawings are kept. A newer request replaces one that has not started.
pub struct Drawings<K, V> {
    loader: Loader<K, V>,
    kept: Mutex<VecDeque<(K, V)>>,
}

/// Number of drawings kept.
const KEPT: usize = 4;

impl<K: Clone + PartialEq + Send + 'static, V: Clone + Send + 'static> Drawings<K, V> {
    /// Creates the worker.
    ///
    /// `draw` makes a drawing. `notify` is called on the worker's thread when a drawing is ready.
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

    /// Returns the drawing if it is ready, and requests it otherwise.
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
    fn requested_drawings_arrive_and_the_oldest_is_dropped() {
        let (reported, notified) = channel();
        let drawings = Drawings::new(|key: &usize| 10 * key, move || reported.send(()).unwrap());
        for key in 0..6 {
            assert_eq!(drawings.get(&key), None);
            notified.recv_timeout(Duration::from_secs(60)).unwrap();
            assert_eq!(drawings.get(&key), Some(10 * key));
        }
        assert_eq!((drawings.get(&2), drawings.get(&1)), (Some(20), None));
    }
}
