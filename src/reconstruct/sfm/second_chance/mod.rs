//! Another attempt at pictures that no model holds: they are tilted, matched and mapped again.

mod attempt;
mod look_again;
#[cfg(test)]
mod tests;

pub(super) use attempt::{Attempt, second_chance};
