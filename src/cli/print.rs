use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::sync::Mutex;

/// Longest printed message in characters. The middle of a longer one is left out.
const MAX_MESSAGE: usize = 2000;

/// First error of standard output, reported by [`finish`].
static FAILURE: Mutex<Option<std::io::Error>> = Mutex::new(None);

/// Writes text to standard output, with terminal control characters escaped.
///
/// Names may come from files of other people, which must not be able to control the terminal.
pub(super) fn print_text(text: &str) {
    write(&printable(text));
}

/// Writes a value as one line of JSON.
pub(super) fn print_json(value: &impl Display) {
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

/// Prints a warning to standard error.
pub(super) fn warn(text: &str) {
    print_to_stderr(&format!("warning: {}\n", one_line(text)));
}

/// Writes text to standard error as it is.
///
/// Failures (a full disk, a closed pipe) are ignored: the work goes on and only the message is
/// lost.
pub(super) fn print_to_stderr(text: &str) {
    let mut out = std::io::stderr().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Returns the message on one line of bounded length, without characters that control a terminal.
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

/// Fails if text could not be written to standard output.
///
/// # Errors
/// The first error of [`print_text`] or [`print_json`]. A closed pipe (`| head`) is not an error.
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

/// Escapes control characters and characters that reverse the writing direction as `\u{HEX}`.
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
    fn terminal_control_characters_are_escaped() {
        assert_eq!(
            printable("rice\x1b]0;OWNED\x07 › leaf\n"),
            "rice\\u{1b}]0;OWNED\\u{7} › leaf\n"
        );
        assert_eq!(printable("a\u{9b}31m\u{202e}b"), "a\\u{9b}31m\\u{202e}b");
        assert_eq!(printable("Stängel 名前\t1"), "Stängel 名前\t1");
    }

    #[test]
    fn messages_are_one_bounded_line() {
        let line = one_line(&"long\n".repeat(10_000));
        assert!(line.chars().count() < MAX_MESSAGE + 100 && !line.contains('\n'));
        assert!(line.contains("characters left out"));
    }
}
