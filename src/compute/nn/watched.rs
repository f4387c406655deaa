use std::io::{BufRead, BufReader};
use std::process::{ChildStderr, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use ostra_core::programs::ChildProcess;

/// How often it is asked whether to go on.
const ASKED_EVERY: Duration = Duration::from_millis(100);

/// How a program ended.
pub(super) struct Ended {
    /// Its exit code; `None` where a signal ended it.
    pub(super) code: Option<i32>,
    /// The last line that it wrote to its standard error.
    pub(super) said: String,
}

impl Ended {
    pub(super) fn is_well(&self) -> bool {
        self.code == Some(0)
    }
}

/// Runs a program of the system to its end, or, with `None`, until `goes_on` says no.
pub(super) fn watched(
    command: &mut Command,
    goes_on: &mut dyn FnMut() -> bool,
) -> std::io::Result<Option<Ended>> {
    let program = ChildProcess::spawn(
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped()),
    )?;
    let (ended, waited) = channel();
    let stderr = program.take_stderr();
    // Ends with the program, which then closes what it writes to.
    std::thread::spawn(move || ended.send(last_line(stderr)));
    let said = loop {
        match waited.recv_timeout(ASKED_EVERY) {
            Err(RecvTimeoutError::Timeout) if !goes_on() => {
                program.kill()?;
                program.wait()?;
                return Ok(None);
            }
            Err(RecvTimeoutError::Timeout) => {}
            said => break said.unwrap_or_default(),
        }
    };
    Ok(Some(Ended {
        code: program.wait()?.code(),
        said,
    }))
}

fn last_line(stderr: Option<ChildStderr>) -> String {
    let lines = stderr
        .into_iter()
        .flat_map(|stderr| BufReader::new(stderr).lines().map_while(Result::ok));
    lines.last().unwrap_or_default()
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = ostra_core::programs::command("sh").unwrap();
        command.args(["-c", script]);
        command
    }

    #[test]
    fn a_program_tells_how_it_ended() {
        let ended = watched(
            &mut shell("echo first >&2; echo last >&2; exit 7"),
            &mut || true,
        )
        .unwrap()
        .unwrap();
        assert_eq!(
            (ended.code, ended.said.as_str(), ended.is_well()),
            (Some(7), "last", false)
        );
        assert!(
            watched(&mut shell("exit 0"), &mut || true)
                .unwrap()
                .unwrap()
                .is_well()
        );
        assert!(watched(&mut Command::new("no-program-of-this-name"), &mut || true).is_err());
    }

    #[test]
    fn a_program_that_is_no_longer_wanted_is_ended() {
        let begun = std::time::Instant::now();
        assert!(
            watched(&mut shell("exec sleep 60"), &mut || false)
                .unwrap()
                .is_none()
        );
        assert!(
            begun.elapsed() < Duration::from_secs(30),
            "it did not sleep to its end"
        );
    }
}
