use std::collections::BTreeMap;

use crate::MaskError;

/// What an import left out or put right: for each kind of fault how often it occurred, and where first.
#[derive(Debug, Default)]
pub(crate) struct Skipped(BTreeMap<&'static str, Kind>);

#[derive(Debug)]
struct Kind {
    count: usize,
    first: String,
}

impl Skipped {
    /// Counts a fault. `kind` reads on from a number: "polygons of fewer than three corners were left out".
    pub(crate) fn add(&mut self, kind: &'static str, place: impl Into<String>) {
        self.0
            .entry(kind)
            .or_insert_with(|| Kind {
                count: 0,
                first: place.into(),
            })
            .count += 1;
    }

    /// Adds what was counted elsewhere, later in the file.
    pub(crate) fn join(&mut self, later: Self) {
        for (kind, found) in later.0 {
            let count = found.count;
            self.0
                .entry(kind)
                .or_insert(Kind { count: 0, ..found })
                .count += count;
        }
    }

    /// Counts a file that was left out because it cannot be read, or has another size than its frame.
    pub(crate) fn add_unreadable(&mut self, error: &MaskError) {
        self.add("files cannot be used and were left out", error.to_string());
    }

    /// Whether nothing was counted.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// One sentence for each kind, for the user.
    pub(crate) fn warnings(&self) -> impl Iterator<Item = String> {
        self.0
            .iter()
            .map(|(kind, Kind { count, first })| match count {
                1 => format!("{count} {kind} ({first})"),
                _ => format!("{count} {kind} (first: {first})"),
            })
    }
}
