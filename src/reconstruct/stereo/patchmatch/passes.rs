use super::field::Field;
use super::level::Level;
use super::start::finer_field;
use super::sweep::{Empty, score, sweep};
use super::visit::Turn;
use ostra_core::job::{Progress, Stopped};

/// What carries out the passes of a search: the processor, or a graphics card with the same outcome.
pub trait Passes {
    /// Hypotheses and costs of a level, where the passes work on them.
    type Field;
    /// What can go wrong.
    type Error: From<Stopped>;

    /// A field of these hypotheses, without costs.
    ///
    /// # Errors
    /// Where there is no room for it.
    fn begin(&mut self, level: &Level<'_>, hypotheses: Field) -> Result<Self::Field, Self::Error>;

    /// A field of the planes of a coarser one, without costs.
    ///
    /// # Errors
    /// Where there is no room for it.
    fn finer(
        &mut self,
        level: &Level<'_>,
        coarser: &Self::Field,
    ) -> Result<Self::Field, Self::Error>;

    /// Gives every hypothesis its cost.
    ///
    /// # Errors
    /// [`Stopped`].
    fn score(
        &mut self,
        level: &Level<'_>,
        field: &mut Self::Field,
        progress: &Progress,
    ) -> Result<(), Self::Error>;

    /// One iteration over the field that was scored last: all red pixels, then all black ones.
    ///
    /// # Errors
    /// [`Stopped`].
    fn sweep(
        &mut self,
        level: &Level<'_>,
        field: &mut Self::Field,
        turn: Turn,
        progress: &Progress,
    ) -> Result<(), Self::Error>;

    /// A copy of a field as it is now.
    ///
    /// # Errors
    /// Where it cannot be brought back.
    fn copied(&mut self, field: &Self::Field) -> Result<Field, Self::Error>;

    /// The field in the end.
    ///
    /// # Errors
    /// Where it cannot be brought back.
    fn finish(&mut self, field: Self::Field) -> Result<Field, Self::Error>;
}

/// The passes on all cores of the processor.
#[derive(Debug, Default)]
pub struct Processor {
    /// Of the field that was scored last.
    empty: Empty,
}

impl Passes for Processor {
    type Field = Field;
    type Error = Stopped;

    fn begin(&mut self, _: &Level<'_>, hypotheses: Field) -> Result<Field, Stopped> {
        Ok(hypotheses)
    }

    fn finer(&mut self, level: &Level<'_>, coarser: &Field) -> Result<Field, Stopped> {
        Ok(finer_field(level, coarser))
    }

    fn score(
        &mut self,
        level: &Level<'_>,
        field: &mut Field,
        progress: &Progress,
    ) -> Result<(), Stopped> {
        self.empty = score(level, field, progress)?;
        Ok(())
    }

    fn sweep(
        &mut self,
        level: &Level<'_>,
        field: &mut Field,
        turn: Turn,
        progress: &Progress,
    ) -> Result<(), Stopped> {
        sweep(level, field, &self.empty, turn, progress)
    }

    fn copied(&mut self, field: &Field) -> Result<Field, Stopped> {
        Ok(field.clone())
    }

    fn finish(&mut self, field: Field) -> Result<Field, Stopped> {
        Ok(field)
    }
}
