//! A cache limited in bytes.

use std::hash::Hash;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use rustc_hash::FxHashMap;

/// A value that can report its memory use.
pub trait Weigh {
    /// Returns the memory used, in bytes.
    fn bytes(&self) -> usize;
}

impl<T: Weigh> Weigh for Arc<T> {
    fn bytes(&self) -> usize {
        T::bytes(self)
    }
}

/// A cache of values by key that evicts the least recently used ones beyond a budget of bytes.
///
/// Can be shared by threads: values are loaded outside the lock, and never twice at once for the
/// same key.
#[derive(Debug)]
pub struct Cache<K, V> {
    state: Mutex<CacheState<K, V>>,
    changed: Condvar,
    budget_bytes: usize,
}

#[derive(Debug)]
struct CacheState<K, V> {
    entries: FxHashMap<K, CacheEntry<V>>,
    bytes: usize,
    clock: u64,
}

#[derive(Debug)]
enum CacheEntry<V> {
    Loading,
    Ready { value: V, used: u64 },
}

impl<K: Hash + Eq + Clone, V: Weigh + Clone> Cache<K, V> {
    /// Creates an empty cache of at most `budget_bytes`.
    #[must_use]
    pub fn new(budget_bytes: usize) -> Self {
        let state = CacheState {
            entries: FxHashMap::default(),
            bytes: 0,
            clock: 0,
        };
        Self {
            state: Mutex::new(state),
            changed: Condvar::new(),
            budget_bytes,
        }
    }

    /// Returns the value of `key`, loading it with `load` if it is missing.
    ///
    /// Waits if another thread is loading it.
    ///
    /// # Errors
    /// Returns the error of `load`.
    pub fn get<E>(&self, key: &K, load: impl FnOnce() -> Result<V, E>) -> Result<V, E> {
        if let Some(value) = self.found_or_claimed(key) {
            return Ok(value);
        }
        let claim = LoadingClaim { cache: self, key };
        let value = load()?;
        claim.fulfil(value.clone());
        Ok(value)
    }

    /// Returns the value of `key` if it is cached.
    pub fn peek(&self, key: &K) -> Option<V> {
        self.lock().touch(key)
    }

    /// Removes the value of `key` if it is cached.
    pub fn remove(&self, key: &K) {
        let mut state = self.lock();
        if matches!(state.entries.get(key), Some(CacheEntry::Ready { .. })) {
            state.remove(key);
        }
    }

    /// Returns the number of bytes cached; never above the budget.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.lock().bytes
    }

    fn found_or_claimed(&self, key: &K) -> Option<V> {
        let mut state = self.lock();
        loop {
            if let Some(value) = state.touch(key) {
                return Some(value);
            }
            if !state.entries.contains_key(key) {
                state.entries.insert(key.clone(), CacheEntry::Loading);
                return None;
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn lock(&self) -> MutexGuard<'_, CacheState<K, V>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<K: Hash + Eq + Clone, V: Weigh + Clone> CacheState<K, V> {
    fn touch(&mut self, key: &K) -> Option<V> {
        self.clock += 1;
        let now = self.clock;
        match self.entries.get_mut(key)? {
            CacheEntry::Ready { value, used } => {
                *used = now;
                Some(value.clone())
            }
            CacheEntry::Loading => None,
        }
    }

    /// Stores a value after evicting old ones.
    ///
    /// A value larger than the whole budget is not stored.
    fn keep(&mut self, key: &K, value: V, budget_bytes: usize) {
        let bytes = value.bytes();
        if bytes > budget_bytes {
            return;
        }
        while self.bytes + bytes > budget_bytes {
            self.drop_oldest();
        }
        self.clock += 1;
        self.bytes += bytes;
        self.entries.insert(
            key.clone(),
            CacheEntry::Ready {
                value,
                used: self.clock,
            },
        );
    }

    fn drop_oldest(&mut self) {
        let age = |entry: &CacheEntry<V>| match entry {
            CacheEntry::Ready { used, .. } => Some(*used),
            CacheEntry::Loading => None,
        };
        let oldest = self
            .entries
            .iter()
            .filter_map(|(key, entry)| Some((age(entry)?, key)))
            .min_by_key(|(used, _)| *used);
        if let Some(key) = oldest.map(|(_, key)| key.clone()) {
            self.remove(&key);
        }
    }

    fn remove(&mut self, key: &K) {
        if let Some(CacheEntry::Ready { value, .. }) = self.entries.remove(key) {
            self.bytes -= value.bytes();
        }
    }
}

/// Exclusive right of one thread to load `key`; released if loading fails or panics.
struct LoadingClaim<'a, K: Hash + Eq + Clone, V: Weigh + Clone> {
    cache: &'a Cache<K, V>,
    key: &'a K,
}

impl<K: Hash + Eq + Clone, V: Weigh + Clone> LoadingClaim<'_, K, V> {
    fn fulfil(self, value: V) {
        self.cache
            .lock()
            .keep(self.key, value, self.cache.budget_bytes);
    }
}

impl<K: Hash + Eq + Clone, V: Weigh + Clone> Drop for LoadingClaim<'_, K, V> {
    fn drop(&mut self) {
        let mut state = self.cache.lock();
        if matches!(state.entries.get(self.key), Some(CacheEntry::Loading)) {
            state.entries.remove(self.key);
        }
        drop(state);
        self.cache.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[derive(Debug, Clone, PartialEq)]
    struct Block(usize);

    impl Weigh for Block {
        fn bytes(&self) -> usize {
            self.0
        }
    }

    fn fill(cache: &Cache<u32, Block>, key: u32, bytes: usize) {
        cache
            .get(&key, || Ok::<_, Infallible>(Block(bytes)))
            .unwrap();
    }

    #[test]
    fn least_recently_used_value_is_evicted_within_the_budget() {
        let cache = Cache::new(100);
        for key in 0..3 {
            fill(&cache, key, 40);
            assert!(cache.bytes() <= 100);
        }
        assert!(cache.peek(&0).is_none());
        assert!(cache.peek(&1).is_some());
        fill(&cache, 3, 40);
        assert!(cache.peek(&2).is_none(), "1 was used later than 2");
        fill(&cache, 4, 101);
        assert!(cache.peek(&4).is_none() && cache.peek(&3).is_some());
    }

    #[test]
    fn removed_value_is_loaded_again() {
        let cache = Cache::new(100);
        fill(&cache, 1, 40);
        fill(&cache, 2, 40);
        cache.remove(&1);
        cache.remove(&3);
        assert_eq!((cache.bytes(), cache.peek(&1)), (40, None));
        fill(&cache, 1, 50);
        assert_eq!((cache.bytes(), cache.peek(&1)), (90, Some(Block(50))));
    }

    #[test]
    fn concurrent_requests_load_a_value_once() {
        let (cache, made, start) = (Cache::new(100), AtomicUsize::new(0), Barrier::new(4));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    start.wait();
                    let load = || {
                        made.fetch_add(1, Ordering::SeqCst);
                        Ok::<_, Infallible>(Block(10))
                    };
                    assert_eq!(cache.get(&7, load).unwrap(), Block(10));
                });
            }
        });
        assert_eq!(made.load(Ordering::SeqCst), 1);
    }

    #[test]
    fn failed_or_panicked_load_releases_the_key() {
        let cache = Cache::<u32, Block>::new(100);
        assert!(cache.get(&1, || Err("damaged")).is_err());
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _ = cache.get(&1, || -> Result<Block, Infallible> {
                panic!("broken decoder")
            });
        }));
        assert!(panicked.is_err());
        fill(&cache, 1, 10);
        assert_eq!(cache.bytes(), 10);
    }
}
