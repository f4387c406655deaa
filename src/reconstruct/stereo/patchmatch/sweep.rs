//! Sweeps over all pixels of one colour after the other, and the passes that a search consists of.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::level::SearchLevel;
use super::pixel_update::{ColorUpdate, SweepState, own_cost};
use super::plane::{Color, Field, Plane, WORST};
use super::start::finer_field;
use ostra_core::job::{Progress, Stopped};

/// Runs one iteration over a field: all red pixels, then all black ones.
///
/// Pixels of one colour read only the other's, so the result is the same for any order and number
/// of threads. Pixels marked by `empty` stay unchanged.
///
/// # Errors
/// [`Stopped`].
pub fn sweep(
    level: &SearchLevel<'_>,
    field: &mut Field,
    empty: &Empty,
    turn: SweepState,
    progress: &Progress,
) -> Result<(), Stopped> {
    for color in 0..2 {
        let turn = SweepState {
            visit: 2 * turn.visit + color,
            ..turn
        };
        let (half, [red, black]) = (field.half(), &mut field.colors);
        let (own, other) = if color == 0 {
            (red, &*black)
        } else {
            (black, &*red)
        };
        let Color { planes, costs } = own;
        debug_assert_eq!(
            planes.len(),
            empty[color as usize].len(),
            "marks of another field"
        );
        let pixels = planes.par_chunks_mut(half).zip(costs.par_chunks_mut(half));
        let rows = pixels
            .zip(empty[color as usize].par_chunks(half))
            .enumerate();
        rows.try_for_each(|(y, ((planes, costs), empty))| {
            progress.check()?;
            let (first, work) = (
                (y + color as usize) % 2,
                RowTask::Visit { other, turn, empty },
            );
            Arch::new().dispatch(SweepRow {
                level,
                work,
                planes,
                costs,
                y,
                first,
            });
            Ok(())
        })?;
    }
    Ok(())
}

/// Pixels without texture to compare, by colour as in a [`Field`].
type Empty = [Vec<bool>; 2];

/// Computes the cost of every hypothesis of a field; returns which pixels have nothing to compare.
///
/// # Errors
/// [`Stopped`].
pub fn score(
    level: &SearchLevel<'_>,
    field: &mut Field,
    progress: &Progress,
) -> Result<Empty, Stopped> {
    let half = field.half();
    let mut empty = [0, 1].map(|color| vec![false; field.colors[color].costs.len()]);
    for (color, (Color { planes, costs }, empty)) in
        field.colors.iter_mut().zip(&mut empty).enumerate()
    {
        let pixels = planes.par_chunks_mut(half).zip(costs.par_chunks_mut(half));
        let rows = pixels.zip(empty.par_chunks_mut(half)).enumerate();
        rows.try_for_each(|(y, ((planes, costs), empty))| {
            progress.check()?;
            let (first, work) = ((y + color) % 2, RowTask::Score { empty });
            Arch::new().dispatch(SweepRow {
                level,
                work,
                planes,
                costs,
                y,
                first,
            });
            Ok(())
        })?;
    }
    Ok(empty)
}

/// A row's pixels of one colour.
struct SweepRow<'a, 'b> {
    level: &'a SearchLevel<'b>,
    work: RowTask<'a>,
    planes: &'a mut [Plane],
    costs: &'a mut [f32],
    y: usize,
    first: usize,
}

/// The task for a row.
enum RowTask<'a> {
    /// Computes costs of its hypotheses, and marks pixels with nothing to compare.
    Score { empty: &'a mut [bool] },
    /// Searches for better hypotheses at pixels that are not marked.
    Visit {
        other: &'a Color,
        turn: SweepState,
        empty: &'a [bool],
    },
}

impl WithSimd for SweepRow<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.run(simd);
    }
}

impl SweepRow<'_, '_> {
    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let width = self.level.image.width;
        let pixels = self.planes.iter_mut().zip(self.costs).enumerate();
        for (i, (plane, cost)) in pixels {
            let x = 2 * i + self.first;
            let allowed = self
                .level
                .allowed
                .is_none_or(|allowed| allowed[self.y * width + x.min(width - 1)]);
            if x >= width || !allowed {
                continue;
            }
            match &mut self.work {
                RowTask::Score { empty } => {
                    let own = own_cost(simd, self.level, *plane, x, self.y);
                    (*cost, empty[i]) = (own.unwrap_or(WORST), own.is_none());
                }
                RowTask::Visit { empty, .. } if empty[i] => {}
                RowTask::Visit { other, turn, .. } => {
                    let update = ColorUpdate {
                        level: self.level,
                        other,
                        turn: *turn,
                    };
                    (*plane, *cost) = update.update_pixel(simd, *plane, x, self.y);
                }
            }
        }
    }
}

/// Runs the passes of a search: on the processor, or on a graphics card with the same result.
pub trait Passes {
    /// Hypotheses and costs of a level, in the memory where the passes run.
    type Field;
    /// Error of the passes.
    type Error: From<Stopped>;

    /// Creates a field of these hypotheses, without costs.
    ///
    /// # Errors
    /// Fails if there is not enough memory.
    fn begin(
        &mut self,
        level: &SearchLevel<'_>,
        hypotheses: Field,
    ) -> Result<Self::Field, Self::Error>;

    /// Creates a field of the planes of a coarser one, without costs.
    ///
    /// # Errors
    /// Fails if there is not enough memory.
    fn finer(
        &mut self,
        level: &SearchLevel<'_>,
        coarser: &Self::Field,
    ) -> Result<Self::Field, Self::Error>;

    /// Computes the cost of every hypothesis.
    ///
    /// # Errors
    /// [`Stopped`].
    fn score(
        &mut self,
        level: &SearchLevel<'_>,
        field: &mut Self::Field,
        progress: &Progress,
    ) -> Result<(), Self::Error>;

    /// Runs one iteration over the field that was scored last: all red pixels, then all black ones.
    ///
    /// # Errors
    /// [`Stopped`].
    fn sweep(
        &mut self,
        level: &SearchLevel<'_>,
        field: &mut Self::Field,
        turn: SweepState,
        progress: &Progress,
    ) -> Result<(), Self::Error>;

    /// Returns a copy of the current field.
    ///
    /// # Errors
    /// Fails if it cannot be read back.
    fn copied(&mut self, field: &Self::Field) -> Result<Field, Self::Error>;

    /// Returns the final field.
    ///
    /// # Errors
    /// Fails if it cannot be read back.
    fn finish(&mut self, field: Self::Field) -> Result<Field, Self::Error>;
}

/// Runs the passes on all cores of the processor.
#[derive(Debug, Default)]
pub struct Processor {
    /// Marks of the field that was scored last.
    empty: Empty,
}

impl Passes for Processor {
    type Field = Field;
    type Error = Stopped;

    fn begin(&mut self, _: &SearchLevel<'_>, hypotheses: Field) -> Result<Field, Stopped> {
        Ok(hypotheses)
    }

    fn finer(&mut self, level: &SearchLevel<'_>, coarser: &Field) -> Result<Field, Stopped> {
        Ok(finer_field(level, coarser))
    }

    fn score(
        &mut self,
        level: &SearchLevel<'_>,
        field: &mut Field,
        progress: &Progress,
    ) -> Result<(), Stopped> {
        self.empty = score(level, field, progress)?;
        Ok(())
    }

    fn sweep(
        &mut self,
        level: &SearchLevel<'_>,
        field: &mut Field,
        turn: SweepState,
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
