use std::ops::Range;

use super::data::{SizesData, TurnData};
use super::kernels::Kernels;
use super::room::{CardField, packed, unpacked};
use crate::stereo::StereoError;
use crate::stereo::patchmatch::{Field, Level, Passes, Turn};
use ostra_compute::gpu::{Kernel, Pieces};
use ostra_core::job::Progress;

/// Pixels of a workgroup, to the right and down.
pub const GROUP: u32 = 8;

/// The passes of one view on a graphics card.
#[derive(Debug)]
pub struct CardPasses<'a> {
    kernels: &'a Kernels,
    scoring: Pieces,
    sweeping: Pieces,
}

impl<'a> CardPasses<'a> {
    /// Nothing done yet.
    pub fn new(kernels: &'a Kernels) -> Self {
        Self {
            kernels,
            scoring: Pieces::default(),
            sweeping: Pieces::default(),
        }
    }
}

impl Passes for CardPasses<'_> {
    type Field = CardField;
    type Error = StereoError;

    fn begin(&mut self, level: &Level<'_>, hypotheses: Field) -> Result<CardField, StereoError> {
        let field = CardField::new(self.kernels, level)?;
        self.kernels
            .device
            .write(&field.values, 0, &packed(&hypotheses))?;
        Ok(field)
    }

    fn finer(&mut self, level: &Level<'_>, coarser: &CardField) -> Result<CardField, StereoError> {
        let Kernels {
            device,
            enlargement,
            enlarge,
            ..
        } = self.kernels;
        let field = CardField::new(self.kernels, level)?;
        let sizes = device.uniform("sizes", &SizesData::new(field.size, coarser.size))?;
        let bindings = device.bind(enlargement, &[&sizes, &coarser.values, &field.values])?;
        let submission = device.submit(
            enlarge,
            &bindings,
            field.size.map(|side| side.div_ceil(GROUP)),
        )?;
        device.wait(submission)?;
        Ok(field)
    }

    fn score(
        &mut self,
        _: &Level<'_>,
        field: &mut CardField,
        progress: &Progress,
    ) -> Result<(), StereoError> {
        for color in 0..2 {
            let turn = |rows| TurnData::scoring(color, rows);
            run(
                self.kernels,
                &self.kernels.score,
                &mut self.scoring,
                field,
                turn,
                progress,
            )?;
        }
        Ok(())
    }

    fn sweep(
        &mut self,
        level: &Level<'_>,
        field: &mut CardField,
        turn: Turn,
        progress: &Progress,
    ) -> Result<(), StereoError> {
        for color in 0..2 {
            let turn = |rows| TurnData::new(level, turn, color, rows);
            run(
                self.kernels,
                &self.kernels.sweep,
                &mut self.sweeping,
                field,
                turn,
                progress,
            )?;
        }
        Ok(())
    }

    fn finish(&mut self, field: CardField) -> Result<Field, StereoError> {
        self.copied(&field)
    }

    fn copied(&mut self, field: &CardField) -> Result<Field, StereoError> {
        let [width, height] = field.size.map(|side| side as usize);
        let values = self
            .kernels
            .device
            .read(&field.values, 2 * width.div_ceil(2) * height)?;
        Ok(unpacked(&values, field.size))
    }
}

/// One colour of a field, piece by piece.
fn run(
    Kernels { device, .. }: &Kernels,
    kernel: &Kernel,
    pieces: &mut Pieces,
    field: &CardField,
    turn: impl Fn(Range<u32>) -> TurnData,
    progress: &Progress,
) -> Result<(), StereoError> {
    let [width, height] = [field.size[0].div_ceil(2), field.size[1]];
    let submit = |rows: Range<u32>| {
        let groups = [
            width.div_ceil(GROUP),
            (rows.end - rows.start).div_ceil(GROUP),
        ];
        device.write(&field.turn, 0, &[turn(rows)])?;
        device.submit(kernel, &field.bindings, groups)
    };
    pieces.run(device, (width, height, GROUP), submit, || {
        Ok(progress.check()?)
    })
}
