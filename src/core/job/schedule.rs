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
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn planned(name: &'static str, weight: f64) -> PlannedStage {
        PlannedStage::new(name, name, weight)
    }

    /// Runs a stage in `steps` equal steps of a second, and returns the fractions on the way.
    fn run(schedule: &mut Schedule, name: &str, steps: usize, now: &mut Duration) -> Vec<f64> {
        schedule.begin(name, *now);
        let mut fractions = Vec::new();
        for done in 0..=steps {
            schedule.report(done as f64 / steps as f64, || *now);
            fractions.push(schedule.fraction().unwrap());
            *now += SECOND;
        }
        fractions
    }

    fn assert_ascending(fractions: &[f64]) {
        assert!(
            fractions.is_sorted() && fractions.iter().all(|share| (0.0..=1.0).contains(share)),
            "{fractions:?}"
        );
    }

    #[test]
    fn stages_share_the_bar_by_their_weights() {
        let (mut schedule, mut now) = (Schedule::default(), Duration::ZERO);
        schedule.plan(&[planned("a", 1.0), planned("b", 3.0)]);
        let mut fractions = run(&mut schedule, "a", 2, &mut now);
        fractions.extend(run(&mut schedule, "b", 3, &mut now));
        assert_eq!(fractions, [0.0, 0.125, 0.25, 0.25, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn a_retry_extends_the_plan_and_the_bar_goes_on() {
        let (mut schedule, mut now) = (Schedule::default(), Duration::ZERO);
        schedule.plan(&["match", "map", "depth"].map(|name| planned(name, 1.0)));
        let mut fractions = run(&mut schedule, "match", 2, &mut now);
        fractions.extend(run(&mut schedule, "map", 2, &mut now));
        schedule.extend(&[planned("match again", 1.0), planned("map", 1.0)]);
        fractions.extend(schedule.fraction());
        fractions.extend(run(&mut schedule, "match again", 2, &mut now));
        fractions.extend(run(&mut schedule, "map", 2, &mut now));
        fractions.extend(run(&mut schedule, "depth", 2, &mut now));
        assert_ascending(&fractions);
        assert_eq!(fractions.last(), Some(&1.0));
        let titles: Vec<String> = schedule
            .steps()
            .into_iter()
            .map(|step| step.title)
            .collect();
        assert_eq!(titles, ["match", "map", "match again", "map", "depth"]);
    }

    #[test]
    fn unplanned_left_out_and_repeated_reports_do_not_set_the_bar_back() {
        let (mut schedule, mut now) = (Schedule::default(), Duration::ZERO);
        schedule.plan(&["a", "b", "c", "d"].map(|name| planned(name, 1.0)));
        let mut fractions = run(&mut schedule, "a", 3, &mut now);
        schedule.report(0.2, || now); // threads report in any order
        fractions.extend(schedule.fraction());
        fractions.extend(run(&mut schedule, "surprise", 3, &mut now));
        fractions.extend(run(&mut schedule, "c", 3, &mut now));
        schedule.begin("d", now);
        schedule.report(0.5, || now + SECOND + SECOND);
        fractions.extend(schedule.fraction());
        schedule.plan(&[planned("e", 7.0)]);
        fractions.extend(schedule.fraction());
        fractions.extend(run(&mut schedule, "e", 3, &mut now));
        assert_ascending(&fractions);
        assert_eq!(fractions.last(), Some(&1.0));
        assert!(schedule.steps().iter().all(|step| step.title != "b"));
    }

    #[test]
    fn a_stage_begun_twice_goes_on() {
        let (mut schedule, mut now) = (Schedule::default(), Duration::ZERO);
        schedule.plan(&[planned("track", 1.0)]);
        let mut fractions = run(&mut schedule, "track", 2, &mut now);
        fractions.extend(run(&mut schedule, "track", 4, &mut now));
        assert_ascending(&fractions);
        assert_eq!(schedule.steps().len(), 1);
    }

    #[test]
    fn a_job_without_a_plan_has_a_single_stage() {
        let (mut schedule, mut now) = (Schedule::default(), Duration::ZERO);
        let mut fractions = run(&mut schedule, "read", 2, &mut now);
        fractions.extend(run(&mut schedule, "write", 4, &mut now));
        assert_ascending(&fractions);
        let steps = schedule.steps();
        assert_eq!((steps.len(), steps[0].title.as_str()), (1, "Write"));
    }

    #[test]
    fn consecutive_stages_of_one_step_are_shown_as_one() {
        let mut schedule = Schedule::default();
        let stage = |name, step| PlannedStage::new(name, step, 1.0);
        schedule.plan(&[
            stage("read", "Prepare"),
            stage("sort", "Prepare"),
            stage("fuse", "Fuse points"),
        ]);
        let states = |schedule: &Schedule| -> Vec<StepState> {
            schedule.steps().iter().map(|step| step.state).collect()
        };
        assert_eq!(states(&schedule), [StepState::ToCome, StepState::ToCome]);
        schedule.begin("read", Duration::ZERO);
        assert_eq!(states(&schedule), [StepState::Running, StepState::ToCome]);
        schedule.begin("sort", SECOND);
        assert_eq!(states(&schedule), [StepState::Running, StepState::ToCome]);
        schedule.begin("fuse", SECOND);
        assert_eq!(states(&schedule), [StepState::Done, StepState::Running]);
    }

    #[test]
    fn time_left_follows_the_pace_and_ignores_what_was_kept() {
        let mut schedule = Schedule::default();
        schedule.plan(&[
            planned("kept", 50.0),
            planned("half", 10.0),
            planned("rest", 20.0),
        ]);
        schedule.begin("kept", Duration::ZERO);
        schedule.report(0.0, || Duration::ZERO);
        schedule.report(1.0, || Duration::ZERO);
        // Half of this stage was done by an earlier run.
        let begun = Duration::from_millis(10);
        schedule.begin("half", begun);
        schedule.report(0.5, || begun);
        assert_eq!(schedule.left(begun), None, "too early to say");
        let now = Duration::from_secs(40);
        schedule.report(0.75, || now);
        // 40 s for a quarter of 10: 160 s for 10, of which a quarter is left, and twice 160 s.
        let left = schedule.left(now).unwrap();
        assert_eq!((left.as_secs_f64() / 10.0).round(), 36.0, "{left:?}");
    }

    #[test]
    fn nothing_is_claimed_of_a_stage_without_a_total() {
        let mut schedule = Schedule::default();
        schedule.begin("open", Duration::ZERO);
        let now = Duration::from_secs(60);
        assert_eq!((schedule.fraction(), schedule.left(now)), (None, None));
        assert_eq!(schedule.steps()[0].title, "Open");
    }
}
