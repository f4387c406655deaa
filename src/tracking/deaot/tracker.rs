use std::path::Path;
use std::sync::Arc;

use super::network::Networks;
use super::options::DeaotOptions;
use super::walk::Walk;
use crate::propagate::{Propagator, track};
use ostra_compute::nn::{Network, NnError, load};
use ostra_core::job::Progress;
use ostra_masks::{MaskError, TrackRequest, TrackedFrame, Tracker};

/// DeAOT: carries masks of any number of labels through films, ten at once. Clones share the networks.
#[derive(Debug, Clone)]
pub struct Deaot {
    networks: Arc<Networks>,
    /// How much it sees and remembers.
    pub options: DeaotOptions,
}

impl Deaot {
    /// The networks `deaot` of a folder of networks.
    ///
    /// # Errors
    /// When they are not installed there, do not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path) -> Result<Self, NnError> {
        let four = <[Network; 4]>::try_from(load(folder, "deaot")?);
        Self::new(four.map_err(|_| NnError::Request("`deaot` is four networks".into()))?)
    }

    /// Of encoder, remember, propagate and identify, as `assets/export/deaot.py` makes them.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] where one has other inputs or outputs.
    pub fn new(networks: [Network; 4]) -> Result<Self, NnError> {
        Ok(Self {
            networks: Arc::new(Networks::new(networks)?),
            options: DeaotOptions::default(),
        })
    }

    /// A walk through pictures that remembers nothing yet.
    pub(super) fn walk<'a>(&'a self, progress: &'a Progress) -> Walk<'a> {
        Walk::new(self.networks.running(progress), self.options)
    }
}

impl Tracker for Deaot {
    fn name(&self) -> &'static str {
        "deaot"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        track(request, emit, progress, &|| -> Box<dyn Propagator + '_> {
            Box::new(self.walk(progress))
        })
    }
}
