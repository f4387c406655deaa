use std::sync::Arc;

use super::kernels::Kernels;
use super::passes::CardPasses;
use crate::stereo::StereoError;
use crate::stereo::patchmatch::{
    Found, PatchMatchOptions, Processor, Round, Search, search, search_consistent,
};
use ostra_compute::gpu::{Device, GpuError};
use ostra_core::job::Progress;

/// Most views that are worked on at once.
const MOST_AT_ONCE: usize = 4;

/// What PatchMatch runs on.
#[derive(Debug, Clone, Default)]
pub enum Engine {
    /// All cores of the processor.
    #[default]
    Cpu,
    /// A graphics card.
    Gpu(Arc<Kernels>),
}

impl Engine {
    /// A device with the programs compiled for it; takes up to seconds.
    ///
    /// # Errors
    /// [`GpuError`] where the device does not take them.
    pub fn on(device: Arc<Device>) -> Result<Self, GpuError> {
        Ok(Self::Gpu(Arc::new(Kernels::new(device)?)))
    }

    /// What it runs on, in words that can follow "on".
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

    /// How many views keep it busy: what each needs besides the passes over its pixels is one core's work.
    #[must_use]
    pub fn views_at_once(&self) -> usize {
        match self {
            Self::Cpu => rayon::current_num_threads().min(MOST_AT_ONCE),
            Self::Gpu(_) => MOST_AT_ONCE,
        }
    }

    /// The planes of a view, from coarse to fine, by the pictures alone.
    ///
    /// # Errors
    /// [`StereoError::Stopped`], [`StereoError::Gpu`].
    pub fn search(
        &self,
        task: &Search<'_>,
        options: &PatchMatchOptions,
        progress: &Progress,
    ) -> Result<Found, StereoError> {
        match self {
            Self::Cpu => Ok(search(&mut Processor::default(), task, options, progress)?),
            Self::Gpu(kernels) => search(&mut CardPasses::new(kernels), task, options, progress),
        }
    }

    /// The planes of a view after a round with geometric consistency.
    ///
    /// # Errors
    /// [`StereoError::Stopped`], [`StereoError::Gpu`].
    pub fn search_consistent(
        &self,
        task: &Search<'_>,
        round: &Round<'_>,
        options: &PatchMatchOptions,
        progress: &Progress,
    ) -> Result<Found, StereoError> {
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
