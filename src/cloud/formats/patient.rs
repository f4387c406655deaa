use std::fs::File;
use std::io::{BufWriter, Error, Result, Seek, SeekFrom, Write};

/// A file whose faults are told at the end, by [`Patient::finish`]: the writer of the `las` crate panics when it is dropped
/// and cannot write its end. After the first fault nothing more is written.
pub(super) struct Patient {
    out: BufWriter<File>,
    fault: Option<Error>,
}

impl Patient {
    pub(super) fn new(out: File) -> Self {
        Self {
            out: BufWriter::with_capacity(1 << 18, out),
            fault: None,
        }
    }

    /// # Errors
    /// The first fault.
    pub(super) fn finish(mut self) -> Result<()> {
        self.fault.take().map_or(Ok(()), Err)?;
        self.out.flush()
    }

    /// What `act` gives, or the default from the first fault on.
    fn unless_faulty<T: Default>(
        &mut self,
        act: impl FnOnce(&mut BufWriter<File>) -> Result<T>,
    ) -> T {
        if self.fault.is_some() {
            return T::default();
        }
        act(&mut self.out).unwrap_or_else(|fault| {
            self.fault = Some(fault);
            T::default()
        })
    }
}

impl Write for Patient {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        self.unless_faulty(|out| out.write_all(bytes));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        self.unless_faulty(BufWriter::flush);
        Ok(())
    }
}

impl Seek for Patient {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        Ok(self.unless_faulty(|out| out.seek(to)))
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_at_the_end() {
        let Ok(full) = File::options().write(true).open("/dev/full") else {
            return;
        };
        let mut patient = Patient::new(full);
        patient.write_all(&vec![7; 1 << 20]).unwrap();
        assert!(patient.finish().is_err());
    }
}
