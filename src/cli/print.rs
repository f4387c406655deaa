use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::sync::Mutex;

/// Longest message that is printed, in characters; a longer one loses its middle.
const MAX_MESSAGE: usize = 2000;

/// The first error of standard output; [`finish`] reports it.
static FAILURE: Mutex<Option<std::io::Error>> = Mutex::new(None);

/// Writes to standard output. Characters that would steer a terminal are escaped: names come from files of others.
pub(super) fn say(text: &str) {
    write(&printable(text));
}

/// Writes a value as one line of JSON.
pub(super) fn say_json(value: &impl Display) {
    let mut line = String::new();
    for c in value.to_string().chars() {
        if is_unsafe(c) {
            let mut units = [0; 2];
            line.extend(
                c.encode_utf16(&mut units)
                    .iter()
                    .map(|unit| format!("\\u{unit:04x}")),
            );
        } else {
            line.push(c);
        }
    }
    line.push('\n');
    write(&line);
}

/// Prints something that the user should look at, on standard error.
pub(super) fn warn(text: &str) {
    say_aside(&format!("warning: {}\n", one_line(text)));
}

/// Writes to standard error as it is. Where that fails (a full disk, a reader that has gone away) the work goes on: only
/// words are lost.
pub(super) fn say_aside(text: &str) {
    let mut out = std::io::stderr().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// A message on one line of bounded length, without characters that would steer a terminal.
pub(super) fn one_line(text: &str) -> String {
    let text = printable(&text.replace(['\n', '\r'], " "));
    let count = text.chars().count();
    if count <= MAX_MESSAGE {
        return text;
    }
    let half = MAX_MESSAGE / 2;
    let start: String = text.chars().take(half).collect();
    let end: String = text.chars().skip(count - half).collect();
    format!("{start} … {} characters left out … {end}", count - 2 * half)
}

/// What standard output could not take.
///
/// # Errors
/// The first error of any [`say`]; a reader that has gone away (`| head`) is not an error.
pub(super) fn finish() -> std::io::Result<()> {
    let mut failure = FAILURE
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    failure.take().map_or(Ok(()), Err)
}

fn write(text: &str) {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
    {
        let mut failure = FAILURE
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        failure.get_or_insert(error);
    }
}

/// The text with control characters and those that reverse the direction of writing as `\u{HEX}`.
pub(super) fn printable(text: &str) -> String {
    if !text.contains(is_unsafe) {
        return text.to_owned();
    }
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        if is_unsafe(c) {
            safe.extend(c.escape_unicode());
        } else {
            safe.push(c);
        }
    }
    safe
}

fn is_unsafe(c: char) -> bool {
    let is_direction = matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let is_line = matches!(c, '\u{2028}' | '\u{2029}');
    is_direction || is_line || c.is_control() && !matches!(c, '\n' | '\t')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminals_are_not_steered() {
        assert_eq!(
            printable("rice\x1b]0;OWNED\x07 › leaf\n"),
            "rice\\u{1b}]0;OWNED\\u{7} › leaf\n"
        );
        assert_eq!(printable("a\u{9b}31m\u{202e}b"), "a\\u{9b}31m\\u{202e}b");
        assert_eq!(printable("Stängel 名前\t1"), "Stängel 名前\t1");
    }

    #[test]
    fn messages_are_bounded_and_on_one_line() {
        let line = one_line(&"long\n".repeat(10_000));
        assert!(line.chars().count() < MAX_MESSAGE + 100 && !line.contains('\n'));
        assert!(line.contains("characters left out"));
    }
}
