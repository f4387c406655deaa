use serde::{Deserialize, Serialize};

use ostra_core::statistics::upper_median;
use ostra_project::StepSeconds;

/// Last stage of a reconstruction in a bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum BenchStage {
    /// Camera poses.
    #[default]
    Cameras,
    /// Depth maps, for sets without a depth sensor.
    Depth,
    /// The fused cloud.
    Cloud,
}

/// What a reconstruction of a set took, and how exact it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// Wall time in seconds, from the start of the program to its end; median over the rounds.
    pub seconds: f64,
    /// Wall time per image of the set, in seconds.
    pub seconds_per_image: f64,
    /// Wall time of every round, in seconds.
    pub rounds: Vec<f64>,
    /// Wall time of each step of the round of median time.
    pub steps: Vec<StepSeconds>,
    /// Number of images that got a pose.
    pub placed: usize,
    /// Root mean square error of the camera centres after alignment, in percent of the extent.
    /// `None` without ground truth.
    pub centre_percent: Option<f64>,
    /// Median error of the rotations after alignment, in degrees. `None` without ground truth.
    pub rotation_deg: Option<f64>,
    /// Largest memory in use in any round; `None` if the system does not report it.
    pub peak_memory_bytes: Option<u64>,
}

/// One run of a program, before it is scored.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(super) struct RunOutcome {
    /// Wall time in seconds; measured from outside.
    #[serde(skip)]
    pub seconds: f64,
    pub steps: Vec<StepSeconds>,
    pub placed: usize,
    pub peak_memory_bytes: Option<u64>,
}

/// Errors of the cameras of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CameraErrors {
    pub centre_percent: f64,
    pub rotation_deg: f64,
}

impl Measured {
    /// Summarises the rounds of a program on a set of `images`; `None` without rounds.
    ///
    /// `placed` and errors are those of the last round.
    pub(super) fn of(
        rounds: Vec<RunOutcome>,
        images: usize,
        errors: Option<CameraErrors>,
    ) -> Option<Self> {
        let times: Vec<f64> = rounds.iter().map(|round| round.seconds).collect();
        let seconds = upper_median(&mut times.clone())?;
        let placed = rounds.last()?.placed;
        let peaks: Option<Vec<u64>> = rounds.iter().map(|round| round.peak_memory_bytes).collect();
        let median = rounds
            .into_iter()
            .find(|round| round.seconds.total_cmp(&seconds).is_eq())?;
        Some(Self {
            seconds,
            seconds_per_image: seconds / images.max(1) as f64,
            rounds: times,
            steps: median.steps,
            placed,
            centre_percent: errors.map(|errors| errors.centre_percent),
            rotation_deg: errors.map(|errors| errors.rotation_deg),
            peak_memory_bytes: peaks.and_then(|peaks| peaks.into_iter().max()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_are_summarised_by_the_one_of_median_time() {
        let round = |seconds: f64, peak_memory_bytes| RunOutcome {
            seconds,
            steps: vec![StepSeconds {
                step: "Match images".into(),
                seconds: seconds / 2.0,
            }],
            placed: 9,
            peak_memory_bytes,
        };
        let rounds = vec![
            round(8.0, Some(300)),
            round(2.0, Some(500)),
            round(4.0, Some(400)),
        ];
        let measured = Measured::of(rounds, 10, None).unwrap();
        assert_eq!((measured.seconds, measured.seconds_per_image), (4.0, 0.4));
        assert_eq!(measured.rounds, [8.0, 2.0, 4.0]);
        assert_eq!(measured.steps[0].seconds, 2.0);
        assert_eq!(
            (measured.placed, measured.peak_memory_bytes),
            (9, Some(500))
        );
        // A peak that is not known for all rounds is not known.
        let rounds = vec![round(1.0, None), round(2.0, Some(7))];
        assert_eq!(
            Measured::of(rounds, 1, None).unwrap().peak_memory_bytes,
            None
        );
        assert_eq!(Measured::of(Vec::new(), 1, None), None);
    }
}
