//! Networks that the first job that needs them loads, so that the window never waits for one.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

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

/// A network that is loaded at its first use, on that thread, and kept until the program ends.
struct Kept<T>(Mutex<Option<Arc<T>>>);

impl<T> Kept<T> {
    const fn new() -> Self {
        Self(Mutex::new(None))
    }

    fn get(&self, load: impl FnOnce() -> Result<T, NnError>) -> Result<Arc<T>, MaskError> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(network) = kept.as_ref() {
            return Ok(Arc::clone(network));
        }
        let network = Arc::new(load().map_err(|error| MaskError::Network(error.to_string()))?);
        *kept = Some(Arc::clone(&network));
        Ok(network)
    }
}

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

/// The network of `sam` that was used last.
///
/// Another is loaded when a better one or another variant was installed meanwhile.
static SAM: Mutex<Option<KeptSamNetwork>> = Mutex::new(None);

struct KeptSamNetwork {
    name: &'static str,
    /// Sizes and times of its files.
    files: Vec<FileStamp>,
    sam: Arc<Sam>,
}

/// Size and time of a file.
type FileStamp = (u64, Option<SystemTime>);

/// Returns a network of `sam`, and loads it if another one is kept.
fn sam(name: &'static str) -> Result<Arc<Sam>, MaskError> {
    let unusable = |error: NnError| MaskError::Network(error.to_string());
    let files = stamps(name).map_err(unusable)?;
    let mut kept = SAM.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(kept) = kept.as_ref()
        && kept.name == name
        && kept.files == files
    {
        return Ok(Arc::clone(&kept.sam));
    }
    let load = || Sam::load(&models_folder()?, name);
    let sam = Arc::new(load().map_err(unusable)?);
    *kept = Some(KeptSamNetwork {
        name,
        files,
        sam: Arc::clone(&sam),
    });
    Ok(sam)
}

/// Returns size and time of the files of an installed network.
fn stamps(name: &str) -> Result<Vec<FileStamp>, NnError> {
    let (catalogue, folder) = (Catalogue::load()?, models_folder()?);
    let installed = catalogue.entry(name)?.installed(&folder);
    let paths = installed.map(|installed| installed.paths);
    let stamp = |path: &PathBuf| {
        let about = std::fs::metadata(path).ok();
        let modified = about.as_ref().and_then(|about| about.modified().ok());
        (about.map_or(0, |about| about.len()), modified)
    };
    Ok(paths.iter().flatten().map(stamp).collect())
}

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
        let sam = sam(self.network)?;
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
    Ok(YOLOX.get(|| Yolox::load(&models_folder()?))?)
}

/// Returns Grounding DINO, and loads it at its first use.
pub(crate) fn grounding_dino() -> Result<Arc<dyn TextGrounder>, MaskError> {
    Ok(GROUNDING_DINO.get(|| GroundingDino::load(&models_folder()?))?)
}

/// XFeat, loaded at its first use.
#[derive(Debug)]
pub(crate) struct KeptXFeat;

impl DenseFeatures for KeptXFeat {
    fn feature_map(&self, grey: &[f32], size: ImageSize) -> Result<FeatureMap, MaskError> {
        XFEAT
            .get(|| XFeatCells::load(&models_folder()?))?
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
                let mut xmem = XMem::clone(&*XMEM.get(|| XMem::load(&models_folder()?))?);
                xmem.options.short_side = self
                    .seen
                    .map_or(xmem.options.short_side, |(side, _)| Some(side));
                xmem.track(request, emit, progress)
            }
            TrackNetwork::Deaot => {
                let mut deaot = Deaot::clone(&*DEAOT.get(|| Deaot::load(&models_folder()?))?);
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
/// A network that gave wrong answers in its test does not count.
pub(crate) fn is_usable(network: &str) -> bool {
    let is_installed = || {
        let (catalogue, folder) = (Catalogue::load().ok()?, models_folder().ok()?);
        let entry = catalogue.entry(network).ok()?;
        entry.installed(&folder)?;
        Some(!matches!(
            entry.tested(&folder),
            Some(TestResult::Failed(_))
        ))
    };
    is_installed() == Some(true) && Runtime::find().is_ok()
}

/// Returns those of some networks that are installed but gave wrong answers, with what was wrong.
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
