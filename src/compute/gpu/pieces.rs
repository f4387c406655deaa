use std::ops::Range;
use std::time::{Duration, Instant};

use super::device::Device;
use super::error::GpuError;
use super::program::Submission;

/// A piece takes about this long: a display on the same card stays fluent, no driver takes it for hung, and a stop is
/// noticed at once.
const AIM: Duration = Duration::from_millis(20);

/// Cuts long work into pieces, by how long the pieces before took.
#[derive(Debug)]
pub struct Pieces {
    items: u64,
}

impl Default for Pieces {
    /// Begins with small pieces.
    fn default() -> Self {
        Self { items: 1 << 12 }
    }
}

impl Pieces {
    /// Submits work of so many rows of `width` items piece by piece, pieces of a multiple of `grain` rows, and waits for
    /// the end. `submit` sends off a range of rows; `check` comes before each piece.
    ///
    /// # Errors
    /// Those of `submit` and `check`, and what the driver said.
    pub fn run<E: From<GpuError>>(
        &mut self,
        device: &Device,
        (width, rows, grain): (u32, u32, u32),
        mut submit: impl FnMut(Range<u32>) -> Result<Submission, GpuError>,
        mut check: impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let mut first = 0;
        let mut last_wait = Instant::now();
        let mut under_way: Option<Submission> = None;
        while first < rows {
            check()?;
            let count = (self.items / u64::from(width.max(1))).clamp(1, u64::from(rows)) as u32;
            let end = first
                .saturating_add(count.next_multiple_of(grain))
                .min(rows);
            let submission = submit(first..end)?;
            // One piece waits in line while another is worked on, so that the device is never idle.
            if let Some(before) = under_way.replace(submission) {
                device.wait(before)?;
                self.adapt(last_wait.elapsed());
                last_wait = Instant::now();
            }
            first = end;
        }
        under_way.map_or(Ok(()), |last| device.wait(last))?;
        Ok(())
    }

    fn adapt(&mut self, took: Duration) {
        if took < AIM / 2 {
            self.items = (self.items * 2).min(1 << 24);
        } else if took > AIM * 2 {
            self.items = (self.items / 2).max(1 << 8);
        }
    }
}
