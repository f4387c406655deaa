//! Networks that the first job that needs them loads, so that the window never waits for one.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use crate::embeddings::Embeddings;
use ostra_compute::nn::{Catalogue, NnError, Runtime, TestResult, models_folder};
use ostra_core::image::ImageSize;
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Image};
use ostra_masks::onnx::Yolox;
use ostra_masks::onnx::grounding::GroundingDino;
use ostra_masks::onnx::sam::{CloseUps, ImagePart, Sam};
use ostra_masks::{
    MaskError, PreparedFrame, Segmenter, TextGrounder, TrackRequest, TrackedFrame, Tracker,
};
use ostra_tracking::XFeatCells;
use ostra_tracking::deaot::Deaot;
use ostra_tracking::flow::{DenseFeatures, FeatureMap};
use ostra_tracking::xmem::XMem;

/// A network that is loaded at its first use, on that thread, and kept.
///
/// Another one is loaded when another network or other files are to be used: a better one or another
/// variant may be installed meanwhile.
struct Kept<T>(Mutex<Option<KeptNetwork<T>>>);

struct KeptNetwork<T> {
    files: NetworkFiles,
    network: Arc<T>,
}

/// The files of an installed network.
#[derive(PartialEq)]
struct NetworkFiles {
    /// Name in the catalogue.
    name: &'static str,
    /// Sizes and times; none if it is not installed.
    stamps: Vec<String>,
}

impl NetworkFiles {
    fn of(name: &'static str) -> Result<Self, NnError> {
        let (catalogue, folder) = (Catalogue::load()?, models_folder()?);
        let installed = catalogue.entry(name)?.installed(&folder);
        let stamps = installed.map(|installed| installed.stamps());
        Ok(Self {
            name,
            stamps: stamps.unwrap_or_default(),
        })
    }
}

impl<T> Kept<T> {
    const fn new() -> Self {
        Self(Mutex::new(None))
    }

    /// Returns the network called `name`; `load` gets the folder of networks.
    fn get(
        &self,
        name: &'static str,
        load: impl FnOnce(&Path) -> Result<T, NnError>,
    ) -> Result<Arc<T>, MaskError> {
        Ok(self.of_files(NetworkFiles::of(name)?, || load(&models_folder()?))?)
    }

    fn of_files(
        &self,
        files: NetworkFiles,
        load: impl FnOnce() -> Result<T, NnError>,
    ) -> Result<Arc<T>, NnError> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = kept.as_ref().filter(|kept| kept.files == files) {
            return Ok(Arc::clone(&kept.network));
        }
        let network = Arc::new(load()?);
        *kept = Some(KeptNetwork {
            files,
            network: Arc::clone(&network),
        });
        Ok(network)
    }
}

static SAM: Kept<Sam> = Kept::new();
static YOLOX: Kept<Yolox> = Kept::new();
static GROUNDING_DINO: Kept<GroundingDino> = Kept::new();
static XMEM: Kept<XMem> = Kept::new();
static DEAOT: Kept<Deaot> = Kept::new();
static XFEAT: Kept<XFeatCells> = Kept::new();

/// Networks of the segmenter `sam`, the most accurate first.
pub(crate) const SAM_NETWORKS: [&str; 7] = [
    "sam2.1-large",
    "sam2.1-base-plus",
    "sam2.1-small",
    "sam2.1-tiny",
    "sam-vit-b",
    "mobile-sam",
    "efficient-sam",
];

/// Segment Anything with the first of its networks that is installed.
pub(crate) struct KeptSam {
    /// Name of the network in the catalogue.
    pub(crate) network: &'static str,
    /// Whether a crop around each prompt is encoded instead of the whole image once.
    pub(crate) is_close: bool,
}

impl Segmenter for KeptSam {
    fn name(&self) -> &'static str {
        if self.is_close { "sam-close" } else { "sam" }
    }

    fn prepare(
        &self,
        image: &Arc<Image>,
        _depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        let sam = SAM.get(self.network, |folder| Sam::load(folder, self.network))?;
        if self.is_close {
            return Ok(Arc::new(CloseUps::new(sam, Arc::clone(image))));
        }
        let embed = || sam.embed(image, ImagePart::whole(image.width, image.height), progress);
        let embedding = match Embeddings::ours() {
            Some(kept) => kept.get(sam.encoder(), image, embed)?,
            None => embed()?,
        };
        Ok(Arc::new(sam.frame(&embedding)?))
    }
}

/// Returns YOLOX, and loads it at its first use.
pub(crate) fn yolox() -> Result<Arc<dyn TextGrounder>, MaskError> {
    Ok(YOLOX.get("yolox", Yolox::load)?)
}

/// Returns Grounding DINO, and loads it at its first use.
pub(crate) fn grounding_dino() -> Result<Arc<dyn TextGrounder>, MaskError> {
    Ok(GROUNDING_DINO.get("grounding-dino", GroundingDino::load)?)
}

/// XFeat, loaded at its first use.
#[derive(Debug)]
pub(crate) struct KeptXFeat;

impl DenseFeatures for KeptXFeat {
    fn feature_map(&self, grey: &[f32], size: ImageSize) -> Result<FeatureMap, MaskError> {
        XFEAT
            .get("xfeat", XFeatCells::load)?
            .feature_map(grey, size)
    }
}

/// A network that propagates masks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TrackNetwork {
    XMem,
    Deaot,
}

/// A tracker whose network is loaded when it first tracks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct KeptTracker {
    pub(crate) network: TrackNetwork,
    /// Shorter side of the images in pixels, and the aspect ratio (longer / shorter side).
    ///
    /// `None` means the size with which the network was evaluated.
    pub(crate) seen: Option<(u32, f64)>,
}

impl Tracker for KeptTracker {
    fn name(&self) -> &'static str {
        match self.network {
            TrackNetwork::XMem => "xmem",
            TrackNetwork::Deaot => "deaot",
        }
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        match self.network {
            TrackNetwork::XMem => {
                let mut xmem = XMem::clone(&*XMEM.get("xmem", XMem::load)?);
                xmem.options.short_side = self
                    .seen
                    .map_or(xmem.options.short_side, |(side, _)| Some(side));
                xmem.track(request, emit, progress)
            }
            TrackNetwork::Deaot => {
                let mut deaot = Deaot::clone(&*DEAOT.get("deaot", Deaot::load)?);
                let longest = self
                    .seen
                    .map(|(side, longer)| (f64::from(side) * longer).round() as u32);
                deaot.options.longest_side = longest.unwrap_or(deaot.options.longest_side);
                deaot.track(request, emit, progress)
            }
        }
    }
}

/// Returns whether a network and ONNX Runtime are installed.
///
/// A network that failed its test does not count.
pub(crate) fn is_usable(network: &str) -> bool {
    let is_there = || {
        let (catalogue, folder) = (Catalogue::load().ok()?, models_folder().ok()?);
        Some(catalogue.entry(network).ok()?.is_usable(&folder))
    };
    is_there() == Some(true) && Runtime::find().is_ok()
}

/// Returns those of some networks that are installed but failed their tests, with what was wrong.
pub(crate) fn failed_networks(networks: &[&'static str]) -> Vec<(&'static str, String)> {
    let (Ok(catalogue), Ok(folder)) = (Catalogue::load(), models_folder()) else {
        return Vec::new();
    };
    let failed = |&network: &&'static str| match catalogue.entry(network).ok()?.tested(&folder) {
        Some(TestResult::Failed(what)) => Some((network, what)),
        _ => None,
    };
    networks.iter().filter_map(failed).collect()
}

/// Returns the first network of `sam` that can be used.
pub(crate) fn sam_network() -> Option<&'static str> {
    SAM_NETWORKS.into_iter().find(|network| is_usable(network))
}

/// Returns the first network of `superglue` that can be used.
///
/// The outdoor one is preferred, because most images are taken outdoors or resemble outdoor images.
pub(crate) fn superglue_network() -> Option<&'static str> {
    ["superglue-outdoor", "superglue-indoor"]
        .into_iter()
        .find(|network| is_usable(network))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn network_is_loaded_again_when_another_or_other_files_are_to_be_used() {
        let kept = Kept::new();
        let of = |name, stamp: &str, load: Result<u8, NnError>| {
            let stamps = vec![stamp.to_owned()];
            kept.of_files(NetworkFiles { name, stamps }, || load)
        };
        assert_eq!(*of("a", "1", Ok(1)).unwrap(), 1);
        assert_eq!(*of("a", "1", Ok(2)).unwrap(), 1, "kept");
        assert_eq!(*of("a", "2", Ok(3)).unwrap(), 3, "other files");
        assert_eq!(*of("b", "2", Ok(4)).unwrap(), 4, "another network");
        let broken = NnError::Request("removed".into());
        assert!(of("b", "", Err(broken)).is_err());
    }
}
