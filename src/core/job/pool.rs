use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use super::{Progress, Running};

/// Error: the queue is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the queue is full; try again when some of the work is done")]
pub struct Full;

type Task = Box<dyn FnOnce() + Send>;

/// Named threads that share one bounded queue, first come, first served.
///
/// Dropping the pool discards waiting work and joins its threads once they have finished their
/// current work.
pub struct Pool {
    shared: Arc<SharedQueue>,
    threads: Vec<JoinHandle<()>>,
}

struct SharedQueue {
    queue: Mutex<Queue>,
    changed: Condvar,
    capacity: usize,
}

#[derive(Default)]
struct Queue {
    waiting: VecDeque<Task>,
    closed: bool,
}

impl Pool {
    /// Starts `threads` threads named `name` with a queue of at most `capacity` (both at least 1).
    #[must_use]
    pub fn new(name: &str, threads: usize, capacity: usize) -> Self {
        let queue = Mutex::new(Queue::default());
        let shared = Arc::new(SharedQueue {
            queue,
            changed: Condvar::new(),
            capacity: capacity.max(1),
        });
        let start = |_| {
            let shared = Arc::clone(&shared);
            std::thread::Builder::new()
                .name(name.into())
                .spawn(move || shared.work())
                .ok()
        };
        let threads = (0..threads.max(1)).filter_map(start).collect();
        Self { shared, threads }
    }

    /// Puts work at the end of the queue.
    ///
    /// # Errors
    /// [`Full`] if the queue is full (or no thread could be started).
    pub fn submit<T: Send + 'static>(
        &self,
        progress: Progress,
        work: impl FnOnce(&Progress) -> T + Send + 'static,
    ) -> Result<Running<T>, Full> {
        let (running, task, _) = Running::prepare(progress, work);
        let mut queue = self.shared.lock();
        if queue.waiting.len() >= self.shared.capacity || self.threads.is_empty() {
            return Err(Full);
        }
        queue.waiting.push_back(Box::new(task));
        drop(queue);
        self.shared.changed.notify_one();
        Ok(running)
    }

    /// Discards all work that has not begun; its handles get [`super::JobError::Discarded`].
    pub fn clear(&self) {
        let forgotten = std::mem::take(&mut self.shared.lock().waiting);
        drop(forgotten); // outside the lock: freeing what tasks hold may take time
    }
}

impl std::fmt::Debug for Pool {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pool")
            .field("threads", &self.threads)
            .finish_non_exhaustive()
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.shared.lock().closed = true;
        self.clear();
        self.shared.changed.notify_all();
        let current = std::thread::current().id();
        for thread in self
            .threads
            .drain(..)
            .filter(|thread| thread.thread().id() != current)
        {
            let _ = thread.join();
        }
    }
}

impl SharedQueue {
    fn work(&self) {
        while let Some(task) = self.next() {
            task();
        }
    }

    fn next(&self) -> Option<Task> {
        let mut queue = self.lock();
        loop {
            if queue.closed {
                return None;
            }
            if let Some(task) = queue.waiting.pop_front() {
                return Some(task);
            }
            queue = self
                .changed
                .wait(queue)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, Sender, channel};

    use super::super::JobError;
    use super::*;

    /// Returns a pool of one thread that is busy until the sender is dropped or used.
    fn busy_pool(capacity: usize) -> (Pool, Sender<()>) {
        let pool = Pool::new("test", 1, capacity);
        let ((go, gate), (began, wait)): ((_, Receiver<()>), _) = (channel(), channel());
        let work = move |_: &Progress| {
            began.send(()).unwrap();
            let _ = gate.recv();
        };
        pool.submit(Progress::default(), work).unwrap();
        wait.recv().unwrap();
        (pool, go)
    }

    #[test]
    fn queue_rejects_work_beyond_its_capacity() {
        let (pool, go) = busy_pool(2);
        let first = pool.submit(Progress::default(), |_| 1).unwrap();
        let second = pool.submit(Progress::default(), |_| 2).unwrap();
        assert_eq!(pool.submit(Progress::default(), |_| 3).unwrap_err(), Full);
        drop(go);
        assert_eq!((first.join(), second.join()), (Ok(1), Ok(2)));
    }

    #[test]
    fn cleared_work_is_discarded() {
        let (pool, go) = busy_pool(2);
        let waiting = pool.submit(Progress::default(), |_| 1).unwrap();
        pool.clear();
        drop(go);
        assert_eq!(waiting.join(), Err(JobError::Discarded));
    }

    #[test]
    fn panic_does_not_end_the_thread() {
        let pool = Pool::new("test", 1, 4);
        let broken = pool
            .submit(Progress::default(), |_| panic!("broken"))
            .unwrap();
        let after = pool.submit(Progress::default(), |_| 5).unwrap();
        assert!(matches!(broken.join(), Err(JobError::Panicked { what }) if what == "broken"));
        assert_eq!(after.join(), Ok(5));
    }

    #[test]
    fn dropping_the_pool_ends_its_threads() {
        let (pool, go) = busy_pool(2);
        let waiting = pool.submit(Progress::default(), |_| 1).unwrap();
        drop(go);
        drop(pool);
        assert!(matches!(waiting.join(), Ok(1) | Err(JobError::Discarded)));
    }
}
