use std::cell::{Cell, RefCell};
use std::sync::Arc;

use crate::Event;
use crate::job_task::JobTask;
use crate::jobs::{JobKind, Jobs};
use ostra_core::job::JobId;

/// What a background value depends on. The value is made again whenever its key changes.
pub(crate) trait QueryKey: Clone + PartialEq + Send + 'static {
    /// Title of the job that makes the value.
    const TITLE: &'static str;

    /// The task that panels find the job by; `None` for work that nothing looks for.
    const TASK: Option<JobTask> = None;

    /// Reported when a value has arrived; `None` where the caller asks again by itself.
    const EVENT: Option<Event> = None;

    /// Kind of the job that makes the value.
    fn kind(&self) -> JobKind {
        JobKind::Background
    }

    /// Whether a value of this key is shown until the value of `wanted` has arrived.
    fn serves(&self, _wanted: &Self) -> bool {
        false
    }

    /// Whether work on this key is stopped, and its value dropped, once `wanted` is asked for.
    fn is_obsolete(&self, wanted: &Self) -> bool {
        self != wanted && !self.serves(wanted)
    }
}

/// A value that a job makes in the background when it is asked for.
///
/// Callers ask with a key as often as they like (a panel does so for every frame it draws) and get what is known: the value
/// of that key, or an earlier one that [serves](QueryKey::serves) until then. Of several keys the newest wins. At most one
/// job works at a time; it is stopped when its key becomes [obsolete](QueryKey::is_obsolete). A key that failed is not tried
/// again until another one was asked for.
pub(crate) struct Query<K, V> {
    /// The newest key that was asked for.
    asked: RefCell<Option<K>>,
    /// Whether its value was missing then.
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

/// A value that is known.
pub(crate) struct Answer<'a, V> {
    pub(crate) value: &'a Arc<V>,
    /// Whether it is the value of the very key; otherwise an earlier one that serves until then.
    pub(crate) is_current: bool,
}

/// A value, and what the user should know about it.
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
            asked: RefCell::new(None),
            is_wanted: Cell::new(false),
            known: None,
            running: None,
            failed: None,
        }
    }
}

impl<K: QueryKey, V> Query<K, V> {
    /// Asks for the value of a key and returns what is known by now.
    pub(crate) fn get(&self, key: K) -> Option<Answer<'_, V>> {
        let known = self.known(&key);
        self.is_wanted
            .set(known.as_ref().is_none_or(|known| !known.is_current));
        self.asked.replace(Some(key));
        known
    }

    /// Asks for the value of a key.
    pub(crate) fn ask(&self, key: K) {
        self.get(key);
    }

    /// As [`Self::get`], without asking.
    pub(crate) fn known(&self, key: &K) -> Option<Answer<'_, V>> {
        let (of, value) = self.known.as_ref()?;
        let is_current = of == key;
        (is_current || of.serves(key)).then_some(Answer { value, is_current })
    }

    /// What is known, whatever it is of.
    pub(crate) fn latest(&self) -> Option<&(K, Arc<V>)> {
        self.known.as_ref()
    }

    /// The newest key that was asked for.
    pub(crate) fn asked(&self) -> Option<K> {
        self.asked.borrow().clone()
    }

    /// The value of the newest key that was asked for, once it has arrived.
    pub(crate) fn newest(&self) -> Option<&(K, Arc<V>)> {
        let asked = self.asked.borrow();
        self.known
            .as_ref()
            .filter(|(of, _)| asked.as_ref() == Some(of))
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

    /// Sets the value of a key, as if it had been asked for.
    pub(crate) fn put(&mut self, key: K, value: Arc<V>) {
        self.asked.replace(Some(key.clone()));
        self.is_wanted.set(false);
        self.failed = None;
        self.known = Some((key, value));
    }

    /// Drops the value and asks for nothing any more. A job that works goes on, but its value is dropped.
    pub(crate) fn clear(&mut self) {
        *self = Self {
            running: self.running.take(),
            ..Self::default()
        };
    }

    /// The key that a job is to be started for now; each is returned once. Discards work that has become obsolete.
    pub(crate) fn next<S: 'static>(&mut self, jobs: &mut Jobs<S>) -> Option<K> {
        let asked = self.asked.borrow().clone()?;
        if let Some(running) = &mut self.running {
            if jobs.is_working(running.job) {
                if !running.is_obsolete && running.key.is_obsolete(&asked) {
                    running.is_obsolete = true;
                    jobs.discard(running.job);
                }
                return None;
            }
            // A job that succeeded is no longer here: this one failed, or was stopped.
            if !running.is_obsolete {
                self.failed = Some(running.key.clone());
            }
            self.running = None;
        }
        let is_open = self.is_wanted.take() && self.failed.as_ref() != Some(&asked);
        is_open.then_some(asked)
    }

    /// Notes that a job works on a key.
    pub(crate) fn started(&mut self, key: K, job: JobId) {
        self.running = Some(QueryJob {
            job,
            key,
            is_obsolete: false,
        });
    }

    /// Takes the value that a job made, unless that has become obsolete; returns whether it was taken.
    pub(crate) fn finished(&mut self, job: JobId, value: Arc<V>) -> bool {
        let Some(running) = self.running.take_if(|running| running.job == job) else {
            return false;
        };
        let is_open = (self.asked.borrow().as_ref())
            .is_some_and(|asked| !running.is_obsolete && !running.key.is_obsolete(asked));
        if is_open {
            let is_newest = self.asked.borrow().as_ref() == Some(&running.key);
            self.is_wanted.set(self.is_wanted.get() && !is_newest);
            self.failed = None;
            self.known = Some((running.key, value));
        }
        is_open
    }
}

#[cfg(test)]
mod tests;
