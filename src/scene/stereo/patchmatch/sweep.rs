use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::field::{Color, Field};
use super::level::Level;
use super::plane::Plane;
use super::visit::{Turn, own_cost, visit};
use crate::engine::job::{Progress, Stopped};

/// One iteration over a field: all red pixels, then all black ones. Pixels of one colour read only the other's, so the
/// outcome is the same for any order and number of threads.
///
/// # Errors
/// [`Stopped`].
pub fn sweep(level: &Level<'_>, field: &mut Field, turn: Turn, progress: &Progress) -> Result<(), Stopped> {
    for color in 0..2 {
        let turn = Turn { visit: 2 * turn.visit + color, ..turn };
        let (half, [red, black]) = (field.half(), &mut field.colors);
        let (own, other) = if color == 0 { (red, &*black) } else { (black, &*red) };
        let Color { planes, costs } = own;
        let rows = planes.par_chunks_mut(half).zip(costs.par_chunks_mut(half)).enumerate();
        rows.try_for_each(|(y, (planes, costs))| {
            progress.check()?;
            let first = (y + color as usize) % 2;
            Arch::new().dispatch(Row { level, other: Some((other, turn)), planes, costs, y, first });
            Ok(())
        })?;
    }
    Ok(())
}

/// Gives every hypothesis of a field its cost.
///
/// # Errors
/// [`Stopped`].
pub fn score(level: &Level<'_>, field: &mut Field, progress: &Progress) -> Result<(), Stopped> {
    let half = field.half();
    for (color, Color { planes, costs }) in field.colors.iter_mut().enumerate() {
        let rows = planes.par_chunks_mut(half).zip(costs.par_chunks_mut(half)).enumerate();
        rows.try_for_each(|(y, (planes, costs))| {
            progress.check()?;
            Arch::new().dispatch(Row { level, other: None, planes, costs, y, first: (y + color) % 2 });
            Ok(())
        })?;
    }
    Ok(())
}

/// A row's pixels of one colour; without another colour to look at they are only scored.
struct Row<'a, 'b> {
    level: &'a Level<'b>,
    other: Option<(&'a Color, Turn)>,
    planes: &'a mut [Plane],
    costs: &'a mut [f32],
    y: usize,
    first: usize,
}

impl WithSimd for Row<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.run(simd);
    }
}

impl Row<'_, '_> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let width = self.level.picture.width;
        let pixels = self.planes.iter_mut().zip(self.costs).enumerate();
        for (i, (plane, cost)) in pixels {
            let x = 2 * i + self.first;
            let allowed = self.level.allowed.is_none_or(|allowed| allowed[self.y * width + x.min(width - 1)]);
            if x >= width || !allowed {
                continue;
            }
            match self.other {
                Some((other, turn)) => (*plane, *cost) = visit(simd, self.level, other, *plane, (x, self.y), turn),
                None => *cost = own_cost(simd, self.level, *plane, (x, self.y)),
            }
        }
    }
}
