/// Options of the command line that messages name, each with the control of the window.
const CONTROLS: [(&str, &str); 10] = [
    ("--frames", "'Frames'"),
    ("--depth", "'Depth folder'"),
    ("--depth-unit", "'Depth unit'"),
    ("--depth-intrinsics", "'Depth camera'"),
    ("--depth-pose", "'Depth pose'"),
    ("--cameras", "'Cameras'"),
    ("--intrinsics", "'Intrinsics'"),
    ("--every", "'Every Nth frame'"),
    ("--method", "the method"),
    ("--constrain", "'Check by geometry'"),
];

/// Replaces options of the command line in a message by the names of controls of the window.
///
/// Parentheses that hold only options are left out, because the text before them says the same.
pub(super) fn in_window_words(message: &str) -> String {
    let mut text = String::with_capacity(message.len());
    let mut rest = message;
    while let Some(start) = rest.find("--") {
        let is_option = rest[..start].ends_with([' ', '(', '\'', '`'])
            && rest[start + 2..].starts_with(|c: char| c.is_ascii_lowercase());
        if !is_option {
            text += &rest[..start + 2];
            rest = &rest[start + 2..];
            continue;
        }
        let opened = rest[..start].strip_suffix(" (");
        if let (Some(before), Some(end)) = (opened, rest[start..].find(')')) {
            text += before;
            rest = &rest[start + end + 1..];
            continue;
        }
        text += &rest[..start];
        let end = rest[start + 2..]
            .find(|c: char| !(c.is_ascii_lowercase() || c == '-'))
            .map_or(rest.len(), |end| start + 2 + end);
        let option = &rest[start..end];
        match CONTROLS.iter().find(|(name, _)| *name == option) {
            Some((_, control)) => text += control,
            None => text += &option[2..].replace('-', " "),
        }
        rest = &rest[end..];
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::in_window_words;

    #[test]
    fn options_become_controls() {
        let cases = [
            (
                "give its folders separately (--frames, --depth)",
                "give its folders separately",
            ),
            (
                "poses only; give the intrinsics too (--intrinsics FX,FY,CX,CY); or not",
                "poses only; give the intrinsics too; or not",
            ),
            (
                "is depth; give it with --depth, or convert it",
                "is depth; give it with 'Depth folder', or convert it",
            ),
            ("give --depth-unit", "give 'Depth unit'"),
            ("leave out --only-labelled", "leave out only labelled"),
            ("/a--b/1.png: 3 -- 4", "/a--b/1.png: 3 -- 4"),
        ];
        for (message, expected) in cases {
            assert_eq!(in_window_words(message), expected);
        }
    }
}
