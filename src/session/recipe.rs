use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;

use anyhow::{Context, Result};

use crate::{Command, Event, Recipe, Session};
use ostra_core::disk;

/// Maximum size of a recipe that is read, in bytes.
const MAX_BYTES: u64 = 1 << 30;

/// File in the project's folder with its commands, one per line, oldest first, over all sessions.
///
/// It is written without syncing, because the project is restored from its journal. The file may be
/// deleted.
const FILE: &str = "recipe.jsonl";

impl Session {
    /// Returns the commands that succeeded, beginning with the one that created the project.
    ///
    /// Commands of earlier sessions are included if the project's folder still lists them.
    #[must_use]
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// Adds an executed command to the recipe.
    ///
    /// The recipe in the project's folder is a convenience. If it cannot be read or written, there
    /// is only a warning.
    pub(crate) fn record(&mut self, command: Option<Command>) {
        let Some(command) =
            command.filter(|command| !matches!(command, Command::Stop | Command::Model(_)))
        else {
            return;
        };
        let mut reported = Ok(());
        match &command {
            Command::New(_) | Command::Close | Command::Inspect(_) => self.recipe.commands.clear(),
            Command::Open(root) | Command::View(root) => {
                (self.recipe.commands, reported) = read(root);
            }
            _ => {}
        }
        let is_step = match &command {
            Command::Close => false,
            Command::Open(_) | Command::View(_) => self.recipe.commands.is_empty(),
            _ => true,
        };
        if is_step {
            let is_opening = matches!(command, Command::Open(_) | Command::View(_));
            self.recipe.commands.push(command);
            // A project that was only opened is not changed, nor one that is open for viewing.
            let is_kept = !is_opening && self.view_reason().is_none();
            reported = reported.and(if is_kept {
                self.write_last_step()
            } else {
                Ok(())
            });
        }
        if let Err(error) = reported {
            self.events
                .push(Event::Warning(format!("{error:#}; the recipe lacks steps")));
        }
    }

    /// Appends the last command to the recipe in the project's folder.
    ///
    /// If the file does not exist or the project is new, all commands are written.
    fn write_last_step(&self) -> Result<()> {
        let Some(path) = self.root().map(|root| root.join(FILE)) else {
            return Ok(());
        };
        let commands = &self.recipe.commands;
        let is_new = matches!(commands[..], [Command::New(_)]) || !path.exists();
        let new = if is_new {
            &commands[..]
        } else {
            &commands[commands.len() - 1..]
        };
        let write = || -> Result<()> {
            // The leading line break terminates a line that a crash cut off.
            let lines: Vec<String> = new
                .iter()
                .map(|command| Ok(format!("\n{}", serde_json::to_string(command)?)))
                .collect::<Result<_>>()?;
            if is_new {
                return Ok(disk::write(&path, lines.concat().as_bytes())?);
            }
            let mut file = disk::open_in_place(&path)?;
            let before = file.seek(SeekFrom::End(0))?;
            // Remove what a full disk cut off. Half a line would be reported as damage whenever the
            // project is opened.
            let take_back = |_: &_| drop(file.set_len(before));
            Ok((&file)
                .write_all(lines.concat().as_bytes())
                .inspect_err(take_back)?)
        };
        write().with_context(|| format!("{}: cannot be written", path.display()))
    }
}

/// Returns the commands listed in a project's folder, and an error if some are missing.
fn read(root: &Path) -> (Vec<Command>, Result<()>) {
    let path = root.join(FILE);
    let text = match disk::read_regular_up_to(&path, MAX_BYTES) {
        // A byte that is not UTF-8 damages only its line.
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(error) if error.kind() == ErrorKind::NotFound => return (Vec::new(), Ok(())),
        Err(error) => {
            return (
                Vec::new(),
                Err(error).with_context(|| format!("{}: cannot be read", path.display())),
            );
        }
    };
    let lines = text
        .lines()
        .filter(|line| !line.is_empty())
        .map(serde_json::from_str);
    let (commands, damaged): (Vec<_>, Vec<_>) = lines.partition(Result::is_ok);
    let reported = match damaged.len() {
        0 => Ok(()),
        count => Err(anyhow::anyhow!(
            "{}: {count} of its lines are damaged",
            path.display()
        )),
    };
    (commands.into_iter().flatten().collect(), reported)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_of_earlier_sessions_are_read_and_damage_is_reported() {
        let dir = tempfile::tempdir().unwrap();
        let (none, reported) = read(dir.path());
        assert!(none.is_empty() && reported.is_ok());
        let keyframe = Command::MakeKeyframe { frame: 3 };
        let line = serde_json::to_string(&keyframe).unwrap();
        std::fs::write(dir.path().join(FILE), format!("\n{line}\n{{\"und\n{line}")).unwrap();
        let (commands, reported) = read(dir.path());
        assert_eq!(commands, vec![keyframe; 2]);
        assert!(
            reported
                .unwrap_err()
                .to_string()
                .ends_with("recipe.jsonl: 1 of its lines are damaged")
        );
    }
}
