//! Which pictures look alike, judged by what their descriptors have in common.

mod alike;
#[cfg(test)]
mod tests;
mod vocabulary;

pub use alike::most_alike;
pub use vocabulary::Vocabulary;
