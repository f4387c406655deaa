use std::time::Duration;

/// Time constant of the smoothing, in seconds.
///
/// Views differ in how long they take, so an estimate from few of them swings. Over this time a swing
/// is evened out, while a real change of pace still shows soon.
const SMOOTHING: f64 = 10.0;

/// Time left that runs down by itself and follows new estimates slowly.
#[derive(Debug, Clone, Copy)]
pub(super) struct Smoothed {
    seconds: f64,
    at: Duration,
}

impl Smoothed {
    pub fn new(seconds: f64, at: Duration) -> Self {
        Self { seconds, at }
    }

    /// Returns the time left with a new estimate taken into account.
    pub fn updated(self, seconds: f64, now: Duration) -> Self {
        let passed = now.saturating_sub(self.at).as_secs_f64();
        let expected = (self.seconds - passed).max(0.0);
        let share = 1.0 - (-passed / SMOOTHING).exp();
        Self::new(expected + share * (seconds - expected), now)
    }

    pub fn duration(self) -> Duration {
        Duration::try_from_secs_f64(self.seconds).unwrap_or(Duration::MAX)
    }
}

/// Returns the time left as people say it, e.g. `about 4 min left`.
#[must_use]
pub fn time_left_text(left: Duration) -> String {
    let seconds = left.as_secs();
    let minutes = (seconds + 30) / 60;
    let rounded = |value: u64, to: u64| (value + to / 2) / to * to;
    match seconds {
        0..10 => "a few seconds left".to_owned(),
        10..55 => format!("about {} s left", seconds.div_ceil(10) * 10),
        55..600 => format!("about {minutes} min left"),
        600..3_450 => format!("about {} min left", rounded(minutes, 5)),
        3_450..36_000 => {
            let minutes = rounded(minutes, 10);
            match minutes % 60 {
                0 => format!("about {} h left", minutes / 60),
                rest => format!("about {} h {rest} min left", minutes / 60),
            }
        }
        36_000..172_800 => format!("about {} h left", rounded(minutes, 60) / 60),
        _ => format!("about {} days left", rounded(minutes, 1440) / 1440),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_rounded_as_people_say_them() {
        let texts = [
            (3, "a few seconds left"),
            (11, "about 20 s left"),
            (41, "about 50 s left"),
            (58, "about 1 min left"),
            (250, "about 4 min left"),
            (599, "about 10 min left"),
            (1_400, "about 25 min left"),
            (3_449, "about 55 min left"),
            (3_450, "about 1 h left"),
            (4_900, "about 1 h 20 min left"),
            (35_999, "about 10 h left"),
            (90_000, "about 25 h left"),
            (400_000, "about 5 days left"),
        ];
        for (seconds, text) in texts {
            assert_eq!(time_left_text(Duration::from_secs(seconds)), text);
        }
    }

    #[test]
    fn a_swing_is_smoothed_and_a_lasting_change_is_followed() {
        let at = Duration::from_secs;
        let first = Smoothed::new(100.0, at(0));
        let swung = first.updated(300.0, at(1));
        assert!((99.0..140.0).contains(&swung.seconds), "{swung:?}");
        let followed = (2..60).fold(swung, |left, second| left.updated(300.0, at(second)));
        assert!((followed.seconds - 300.0).abs() < 15.0, "{followed:?}");
        assert_eq!(first.updated(0.0, at(400)).duration(), Duration::ZERO);
    }
}
