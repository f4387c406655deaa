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
fn times_of_a_step_are_added_and_earlier_stages_can_be_left_out() {
    let (mut schedule, mut now) = (Schedule::default(), Duration::ZERO);
    schedule.plan(&["match", "map", "depth"].map(|name| planned(name, 1.0)));
    for (name, steps) in [("match", 1), ("map", 2)] {
        run(&mut schedule, name, steps, &mut now);
    }
    schedule.extend(&[planned("match again", 1.0), planned("map", 1.0)]);
    run(&mut schedule, "map", 3, &mut now);
    let cameras = schedule.begun();
    run(&mut schedule, "depth", 4, &mut now);
    let times = |left_out| -> Vec<(String, u64)> {
        let times = schedule.step_times(left_out, now).into_iter();
        times
            .map(|time| (time.title, time.took.as_secs()))
            .collect()
    };
    let named = |name: &str, seconds| (name.to_owned(), seconds);
    let depth = named("depth", 5);
    assert_eq!(times(cameras), std::slice::from_ref(&depth));
    assert_eq!(times(0), [named("match", 2), named("map", 7), depth]);
    let mut unplanned = Schedule::default();
    unplanned.begin("read", Duration::ZERO);
    assert_eq!(unplanned.step_times(0, SECOND), []);
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
