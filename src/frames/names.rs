//! Parts of names that are paths with `/`.

/// The last part of a name.
#[must_use]
pub fn file_of(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

/// The name without what follows the last dot of its last part. A last part that only begins with a dot has no ending.
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
