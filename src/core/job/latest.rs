use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// A slot that passes one value between threads; a newer value replaces one that was not taken.
#[derive(Debug)]
pub struct Latest<T> {
    slot: Mutex<LatestSlot<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct LatestSlot<T> {
    value: Option<T>,
    closed: bool,
}

impl<T> Default for Latest<T> {
    fn default() -> Self {
        Self {
            slot: Mutex::new(LatestSlot {
                value: None,
                closed: false,
            }),
            changed: Condvar::new(),
        }
    }
}

impl<T> Latest<T> {
    /// Stores a value; returns the one that it replaces.
    pub fn put(&self, value: T) -> Option<T> {
        let old = self.lock().value.replace(value);
        self.changed.notify_one();
        old
    }

    /// Takes the value if there is one, without waiting.
    pub fn take(&self) -> Option<T> {
        self.lock().value.take()
    }

    /// Waits for a value and takes it; returns `None` once the slot is closed.
    pub fn wait(&self) -> Option<T> {
        let mut slot = self.lock();
        loop {
            if slot.closed {
                return None;
            }
            if let Some(value) = slot.value.take() {
                return Some(value);
            }
            slot = self
                .changed
                .wait(slot)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Closes the slot and ends all waiting, now and later.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, LatestSlot<T>> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_value_wins() {
        let latest = Latest::default();
        assert_eq!(latest.put(1), None);
        assert_eq!(latest.put(2), Some(1));
        assert_eq!((latest.take(), latest.take()), (Some(2), None));
    }

    #[test]
    fn waiting_ends_with_a_value_or_when_closed() {
        let latest = Latest::default();
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| (latest.wait(), latest.wait()));
            latest.put(3);
            while latest.lock().value.is_some() {
                std::thread::yield_now();
            }
            latest.close();
            assert_eq!(waiting.join().unwrap(), (Some(3), None));
        });
    }
}
