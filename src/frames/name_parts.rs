//! Parts of frame names, which are paths separated by `/`.

/// Returns the last part of a name.
#[must_use]
pub fn file_of(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

/// Returns the name without the extension of its last part.
///
/// A last part whose only dot is its first character has no extension.
#[must_use]
pub fn without_ending(name: &str) -> &str {
    let file = file_of(name);
    match file.rfind('.') {
        Some(dot) if dot > 0 => &name[..name.len() - file.len() + dot],
        _ => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_end_at_the_last_dot_of_their_last_part() {
        for (name, file, stem) in [
            ("a/b.c/d.e.png", "d.e.png", "a/b.c/d.e"),
            ("a/b.c/d", "d", "a/b.c/d"),
            ("d.png", "d.png", "d"),
            ("a/.hidden", ".hidden", "a/.hidden"),
            ("a/", "", "a/"),
            ("", "", ""),
        ] {
            assert_eq!((file_of(name), without_ending(name)), (file, stem));
        }
    }
}
