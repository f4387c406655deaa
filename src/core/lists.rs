//! Lists of names in messages.

use std::fmt::Display;

/// Joins names with commas, and the last two with `word`: `a, b or c`.
#[must_use]
pub fn in_words<T: Display>(names: impl IntoIterator<Item = T>, word: &str) -> String {
    let mut names: Vec<String> = names.into_iter().map(|name| name.to_string()).collect();
    match names.pop() {
        Some(last) if !names.is_empty() => format!("{} {word} {last}", names.join(", ")),
        last => last.unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::in_words;

    #[test]
    fn the_last_two_names_are_joined_by_the_word() {
        assert_eq!(in_words(["a", "b", "c"], "or"), "a, b or c");
        assert_eq!(in_words(["a", "b"], "and"), "a and b");
        assert_eq!(in_words(["a"], "or"), "a");
        assert_eq!(in_words([""; 0], "or"), "");
    }
}
