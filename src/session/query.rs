use std::cell::{Cell, RefCell};
use std::sync::Arc;

use crate::Event;
use crate::job_task::JobTask;
use crate::jobs::{JobKind, Jobs};
use ostra_core::job::JobId;

/// The inputs of a background value; the value is computed again when its key changes.
pub(crate) trait QueryKey: Clone + PartialEq + Send + 'static {
    /// Title of the job that computes the value.
    const TITLE: &'static str;

    /// Task by which panels find the job; `None` for work that no panel looks up.
    const TASK: Option<JobTask> = None;

    /// Event when a value has arrived; `None` if the caller polls for it.
    const EVENT: Option<Event> = None;

    /// Returns the kind of the job that computes the value.
    fn kind(&self) -> JobKind {
        JobKind::Background
    }

    /// Returns whether a value of this key is shown until the value of `wanted` has arrived.
    fn serves(&self, _wanted: &Self) -> bool {
        false
    }

    /// Returns whether work on this key is stopped and its value dropped if `wanted` is requested.
    fn is_obsolete(&self, wanted: &Self) -> bool {
        self != wanted && !self.serves(wanted)
    }
}

/// A value that a job computes in the background when it is requested.
///
/// Callers request a key as often as they like; a panel does so for every frame it draws. They get
/// the value of that key, or an earlier one that [serves](QueryKey::serves) until then. If several
/// keys are requested, the newest wins. At most one job works at a time, and it is stopped when its
/// key becomes [obsolete](QueryKey::is_obsolete). A key that failed is not tried again until
/// another one was requested.
pub(crate) struct Query<K, V> {
    /// Newest requested key.
    requested: RefCell<Option<K>>,
    /// Whether its value was missing at the time of the request.
    is_wanted: Cell<bool>,
    known: Option<(K, Arc<V>)>,
    running: Option<QueryJob<K>>,
    failed: Option<K>,
}

struct QueryJob<K> {
    job: JobId,
    key: K,
    is_obsolete: bool,
}

/// A known value.
pub(crate) struct QueryValue<'a, V> {
    pub(crate) value: &'a Arc<V>,
    /// Whether it is the value of the requested key, and not an earlier one that serves.
    pub(crate) is_current: bool,
}

/// A value, and warnings for the user about it.
pub(crate) struct WithWarnings<V> {
    pub(crate) value: V,
    pub(crate) warnings: Vec<String>,
}

impl<V> From<V> for WithWarnings<V> {
    fn from(value: V) -> Self {
        Self {
            value,
            warnings: Vec::new(),
        }
    }
}

impl<K, V> Default for Query<K, V> {
    fn default() -> Self {
        Self {
            requested: RefCell::new(None),
            is_wanted: Cell::new(false),
            known: None,
            running: None,
            failed: None,
        }
    }
}

impl<K: QueryKey, V> Query<K, V> {
    /// Requests the value of a key and returns the known value.
    pub(crate) fn get(&self, key: K) -> Option<QueryValue<'_, V>> {
        let known = self.known(&key);
        self.is_wanted
            .set(known.as_ref().is_none_or(|known| !known.is_current));
        self.requested.replace(Some(key));
        known
    }

    /// Requests the value of a key.
    pub(crate) fn ask(&self, key: K) {
        self.get(key);
    }

    /// Like [`Self::get`], without requesting the value.
    pub(crate) fn known(&self, key: &K) -> Option<QueryValue<'_, V>> {
        let (of, value) = self.known.as_ref()?;
        let is_current = of == key;
        (is_current || of.serves(key)).then_some(QueryValue { value, is_current })
    }

    /// Returns the known value with its key.
    pub(crate) fn latest(&self) -> Option<&(K, Arc<V>)> {
        self.known.as_ref()
    }

    /// Returns the newest requested key.
    pub(crate) fn requested(&self) -> Option<K> {
        self.requested.borrow().clone()
    }

    /// Returns the value of the newest requested key, once it has arrived.
    pub(crate) fn newest(&self) -> Option<&(K, Arc<V>)> {
        let requested = self.requested.borrow();
        self.known
            .as_ref()
            .filter(|(of, _)| requested.as_ref() == Some(of))
    }

    /// Changes the known value in place.
    pub(crate) fn amend(&mut self, change: impl FnOnce(&K, &mut V))
    where
        V: Clone,
    {
        if let Some((key, value)) = &mut self.known {
            change(key, Arc::make_mut(value));
        }
    }

    /// Sets the value of a key, as if it had been requested.
    pub(crate) fn put(&mut self, key: K, value: Arc<V>) {
        self.requested.replace(Some(key.clone()));
        self.is_wanted.set(false);
        self.failed = None;
        self.known = Some((key, value));
    }

    /// Drops the value and the request.
    ///
    /// A running job continues, but its value is dropped.
    pub(crate) fn clear(&mut self) {
        *self = Self {
            running: self.running.take(),
            ..Self::default()
        };
    }

    /// Returns the key for which a job is to be started now; each key is returned once.
    ///
    /// Work that has become obsolete is discarded.
    pub(crate) fn next<S: 'static>(&mut self, jobs: &mut Jobs<S>) -> Option<K> {
        let requested = self.requested.borrow().clone()?;
        if let Some(running) = &mut self.running {
            if jobs.is_working(running.job) {
                if !running.is_obsolete && running.key.is_obsolete(&requested) {
                    running.is_obsolete = true;
                    jobs.discard(running.job);
                }
                return None;
            }
            // A job that succeeded is no longer here, so this one failed or was stopped.
            if !running.is_obsolete {
                self.failed = Some(running.key.clone());
            }
            self.running = None;
        }
        let is_open = self.is_wanted.take() && self.failed.as_ref() != Some(&requested);
        is_open.then_some(requested)
    }

    /// Notes that a job works on a key.
    pub(crate) fn started(&mut self, key: K, job: JobId) {
        self.running = Some(QueryJob {
            job,
            key,
            is_obsolete: false,
        });
    }

    /// Stores the value of a job unless it has become obsolete; returns whether it was stored.
    pub(crate) fn finished(&mut self, job: JobId, value: Arc<V>) -> bool {
        let Some(running) = self.running.take_if(|running| running.job == job) else {
            return false;
        };
        let is_open = (self.requested.borrow().as_ref())
            .is_some_and(|requested| !running.is_obsolete && !running.key.is_obsolete(requested));
        if is_open {
            let is_newest = self.requested.borrow().as_ref() == Some(&running.key);
            self.is_wanted.set(self.is_wanted.get() && !is_newest);
            self.failed = None;
            self.known = Some((running.key, value));
        }
        is_open
    }
}

#[cfg(test)]
mod tests;
