use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, bail};

use ostra_core::programs::ChildProcess;

/// A finished child process.
pub(super) struct Finished {
    /// Wall time from its start to its end.
    pub seconds: f64,
    /// What it wrote to standard output.
    pub output: String,
}

impl Finished {
    /// Runs a command to its end; its standard error goes to a file in `work`.
    ///
    /// # Errors
    /// Returns an error with the last line of standard error if it cannot be started or fails.
    pub fn run(command: &mut Command, work: &Path) -> Result<Self> {
        let program = command.get_program().display().to_string();
        let errors = work.join("errors.txt");
        let file = File::create(&errors)
            .with_context(|| format!("{}: cannot be written", errors.display()))?;
        command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(file);
        let begun = Instant::now();
        let child = ChildProcess::spawn(command)
            .with_context(|| format!("{program}: cannot be started"))?;
        let mut bytes = Vec::new();
        if let Some(mut output) = child.take_stdout() {
            output
                .read_to_end(&mut bytes)
                .with_context(|| format!("{program}: its output cannot be read"))?;
        }
        let status = child
            .wait()
            .with_context(|| format!("{program}: its end is not reported"))?;
        let seconds = begun.elapsed().as_secs_f64();
        if !status.success() {
            let text = std::fs::read(&errors).unwrap_or_default();
            let text = String::from_utf8_lossy(&text);
            let last = text.lines().rfind(|line| !line.trim().is_empty());
            match last {
                Some(line) => bail!("{}", line.strip_prefix("ostra: ").unwrap_or(line)),
                None => bail!("{program} ended with {status}"),
            }
        }
        Ok(Self {
            seconds,
            output: String::from_utf8_lossy(&bytes).into_owned(),
        })
    }

    /// Reads the last line of the output as JSON.
    ///
    /// # Errors
    /// Returns an error if it is not what is expected.
    pub fn json<T: serde::de::DeserializeOwned>(&self) -> Result<T> {
        let line = self.output.lines().last().unwrap_or_default();
        serde_json::from_str(line).context("the program printed no such results")
    }
}
