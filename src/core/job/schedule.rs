//! Stages of a job: those done, the running one and those to come, with the time that each takes.

use std::time::Duration;

use super::time_left::Smoothed;

/// A stage that a job announces before it begins.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedStage {
    /// Name with which [`Progress::stage`](super::Progress::stage) begins it, e.g. `match`.
    pub name: &'static str,
    /// Step that people see, e.g. `Match images`. Consecutive stages of one step are shown as one.
    pub step: &'static str,
    /// Expected time, in any unit that all stages of the job share; at least 0.
    pub weight: f64,
}

impl PlannedStage {
    /// Creates a stage.
    #[must_use]
    pub fn new(name: &'static str, step: &'static str, weight: f64) -> Self {
        Self { name, step, weight }
    }
}

/// State of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepState {
    /// It has ended.
    Done,
    /// It is running.
    Running,
    /// It has not begun.
    ToCome,
}

/// A step of a job, as people see it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Title, e.g. `Match images`.
    pub title: String,
    /// State.
    pub state: StepState,
}

/// Time that a step of a job took.
#[derive(Debug, Clone, PartialEq)]
pub struct StepTime {
    /// Title, e.g. `Match images`.
    pub title: String,
    /// Time of all stages of this step together; of a running one, the time so far.
    pub took: Duration,
}

/// A first report of a stage within this time counts what was done by an earlier run.
const AT_ONCE: Duration = Duration::from_secs(1);

/// Share of a stage from which its own pace is trusted fully for what is left of it.
const TRUSTED_SHARE: f64 = 0.3;

/// Smallest share of a stage from which a pace is measured.
const MEASURABLE_SHARE: f64 = 0.01;

/// Time before which no time left is given, because the pace of the start says little.
const QUIET: Duration = Duration::from_secs(5);

/// The stages of a job, in order, at times that the caller gives (since the job began).
///
/// The fraction never decreases. Whenever a stage begins or the plan changes, what is left of the bar
/// is divided again among the stages that are left, by their weights.
#[derive(Debug, Default)]
pub(super) struct Schedule {
    stages: Vec<Stage>,
    /// Index of the running stage.
    running: Option<usize>,
    /// Fraction when what is left was last divided.
    base: f64,
    /// Share of the running stage at that time.
    base_share: f64,
    left: Option<Smoothed>,
    /// Whether stages were announced. A job without a plan has a single stage whose name changes.
    is_planned: bool,
}

#[derive(Debug)]
struct Stage {
    name: String,
    step: String,
    weight: f64,
    state: StepState,
    begun: Duration,
    /// Time that it took, once it has ended.
    took: Duration,
    /// Share that an earlier run had done; `None` before the first report.
    given: Option<f64>,
    /// Largest reported share.
    share: f64,
}

impl Stage {
    fn planned(planned: &PlannedStage) -> Self {
        let weight = planned.weight.max(0.0);
        Self::new(planned.name, planned.step.into(), weight)
    }

    fn new(name: &str, step: String, weight: f64) -> Self {
        Self {
            name: name.to_owned(),
            step,
            weight,
            state: StepState::ToCome,
            begun: Duration::ZERO,
            took: Duration::ZERO,
            given: None,
            share: 0.0,
        }
    }

    /// Returns the share done by this run of what an earlier run had left.
    fn own_share(&self) -> f64 {
        let given = self.given.unwrap_or(0.0);
        if given < 1.0 {
            (self.share - given) / (1.0 - given)
        } else {
            1.0
        }
    }

    /// Returns the weight of what an earlier run had left.
    fn own_weight(&self) -> f64 {
        self.weight * (1.0 - self.given.unwrap_or(0.0))
    }
}

impl Schedule {
    /// Replaces the stages to come.
    pub fn plan(&mut self, stages: &[PlannedStage]) {
        self.is_planned = true;
        self.divide_rest();
        self.stages.truncate(self.next());
        self.stages.extend(stages.iter().map(Stage::planned));
    }

    /// Adds stages before those to come.
    pub fn extend(&mut self, stages: &[PlannedStage]) {
        self.is_planned = true;
        self.divide_rest();
        let at = self.next();
        self.stages
            .splice(at..at, stages.iter().map(Stage::planned));
    }

    /// Begins a stage. Planned ones before it are left out; one that is not planned is added.
    ///
    /// The running stage goes on if it is begun again and no other of its name is planned.
    pub fn begin(&mut self, name: &str, now: Duration) {
        if let Some(at) = self.running.filter(|_| !self.is_planned) {
            (self.stages[at].name, self.stages[at].step) = (name.to_owned(), capitalized(name));
            return;
        }
        let is_running = self.running.is_some_and(|at| self.stages[at].name == name);
        let is_planned = |stage: &Stage| stage.name == name;
        if is_running && !self.stages[self.next()..].iter().any(is_planned) {
            return;
        }
        if let Some(at) = self.running {
            self.base = self.fraction_at(1.0);
            let stage = &mut self.stages[at];
            stage.state = StepState::Done;
            stage.took = now.saturating_sub(stage.begun);
        }
        let next = self.next();
        let to_come = &self.stages[next..];
        if let Some(before) = to_come.iter().position(|stage| stage.name == name) {
            self.stages.drain(next..next + before);
        } else {
            // It is expected to take as long as a stage to come does on average.
            let total: f64 = to_come.iter().map(|stage| stage.weight).sum();
            let weight = if to_come.is_empty() {
                1.0
            } else {
                total / to_come.len() as f64
            };
            let added = Stage::new(name, capitalized(name), weight);
            self.stages.insert(next, added);
        }
        let stage = &mut self.stages[next];
        (stage.state, stage.begun) = (StepState::Running, now);
        (self.running, self.base_share) = (Some(next), 0.0);
    }

    /// Reports a share of the running stage; `now` is asked for only when it is needed.
    pub fn report(&mut self, share: f64, now: impl FnOnce() -> Duration) {
        let Some(at) = self.running else {
            return;
        };
        let stage = &mut self.stages[at];
        let share = share.clamp(0.0, 1.0);
        if stage.given.is_none() {
            let is_given = share < 1.0 && now().saturating_sub(stage.begun) < AT_ONCE;
            stage.given = Some(if is_given { share } else { 0.0 });
        }
        stage.share = stage.share.max(share);
    }

    /// Returns how much of the job is done, from 0 to 1; `None` if nothing says so.
    pub fn fraction(&self) -> Option<f64> {
        let stage = &self.stages[self.running?];
        let is_known = stage.given.is_some() || self.stages.len() > 1;
        is_known.then(|| self.fraction_at(stage.own_share()))
    }

    /// Returns the time left at the pace measured so far; `None` before there is a pace.
    pub fn left(&mut self, now: Duration) -> Option<Duration> {
        let measured = self.measured_left(now).filter(|_| now >= QUIET);
        self.left = measured.map(|seconds| match self.left {
            Some(before) => before.updated(seconds, now),
            None => Smoothed::new(seconds, now),
        });
        self.left.map(super::time_left::Smoothed::duration)
    }

    /// Returns the steps that people see.
    pub fn steps(&self) -> Vec<Step> {
        let mut steps: Vec<Step> = Vec::new();
        for stage in &self.stages {
            match steps.last_mut().filter(|step| step.title == stage.step) {
                Some(step) if step.state != stage.state => step.state = StepState::Running,
                Some(_) => {}
                None => steps.push(Step {
                    title: stage.step.clone(),
                    state: stage.state,
                }),
            }
        }
        steps
    }

    /// Returns how many stages have begun.
    pub fn begun(&self) -> usize {
        self.next()
    }

    /// Returns the time that each step took, without the first `left_out` stages.
    ///
    /// Empty without a plan: the name of its only stage changes, so its time belongs to no step.
    pub fn step_times(&self, left_out: usize, now: Duration) -> Vec<StepTime> {
        let mut times: Vec<StepTime> = Vec::new();
        let begun = self.stages[..self.next()].iter().skip(left_out);
        for stage in begun.filter(|_| self.is_planned) {
            let took = match stage.state {
                StepState::Done => stage.took,
                StepState::Running => now.saturating_sub(stage.begun),
                StepState::ToCome => continue,
            };
            match times.iter_mut().find(|time| time.title == stage.step) {
                Some(time) => time.took += took,
                None => times.push(StepTime {
                    title: stage.step.clone(),
                    took,
                }),
            }
        }
        times
    }

    /// Returns the index of the first stage to come.
    fn next(&self) -> usize {
        self.running.map_or(0, |at| at + 1)
    }

    /// Keeps the present fraction when the stages to come change.
    fn divide_rest(&mut self) {
        if let Some(at) = self.running {
            let share = self.stages[at].own_share();
            (self.base, self.base_share) = (self.fraction_at(share), share);
        }
    }

    fn weight_to_come(&self) -> f64 {
        self.stages[self.next()..]
            .iter()
            .map(|stage| stage.weight)
            .sum()
    }

    /// Returns the fraction at a share of the running stage.
    fn fraction_at(&self, share: f64) -> f64 {
        let Some(at) = self.running else {
            return self.base;
        };
        let weight = self.stages[at].weight;
        let rest = weight * (1.0 - self.base_share) + self.weight_to_come();
        if rest <= 0.0 {
            return self.base;
        }
        let done = weight * (share - self.base_share) / rest;
        (self.base + (1.0 - self.base) * done).min(1.0)
    }

    /// Returns the seconds left at the pace measured so far.
    fn measured_left(&self, now: Duration) -> Option<f64> {
        let stage = &self.stages[self.running?];
        let took = now.saturating_sub(stage.begun).as_secs_f64();
        let (share, weight) = (stage.own_share(), stage.own_weight());
        let pace = self.pace(took);
        let own = (share >= MEASURABLE_SHARE).then(|| took / share * (1.0 - share));
        let expected = pace.map(|pace| (pace * weight - took).max(0.0));
        let running = match (own, expected) {
            (Some(own), Some(expected)) => {
                let trust = (share / TRUSTED_SHARE).min(1.0);
                own * trust + expected * (1.0 - trust)
            }
            (own, expected) => own.or(expected)?,
        };
        let to_come = self.weight_to_come();
        if to_come > 0.0 {
            Some(running + pace? * to_come)
        } else {
            Some(running)
        }
    }

    /// Returns the seconds that a unit of weight takes.
    ///
    /// Stages count by the time that they took. A stage whose result was kept from earlier took next
    /// to none, and so does not make the others look fast.
    fn pace(&self, took: f64) -> Option<f64> {
        let (mut sum, mut total) = (0.0, 0.0);
        for (at, stage) in self.stages[..self.next()].iter().enumerate() {
            let is_running = self.running == Some(at);
            let (seconds, weight) = match is_running {
                true => (took, stage.own_weight() * stage.own_share()),
                false => (stage.took.as_secs_f64(), stage.own_weight()),
            };
            let is_measured = !is_running || stage.own_share() >= MEASURABLE_SHARE;
            if is_measured && weight > 0.0 && seconds > 0.0 {
                sum += seconds * (seconds / weight);
                total += seconds;
            }
        }
        (total > 0.0).then(|| sum / total)
    }
}

fn capitalized(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

#[cfg(test)]
mod tests;
