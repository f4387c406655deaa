use std::sync::{Mutex, OnceLock, PoisonError};

use ostra_core::job::{Pool, Progress};

/// Most tasks of one request that are taken.
const CAPACITY: usize = 4096;

/// Work done ahead of need, in which the newest request wins: what an earlier one left undone is forgotten.
#[derive(Debug)]
pub(super) struct Background {
    name: &'static str,
    threads: usize,
    pool: OnceLock<Pool>,
    current: Mutex<Progress>,
}

impl Background {
    /// Up to `threads` threads named `name`, started when first needed.
    pub fn new(name: &'static str, threads: usize) -> Self {
        Self {
            name,
            threads,
            pool: OnceLock::new(),
            current: Mutex::default(),
        }
    }

    /// Drops what waits, stops what runs at its next step, and puts these tasks in the queue.
    pub fn replace<F: FnOnce(&Progress) + Send + 'static>(
        &self,
        tasks: impl IntoIterator<Item = F>,
    ) {
        let pool = self
            .pool
            .get_or_init(|| Pool::new(self.name, self.threads, CAPACITY));
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        current.stop();
        *current = Progress::default();
        pool.clear();
        for task in tasks {
            if pool.submit(current.clone(), task).is_err() {
                return;
            }
        }
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.current
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .stop();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn the_newest_request_wins() {
        let background = Background::new("test", 1);
        let (sender, done) = channel();
        let (began, wait) = channel();
        background.replace((0..50).map(|k| {
            let (sender, began) = (sender.clone(), began.clone());
            move |progress: &Progress| {
                let _ = began.send(());
                while progress.check().is_ok() {
                    std::thread::yield_now();
                }
                let _ = sender.send(k);
            }
        }));
        wait.recv().unwrap();
        let last = sender.clone();
        background.replace([move |_: &Progress| last.send(100).unwrap()]);
        drop((sender, began));
        assert_eq!(done.iter().take(2).collect::<Vec<_>>(), [0, 100]);
    }
}
