use std::fmt::Display;

/// How many names a message lists.
pub(super) const NAMED: usize = 3;

/// The first items of a list, and how many more there are: `a, b, c and 5 more`.
pub(super) fn first_of<T: Display>(
    all: impl ExactSizeIterator<Item = T>,
    separator: &str,
) -> String {
    let more = all.len().saturating_sub(NAMED);
    let first: Vec<String> = all.take(NAMED).map(|item| item.to_string()).collect();
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    format!("{}{more}", first.join(separator))
}

#[cfg(test)]
mod tests {
    use super::first_of;

    #[test]
    fn the_items_that_are_not_listed_are_counted() {
        assert_eq!(first_of([1, 2, 3].iter(), ", "), "1, 2, 3");
        assert_eq!(first_of([1, 2, 3, 4, 5].iter(), "; "), "1; 2; 3 and 2 more");
        assert_eq!(first_of([""; 0].iter(), ", "), "");
    }
}
