use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};

/// Loads values by key on worker threads.
///
/// The latest list of requests replaces the one before, so that keys that are no longer requested
/// are never loaded.
pub struct Loader<K, V> {
    requests: Arc<Requests<K>>,
    done: Mutex<Receiver<(K, V)>>,
}

struct Requests<K> {
    state: Mutex<LoaderState<K>>,
    changed: Condvar,
}

struct LoaderState<K> {
    wanted: Vec<K>,
    running: Vec<K>,
    closed: bool,
}

impl<K: Clone + PartialEq + Send + 'static, V: Send + 'static> Loader<K, V> {
    /// Starts `threads` workers called `name`.
    ///
    /// `notify` is called after each finished load, on the worker's thread.
    #[must_use]
    pub fn new(
        name: &str,
        threads: usize,
        load: impl Fn(&K) -> V + Send + Sync + 'static,
        notify: impl Fn() + Send + Sync + 'static,
    ) -> Self {
        let state = LoaderState {
            wanted: Vec::new(),
            running: Vec::new(),
            closed: false,
        };
        let requests = Arc::new(Requests {
            state: Mutex::new(state),
            changed: Condvar::new(),
        });
        let work = Arc::new((load, notify));
        let (sender, done) = channel();
        for _ in 0..threads.max(1) {
            let (requests, work, sender) =
                (Arc::clone(&requests), Arc::clone(&work), sender.clone());
            // Without a thread, nothing is loaded; the window then shows empty images but keeps
            // working.
            let _ = std::thread::Builder::new()
                .name(name.into())
                .spawn(move || serve(&requests, &work.0, &work.1, &sender));
        }
        Self {
            requests,
            done: Mutex::new(done),
        }
    }

    /// Replaces the list of requests, most urgent first.
    ///
    /// Loads already running continue and are not started twice.
    pub fn want(&self, keys: Vec<K>) {
        let mut state = self.requests.lock();
        state.wanted = keys
            .into_iter()
            .filter(|key| !state.running.contains(key))
            .collect();
        drop(state);
        self.requests.changed.notify_all();
    }

    /// Returns the loads finished since the last call.
    pub fn take_done(&self) -> Vec<(K, V)> {
        self.done
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .try_iter()
            .collect()
    }
}

impl<K, V> Drop for Loader<K, V> {
    fn drop(&mut self) {
        let mut state = self.requests.lock();
        state.closed = true;
        state.wanted.clear();
        drop(state);
        self.requests.changed.notify_all();
    }
}

impl<K> Requests<K> {
    fn lock(&self) -> std::sync::MutexGuard<'_, LoaderState<K>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn serve<K: Clone + PartialEq, V>(
    requests: &Requests<K>,
    load: &impl Fn(&K) -> V,
    notify: &impl Fn(),
    done: &Sender<(K, V)>,
) {
    while let Some(key) = next(requests) {
        let value = load(&key);
        requests.lock().running.retain(|other| *other != key);
        if done.send((key, value)).is_err() {
            return;
        }
        notify();
    }
}

fn next<K: Clone>(requests: &Requests<K>) -> Option<K> {
    let mut state = requests.lock();
    loop {
        if state.closed {
            return None;
        }
        if !state.wanted.is_empty() {
            let key = state.wanted.remove(0);
            state.running.push(key.clone());
            return Some(key);
        }
        state = requests
            .changed
            .wait(state)
            .unwrap_or_else(PoisonError::into_inner);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::sync_channel;
    use std::time::Duration;

    #[test]
    fn newest_requests_win() {
        let (begin, begun) = sync_channel::<u32>(0);
        let (go, gate) = sync_channel::<()>(0);
        let gate = Mutex::new(gate);
        let (reported, notified) = channel();
        let loader = Loader::new(
            "test",
            1,
            move |&key: &u32| {
                begin.send(key).unwrap();
                gate.lock().unwrap().recv().unwrap();
                key * 10
            },
            move || reported.send(()).unwrap(),
        );
        loader.want(vec![1, 2, 3]);
        assert_eq!(begun.recv().unwrap(), 1);
        loader.want(vec![1, 7]);
        go.send(()).unwrap();
        assert_eq!(
            begun.recv().unwrap(),
            7,
            "2 and 3 are no longer wanted, 1 is not begun twice"
        );
        go.send(()).unwrap();
        for _ in 0..2 {
            notified.recv_timeout(Duration::from_secs(5)).unwrap();
        }
        assert_eq!(loader.take_done(), [(1, 10), (7, 70)]);
        assert!(loader.take_done().is_empty());
    }
}
