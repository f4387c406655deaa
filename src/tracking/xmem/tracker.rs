use std::path::Path;
use std::sync::Arc;

use super::networks::Networks;
use super::options::XMemOptions;
use super::walk::Walk;
use crate::propagate::{Propagator, track};
use ostra_compute::nn::{Network, NnError, load};
use ostra_core::job::Progress;
use ostra_masks::{MaskError, TrackRequest, TrackedFrame, Tracker};

/// XMem: carries masks of any number of labels through films, with a memory that does not grow. Clones share the networks.
#[derive(Debug, Clone)]
pub struct XMem {
    pub(super) networks: Arc<Networks>,
    /// How much it sees and remembers.
    pub options: XMemOptions,
}

impl XMem {
    /// The networks `xmem` of a folder of networks.
    ///
    /// # Errors
    /// When they are not installed there, do not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path) -> Result<Self, NnError> {
        let three = <[Network; 3]>::try_from(load(folder, "xmem")?);
        Self::new(three.map_err(|_| NnError::Request("`xmem` is three networks".into()))?)
    }

    /// Of key encoder, value encoder and decoder, as `assets/export/xmem.py` makes them.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] where they do not take what is fed.
    pub fn new(networks: [Network; 3]) -> Result<Self, NnError> {
        Ok(Self {
            networks: Arc::new(Networks::new(networks)?),
            options: XMemOptions::default(),
        })
    }

    pub(super) fn walk<'a>(&'a self, progress: &'a Progress) -> Walk<'a> {
        Walk::new(&self.networks, &self.options, progress)
    }
}

impl Tracker for XMem {
    fn name(&self) -> &'static str {
        "xmem"
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
