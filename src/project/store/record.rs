use serde::{Deserialize, Serialize};

use crate::{Change, Edit, History, Project, Step};

/// One line of the journal and of the history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Counts the project's records from 1 through its whole life.
    pub seq: u64,
    /// What happened.
    pub act: Act,
}

/// What a record says. Every act holds its edits, so that the project's state needs no history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Act {
    /// A step was made.
    Step {
        /// For people.
        title: String,
        /// The changes with their inverses.
        changes: Vec<Change>,
        /// These changes belong to the step before (a tracking run arrives in pieces).
        #[serde(default)]
        continues: bool,
    },
    /// The last step was taken back by these edits.
    Undo {
        /// Inverses, last change first.
        edits: Vec<Edit>,
    },
    /// The step taken back last was done again by these edits.
    Redo {
        /// In order.
        edits: Vec<Edit>,
    },
}

impl Record {
    /// Does to the project what the record says.
    ///
    /// # Errors
    /// When an edit is refused: the record belongs to another state.
    pub fn replay(&self, project: &mut Project) -> anyhow::Result<()> {
        let again: Vec<Edit> = match &self.act {
            Act::Step { changes, .. } => changes.iter().map(|change| change.edit.clone()).collect(),
            Act::Undo { edits } | Act::Redo { edits } => edits.clone(),
        };
        for edit in again {
            project.apply(edit)?;
        }
        Ok(())
    }

    /// Does to the history what the record says.
    pub fn fold(self, history: &mut History) {
        match self.act {
            Act::Step {
                title,
                changes,
                continues: false,
            } => history.push(Step { title, changes }),
            Act::Step {
                title,
                changes,
                continues: true,
            } => history.extend(Step { title, changes }),
            Act::Undo { .. } => history.undo(),
            Act::Redo { .. } => history.redo(),
        }
    }

    /// The record as one line of JSON with its line break.
    ///
    /// # Errors
    /// When a value has no JSON form.
    pub fn line(&self) -> anyhow::Result<Vec<u8>> {
        let mut line = serde_json::to_vec(self)?;
        line.push(b'\n');
        Ok(line)
    }
}
