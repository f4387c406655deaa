use std::collections::{BTreeMap, BTreeSet};

use ostra_frames::Frame;

/// Names listed in a message.
const NAMED: usize = 4;

/// What geometry did to a tracker's masks.
#[derive(Debug, Default)]
pub struct Account {
    /// Frames held against it.
    pub held: BTreeSet<usize>,
    /// Pixels mended, by frame; where two walks came by, in the worse one.
    pub mended: BTreeMap<usize, usize>,
    /// Frames on which objects were given to the tracker anew.
    pub seeded: BTreeSet<usize>,
    /// Frames that the tracker passed over before it began anew.
    pub passed: BTreeSet<usize>,
    /// Frames left to the tracker: without depth or camera, or none that could be read.
    pub left: BTreeSet<usize>,
    /// What the first of the frames that could not be read says.
    pub unread: Option<String>,
}

impl Account {
    /// Notes what was mended on a frame.
    pub fn note(&mut self, frame: usize, mended: usize) {
        self.held.insert(frame);
        if mended > 0 {
            let most = self.mended.entry(frame).or_default();
            *most = mended.max(*most);
        }
    }

    /// The lines that tell of it.
    pub fn lines(&self, frames: &[Frame]) -> Vec<String> {
        let held = self.held.len();
        let mut lines = Vec::new();
        if self.mended.is_empty() {
            lines.push(format!(
                "geometry contradicts no mask of the {held} frames that were held against it"
            ));
        } else {
            let pixels: usize = self.mended.values().sum();
            let names = names(self.mended.keys(), frames);
            let count = self.mended.len();
            lines.push(format!(
                "geometry mended {pixels} pixels in {count} of {held} frames: {names}"
            ));
        }
        if !self.seeded.is_empty() {
            let names = names(self.seeded.iter(), frames);
            lines.push(format!(
                "objects that strayed were given to the tracker anew on {names}"
            ));
        }
        if !self.left.is_empty() {
            let (count, names) = (self.left.len(), names(self.left.iter(), frames));
            lines.push(format!(
                "{count} frames were left to the tracker for want of depth or a camera: {names}"
            ));
        }
        if !self.passed.is_empty() {
            lines.push(format!(
                "the tracker gave no mask for {}",
                names(self.passed.iter(), frames)
            ));
        }
        lines.extend(self.unread.clone());
        lines
    }
}

/// The first few frames by name, and how many more there are.
fn names<'a>(of: impl ExactSizeIterator<Item = &'a usize>, frames: &[Frame]) -> String {
    let more = of.len().saturating_sub(NAMED);
    let named: Vec<&str> = of
        .take(NAMED)
        .map(|&frame| frames[frame].name.as_str())
        .collect();
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    named.join(", ") + &more
}
