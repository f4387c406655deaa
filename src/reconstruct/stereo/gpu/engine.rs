//! The device that PatchMatch runs on, and its passes on a graphics card.

use std::ops::Range;
use std::sync::Arc;

use super::data::{SizesData, TurnData};
use super::field_buffers::{DeviceField, packed, unpacked};
use super::kernels::Kernels;
use crate::stereo::StereoError;
use crate::stereo::patchmatch::{
    DepthSearch, Field, Passes, PatchMatchOptions, PlaneMap, Processor, Round, SearchLevel,
    SweepState, search, search_consistent,
};
use ostra_compute::gpu::{Device, GpuError, Pieces, WorkSize};
use ostra_core::job::Progress;

/// Side of a workgroup in pixels.
pub const GROUP: u32 = 8;

/// The passes of one view on a graphics card.
#[derive(Debug)]
struct CardPasses<'a> {
    kernels: &'a Kernels,
    scoring: Pieces,
    sweeping: Pieces,
}

impl<'a> CardPasses<'a> {
    /// Creates the passes, with no work done yet.
    pub fn new(kernels: &'a Kernels) -> Self {
        Self {
            kernels,
            scoring: Pieces::default(),
            sweeping: Pieces::default(),
        }
    }
}

impl Passes for CardPasses<'_> {
    type Field = DeviceField;
    type Error = StereoError;

    fn begin(
        &mut self,
        level: &SearchLevel<'_>,
        hypotheses: Field,
    ) -> Result<DeviceField, StereoError> {
        let field = DeviceField::new(self.kernels, level)?;
        self.kernels
            .device
            .write(&field.values, 0, &packed(&hypotheses))?;
        Ok(field)
    }

    fn finer(
        &mut self,
        level: &SearchLevel<'_>,
        coarser: &DeviceField,
    ) -> Result<DeviceField, StereoError> {
        let Kernels {
            device,
            enlargement,
            enlarge,
            ..
        } = self.kernels;
        let field = DeviceField::new(self.kernels, level)?;
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
        _: &SearchLevel<'_>,
        field: &mut DeviceField,
        progress: &Progress,
    ) -> Result<(), StereoError> {
        for color in 0..2 {
            let turn = |rows| TurnData::scoring(color, rows);
            self.run(Pass::Score, field, turn, progress)?;
        }
        Ok(())
    }

    fn sweep(
        &mut self,
        level: &SearchLevel<'_>,
        field: &mut DeviceField,
        turn: SweepState,
        progress: &Progress,
    ) -> Result<(), StereoError> {
        for color in 0..2 {
            let turn = |rows| TurnData::new(level, turn, color, rows);
            self.run(Pass::Sweep, field, turn, progress)?;
        }
        Ok(())
    }

    fn finish(&mut self, field: DeviceField) -> Result<Field, StereoError> {
        self.copied(&field)
    }

    fn copied(&mut self, field: &DeviceField) -> Result<Field, StereoError> {
        let [width, height] = field.size.map(|side| side as usize);
        let values = self
            .kernels
            .device
            .read(&field.values, 2 * width.div_ceil(2) * height)?;
        Ok(unpacked(&values, field.size))
    }
}

/// A pass over the pixels of one colour.
#[derive(Debug, Clone, Copy)]
enum Pass {
    Score,
    Sweep,
}

impl CardPasses<'_> {
    /// Processes one colour of a field, piece by piece.
    fn run(
        &mut self,
        pass: Pass,
        field: &DeviceField,
        turn: impl Fn(Range<u32>) -> TurnData,
        progress: &Progress,
    ) -> Result<(), StereoError> {
        let device = &self.kernels.device;
        let (kernel, pieces) = match pass {
            Pass::Score => (&self.kernels.score, &mut self.scoring),
            Pass::Sweep => (&self.kernels.sweep, &mut self.sweeping),
        };
        let [width, height] = [field.size[0].div_ceil(2), field.size[1]];
        let submit = |rows: Range<u32>| {
            let groups = [
                width.div_ceil(GROUP),
                (rows.end - rows.start).div_ceil(GROUP),
            ];
            device.write(&field.turn, 0, &[turn(rows)])?;
            device.submit(kernel, &field.bindings, groups)
        };
        let size = WorkSize {
            width,
            rows: height,
            grain: GROUP,
        };
        pieces.run(device, size, submit, || Ok(progress.check()?))
    }
}

/// Maximum number of views processed at once.
///
/// The work of a view outside its passes runs on one core, which would leave the other cores or the
/// graphics card idle.
const MOST_AT_ONCE: usize = 4;

/// The device that PatchMatch runs on.
#[derive(Debug, Clone, Default)]
pub enum StereoEngine {
    /// All cores of the processor.
    #[default]
    Cpu,
    /// A graphics card.
    Gpu(Arc<Kernels>),
}

impl StereoEngine {
    /// Compiles the programs for a device; takes up to seconds.
    ///
    /// # Errors
    /// [`GpuError`] if the device does not accept them.
    pub fn on(device: Arc<Device>) -> Result<Self, GpuError> {
        Ok(Self::Gpu(Arc::new(Kernels::new(device)?)))
    }

    /// Returns the name of the device, in a form that can follow "on".
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Cpu => "the processor".into(),
            Self::Gpu(kernels) if kernels.device.is_software() => {
                format!(
                    "{}, a graphics card imitated by the processor",
                    kernels.device.name()
                )
            }
            Self::Gpu(kernels) => format!("the graphics card {}", kernels.device.name()),
        }
    }

    /// Returns how many views keep it busy: the work of each outside the passes over its pixels runs on one core.
    #[must_use]
    pub fn views_at_once(&self) -> usize {
        match self {
            Self::Cpu => rayon::current_num_threads().min(MOST_AT_ONCE),
            Self::Gpu(_) => MOST_AT_ONCE,
        }
    }

    /// Estimates the planes of a view, from coarse to fine, by the images alone.
    ///
    /// # Errors
    /// [`StereoError::Stopped`], [`StereoError::Gpu`].
    pub fn search(
        &self,
        task: &DepthSearch<'_>,
        options: &PatchMatchOptions,
        progress: &Progress,
    ) -> Result<PlaneMap, StereoError> {
        match self {
            Self::Cpu => Ok(search(&mut Processor::default(), task, options, progress)?),
            Self::Gpu(kernels) => search(&mut CardPasses::new(kernels), task, options, progress),
        }
    }

    /// Estimates the planes of a view in a round with geometric consistency.
    ///
    /// # Errors
    /// [`StereoError::Stopped`], [`StereoError::Gpu`].
    pub fn search_consistent(
        &self,
        task: &DepthSearch<'_>,
        round: &Round<'_>,
        options: &PatchMatchOptions,
        progress: &Progress,
    ) -> Result<PlaneMap, StereoError> {
        match self {
            Self::Cpu => Ok(search_consistent(
                &mut Processor::default(),
                task,
                round,
                options,
                progress,
            )?),
            Self::Gpu(kernels) => search_consistent(
                &mut CardPasses::new(kernels),
                task,
                round,
                options,
                progress,
            ),
        }
    }
}
