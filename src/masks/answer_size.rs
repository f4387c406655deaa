use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How much the newest click changes, compared with the answer chosen automatically.
///
/// A click is ambiguous: a grain, an ear and a whole plant are right answers at different sizes.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum AnswerSize {
    /// Two sizes below the automatic one.
    Smallest,
    /// One size below the automatic one.
    Smaller,
    /// The answer that the segmenter considers best.
    #[default]
    Automatic,
    /// One size above the automatic one.
    Larger,
    /// Two sizes above the automatic one.
    Largest,
}

impl AnswerSize {
    /// All sizes, smallest first.
    pub const ALL: [Self; 5] = [
        Self::Smallest,
        Self::Smaller,
        Self::Automatic,
        Self::Larger,
        Self::Largest,
    ];

    /// Returns the name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Smallest => "smallest",
            Self::Smaller => "smaller",
            Self::Automatic => "auto",
            Self::Larger => "larger",
            Self::Largest => "largest",
        }
    }

    /// Returns the size one step up or down, or `None` at the end.
    #[must_use]
    pub fn stepped(self, up: bool) -> Option<Self> {
        let at = Self::ALL.iter().position(|&size| size == self)?;
        let next = if up { at + 1 } else { at.checked_sub(1)? };
        Self::ALL.get(next).copied()
    }

    /// Returns the size of what remains if this is the size of what is taken away.
    #[must_use]
    pub fn reversed(self) -> Self {
        match self {
            Self::Smallest => Self::Largest,
            Self::Smaller => Self::Larger,
            Self::Automatic => Self::Automatic,
            Self::Larger => Self::Smaller,
            Self::Largest => Self::Smallest,
        }
    }

    /// Returns the number of steps from the automatic size; negative for smaller ones.
    #[must_use]
    pub fn steps(self) -> i32 {
        self as i32 - Self::Automatic as i32
    }
}

/// Maximum ratio of the areas of an answer and the next larger one.
const RATIO: f32 = 0.6;

/// Returns the answer of a size, as an index into `areas`.
///
/// `automatic` is the answer of the automatic size. Each step goes to the one of the answers that
/// are clearly smaller (or larger) than the last one that `best` picks from their indices. If there
/// is none, the last one stays.
pub(super) fn sized(
    areas: &[f32],
    automatic: usize,
    size: AnswerSize,
    best: impl Fn(&[usize]) -> Option<usize>,
) -> usize {
    let steps = size.steps();
    let mut at = automatic;
    for _ in 0..steps.unsigned_abs() {
        let fits = |&other: &usize| {
            if steps < 0 {
                areas[other] <= RATIO * areas[at]
            } else {
                RATIO * areas[other] >= areas[at]
            }
        };
        let left: Vec<usize> = (0..areas.len()).filter(fits).collect();
        let Some(next) = best(&left) else { break };
        at = next;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_go_to_clearly_smaller_and_larger_answers_and_stop_at_the_ends() {
        let areas = [10.0, 50.0, 90.0, 100.0, 400.0];
        let largest_below = |left: &[usize]| left.last().copied();
        let smallest_above = |left: &[usize]| left.first().copied();
        let below = |size| sized(&areas, 3, size, largest_below);
        assert_eq!(below(AnswerSize::Automatic), 3);
        assert_eq!(below(AnswerSize::Smaller), 1, "90 is as good as 100");
        assert_eq!(below(AnswerSize::Smallest), 0);
        let above = |size| sized(&areas, 3, size, smallest_above);
        assert_eq!(above(AnswerSize::Larger), 4);
        assert_eq!(above(AnswerSize::Largest), 4, "there is no larger one");
    }

    #[test]
    fn steps_are_inverse_and_names_are_those_of_recipes() {
        for size in AnswerSize::ALL {
            if let Some(next) = size.stepped(true) {
                assert_eq!(next.stepped(false), Some(size));
                assert_eq!(next.steps(), size.steps() + 1);
            }
        }
        let json = serde_json::to_string(&AnswerSize::Smaller).unwrap();
        assert_eq!(json, "\"smaller\"");
    }
}
