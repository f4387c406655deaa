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

/// Advice to use the command line that messages give, each with that for the window.
const ADVICE: [(&str, &str); 4] = [
    ("; 'ostra info' lists the labels", ""),
    (
        "run 'ostra relocate PROJECT OLD NEW' or choose File",
        "choose File",
    ),
    (
        "run 'ostra relocate'",
        "choose File › Locate missing frames",
    ),
    ("'ostra scale', or the ruler", "the ruler"),
];

/// Commands of the command line that act on networks.
const NETWORK_COMMAND: &str = "ostra models";

/// Replaces commands and options of the command line in a message by what the window has for them.
pub(super) fn in_window_words(message: &str) -> String {
    let advised = ADVICE.iter().fold(message.to_owned(), |text, (from, to)| {
        text.replace(from, to)
    });
    without_options(&without_network_commands(&advised))
}

/// Replaces commands such as `ostra models install NAME` by the entry of the menu.
fn without_network_commands(message: &str) -> String {
    let mut text = String::with_capacity(message.len());
    let mut rest = message;
    while let Some(start) = rest.find(NETWORK_COMMAND) {
        let quote = rest[..start].chars().next_back();
        let quote = quote.filter(|quote| matches!(quote, '\'' | '`'));
        let end = quote.and_then(|quote| Some(start + rest[start..].find(quote)?));
        let Some(end) = end else {
            let after = start + NETWORK_COMMAND.len();
            text += &rest[..after];
            rest = &rest[after..];
            continue;
        };
        let before = &rest[..start - 1];
        let replaced = [("run ", "use "), ("with ", "in ")]
            .into_iter()
            .find_map(|(from, to)| Some((before.strip_suffix(from)?, to)));
        let (before, verb) = replaced.unwrap_or((before, ""));
        text.extend([before, verb]);
        text += "File › Networks";
        rest = &rest[end + 1..];
    }
    text + rest
}

/// Replaces options in a message by the names of controls.
///
/// Parentheses that hold only options are left out, because the text before them says the same.
fn without_options(message: &str) -> String {
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
            (
                "there is no label 7; 'ostra info' lists the labels",
                "there is no label 7",
            ),
            (
                "get both with 'ostra models install'",
                "get both in File › Networks",
            ),
            (
                "get it from a.org and run `ostra models add xmem FOLDER`",
                "get it from a.org and use File › Networks",
            ),
            (
                "or run `ostra models install x --accept-licence`",
                "or use File › Networks",
            ),
            (
                "a: is missing; if these are others, run 'ostra relocate'",
                "a: is missing; if these are others, choose File › Locate missing frames",
            ),
            ("see ostra models", "see ostra models"),
        ];
        for (message, expected) in cases {
            assert_eq!(in_window_words(message), expected);
        }
    }
}
