use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;

use anyhow::{Context, Result};

use crate::{Command, Event, Recipe, Session};
use ostra_core::disk;

/// A larger recipe is not read.
const MAX_BYTES: u64 = 1 << 30;

/// The commands of a project in its folder, one a line, oldest first, over all sittings. Written without waiting for the
/// disk: the project is made of its journal, and this file may be deleted.
const FILE: &str = "recipe.jsonl";

impl Session {
    /// The commands that came to an end, from the one that made the project on; those of earlier sittings are in it as
    /// long as the project's folder tells of them.
    #[must_use]
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// Adds a command that was carried out to the recipe. The one in the project's folder is a convenience: where it
    /// cannot be read or written there is a warning.
    pub(crate) fn record(&mut self, command: Option<Command>) {
        let Some(command) =
            command.filter(|command| !matches!(command, Command::Stop | Command::Model(_)))
        else {
            return;
        };
        let mut told = Ok(());
        match &command {
            Command::New(_) | Command::Close | Command::Inspect(_) => self.recipe.commands.clear(),
            Command::Open(root) | Command::View(root) => (self.recipe.commands, told) = read(root),
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
            // A project that is only opened is left as it is, and so is one that is open for viewing.
            let is_kept = !is_opening && self.view_reason().is_none();
            told = told.and(if is_kept {
                self.write_last_step()
            } else {
                Ok(())
            });
        }
        if let Err(error) = told {
            self.events
                .push(Event::Warning(format!("{error:#}; the recipe lacks steps")));
        }
    }

    /// Writes the last command behind the others in the project's folder; all where it has none of them.
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
            // A line that a crash cut off ends before the next one.
            let lines: Vec<String> = new
                .iter()
                .map(|command| Ok(format!("\n{}", serde_json::to_string(command)?)))
                .collect::<Result<_>>()?;
            if is_new {
                return Ok(disk::write(&path, lines.concat().as_bytes())?);
            }
            let mut file = disk::open_in_place(&path)?;
            let before = file.seek(SeekFrom::End(0))?;
            // What a full disk cut off is taken back: half a line would be reported as damage at every later opening.
            let take_back = |_: &_| drop(file.set_len(before));
            Ok((&file)
                .write_all(lines.concat().as_bytes())
                .inspect_err(take_back)?)
        };
        write().with_context(|| format!("{}: cannot be written", path.display()))
    }
}

/// The commands that a project's folder tells of, and an error where that is not all of them.
fn read(root: &Path) -> (Vec<Command>, Result<()>) {
    let path = root.join(FILE);
    let text = match disk::read_regular_up_to(&path, MAX_BYTES) {
        // A byte that is no text damages its line only.
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
    let told = match damaged.len() {
        0 => Ok(()),
        count => Err(anyhow::anyhow!(
            "{}: {count} of its lines are damaged",
            path.display()
        )),
    };
    (commands.into_iter().flatten().collect(), told)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_of_earlier_sittings_are_read_and_damage_is_told() {
        let dir = tempfile::tempdir().unwrap();
        let (none, told) = read(dir.path());
        assert!(none.is_empty() && told.is_ok());
        let anchor = Command::MakeAnchor { frame: 3 };
        let line = serde_json::to_string(&anchor).unwrap();
        std::fs::write(dir.path().join(FILE), format!("\n{line}\n{{\"und\n{line}")).unwrap();
        let (commands, told) = read(dir.path());
        assert_eq!(commands, vec![anchor; 2]);
        assert!(
            told.unwrap_err()
                .to_string()
                .ends_with("recipe.jsonl: 1 of its lines are damaged")
        );
    }
}
