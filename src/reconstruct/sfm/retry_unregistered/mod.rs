//! Second attempt at images that no model contains: they are matched with the images that see the
//! same place, then under simulated tilts, and placed in the standing model.

mod attempt;
mod search;
mod tilted;

pub(super) use attempt::Attempt;
pub(super) use search::retry_unregistered;

#[cfg(test)]
mod tests;
