use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use anyhow::{Result, bail};

use super::*;
use crate::jobs::Completion;

/// A key; those with the same `group` serve each other.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key {
    group: u32,
    number: u32,
}

impl QueryKey for Key {
    const TITLE: &'static str = "Make a value";

    fn serves(&self, wanted: &Self) -> bool {
        self.group == wanted.group
    }
}

const fn key(group: u32, number: u32) -> Key {
    Key { group, number }
}

/// A query whose jobs end when the test says so.
#[derive(Default)]
struct Bench {
    query: Query<Key, u32>,
    jobs: Jobs<Query<Key, u32>>,
    /// Ends the running job, with a value if true is sent and with a failure otherwise.
    end: Option<Sender<bool>>,
}

impl Bench {
    fn ask(&self, key: Key) -> Option<(u32, bool)> {
        self.query
            .get(key)
            .map(|answer| (**answer.value, answer.is_current))
    }

    /// Starts the job that is due and returns its key.
    fn start(&mut self) -> Option<Key> {
        self.jobs.note_ended();
        while let Some((_, result)) = self.jobs.take_ended() {
            if let Ok(completion) = result {
                completion(&mut self.query).unwrap();
            }
        }
        let key = self.query.next(&mut self.jobs)?;
        let (end, ended) = channel();
        self.end = Some(end);
        let job = self.jobs.start(Key::TITLE, key.kind(), move |context| {
            loop {
                context.progress.check()?;
                match ended.recv_timeout(Duration::from_millis(1)) {
                    Ok(true) => break,
                    Ok(false) => bail!("no value"),
                    Err(_) => {}
                }
            }
            let id = context.id();
            let done = move |query: &mut Query<Key, u32>| -> Result<()> {
                query.finished(id, Arc::new(key.number));
                Ok(())
            };
            Ok(Box::new(done) as Completion<_>)
        });
        self.query.started(key, job);
        Some(key)
    }

    fn wait(&mut self) {
        while self.jobs.iter().any(|job| !job.has_ended()) {
            self.jobs.wait(Duration::from_millis(20));
            self.jobs.note_ended();
        }
    }

    /// Ends the running job and returns the key of the next one.
    fn end(&mut self, succeeds: bool) -> Option<Key> {
        self.end.take().unwrap().send(succeeds).unwrap();
        self.wait();
        self.start()
    }
}

#[test]
fn value_is_computed_once_and_an_earlier_one_serves_until_then() {
    let mut bench = Bench::default();
    assert_eq!(bench.start(), None, "nothing was asked for");
    assert_eq!(bench.ask(key(0, 1)), None);
    assert_eq!(bench.start(), Some(key(0, 1)));
    assert_eq!(bench.ask(key(0, 1)), None);
    assert_eq!(bench.start(), None, "it is being made");
    assert_eq!(bench.end(true), None);
    assert_eq!(bench.ask(key(0, 1)), Some((1, true)));
    assert_eq!(bench.start(), None);
    assert_eq!(bench.ask(key(0, 2)), Some((1, false)), "it serves");
    assert_eq!(bench.start(), Some(key(0, 2)));
    assert_eq!(bench.end(true), None);
    assert_eq!(bench.ask(key(0, 2)), Some((2, true)));
    assert_eq!(bench.ask(key(1, 2)), None, "of another group");
    assert_eq!(bench.query.latest().unwrap().0, key(0, 2));
}

#[test]
fn newest_of_several_keys_is_next_and_only_one_job_runs_at_a_time() {
    let mut bench = Bench::default();
    bench.ask(key(0, 1));
    assert_eq!(bench.start(), Some(key(0, 1)));
    for number in 2..5 {
        bench.ask(key(0, number));
        assert_eq!(bench.start(), None, "the first one serves, and goes on");
    }
    assert_eq!(bench.end(true), Some(key(0, 4)));
    assert_eq!(bench.ask(key(0, 4)), Some((1, false)));
    assert_eq!(bench.end(true), None);
    assert_eq!(bench.ask(key(0, 4)), Some((4, true)));
}

#[test]
fn obsolete_work_is_stopped_and_can_be_requested_again() {
    let mut bench = Bench::default();
    bench.ask(key(0, 1));
    assert_eq!(bench.start(), Some(key(0, 1)));
    bench.ask(key(1, 1));
    assert_eq!(bench.start(), None, "the first one is stopping");
    bench.ask(key(0, 1));
    bench.wait();
    assert_eq!(bench.start(), Some(key(0, 1)), "that was no failure");
    assert_eq!(bench.end(true), None);
    assert_eq!(bench.ask(key(0, 1)), Some((1, true)));
}

#[test]
fn failed_key_is_not_retried_until_another_was_requested() {
    let mut bench = Bench::default();
    bench.ask(key(0, 1));
    assert_eq!(bench.start(), Some(key(0, 1)));
    assert_eq!(bench.end(false), None);
    bench.ask(key(0, 1));
    assert_eq!(bench.start(), None, "it failed");
    bench.ask(key(0, 2));
    assert_eq!(bench.start(), Some(key(0, 2)));
    assert_eq!(bench.end(true), None);
    bench.ask(key(0, 1));
    assert_eq!(bench.start(), Some(key(0, 1)));
}

#[test]
fn value_that_was_put_wins_over_one_in_progress() {
    let mut bench = Bench::default();
    bench.ask(key(0, 1));
    assert_eq!(bench.start(), Some(key(0, 1)));
    bench.query.put(key(1, 7), Arc::new(7));
    assert_eq!(bench.end(true), None);
    assert_eq!(bench.ask(key(1, 7)), Some((7, true)));
    assert_eq!(bench.query.newest().unwrap().0, key(1, 7));
}

#[test]
fn cleared_query_ignores_earlier_requests() {
    let mut bench = Bench::default();
    bench.ask(key(0, 1));
    assert_eq!(bench.start(), Some(key(0, 1)));
    bench.query.clear();
    assert_eq!(bench.end(true), None);
    assert!(bench.query.latest().is_none() && bench.query.requested().is_none());
    assert_eq!(bench.ask(key(0, 1)), None);
}
