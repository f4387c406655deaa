//! The table of engines: which there are, what they need, and how they are made.

use std::sync::Arc;

use anyhow::{Result, bail, ensure};

use super::TrackSettings;
use super::networks::{
    KeptSam, KeptTracker, KeptXFeat, SAM_NETWORKS, TrackNetwork, grounding_dino, yolox,
};
use ostra_compute::nn::{Catalogue, Provider, Runtime, models_folder};
use ostra_frames::{Frame, FrameStore};
use ostra_masks::builtin::BuiltinSegmenter;
use ostra_masks::{Segmenter, TextGrounder, Tracker};
use ostra_project::Project;
use ostra_reconstruct::rgbd::register::GlobalRegistration;
use ostra_reconstruct::sfm::matching::NearestMatcher;
use ostra_reconstruct::sfm::onnx::{
    LighterGlue, LighterGlueOptions, SuperGlue, SuperGlueOptions, SuperPoint, SuperPointOptions,
    XFeat, XFeatOptions,
};
use ostra_reconstruct::sfm::{FeatureExtractor, FeatureMatcher, Sift, SiftOptions};
use ostra_tracking::flow::{DenseFeatures, FlowTracker};
use ostra_tracking::{
    geometric_consistency::{ConsistencyOptions, ConsistencyTracker},
    reprojection::GeometryTracker,
    supervoxels::GeometrySegmenter,
};

/// What an engine is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EngineKind {
    /// Turns prompts into masks.
    Segmenter,
    /// Finds what words name.
    Grounder,
    /// Carries masks through the sequence.
    Tracker,
    /// Finds keypoints in pictures.
    Features,
    /// Matches keypoints of two pictures.
    Matcher,
}

impl EngineKind {
    fn noun(self) -> &'static str {
        match self {
            Self::Segmenter => "segmenter",
            Self::Grounder => "grounder",
            Self::Tracker => "tracker",
            Self::Features => "feature extractor",
            Self::Matcher => "matcher",
        }
    }
}

/// A segmenter or tracker as lists show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Engine {
    /// What it is for.
    pub kind: EngineKind,
    /// Its name on the command line.
    pub name: &'static str,
    /// Whether it can be used now.
    pub installed: bool,
    /// What it needs: of the frames where it is installed, to be used at all where it is not.
    pub needs: &'static str,
}

/// Every engine that the command line names, `auto` first within its kind.
#[must_use]
pub fn list_engines() -> Vec<Engine> {
    const NETWORKS: &str = "its networks and ONNX Runtime; add both with 'ostra models add'";
    const SAM: &str = "the networks sam-vit-b, mobile-sam or efficient-sam and ONNX Runtime; add both with 'ostra models add'";
    const GROUNDER: &str =
        "the networks grounding-dino or yolox and ONNX Runtime; add both with 'ostra models add'";
    const GROUNDING_DINO: &str =
        "the network grounding-dino and ONNX Runtime; add both with 'ostra models add'";
    const YOLOX: &str = "the network yolox and ONNX Runtime; add both with 'ostra models add'";
    const LIGHTERGLUE: &str =
        "features of xfeat, its network and ONNX Runtime; add both with 'ostra models add'";
    const SUPERGLUE: &str = "features of superpoint, the network superglue-outdoor or superglue-indoor and ONNX Runtime; \
                             add them with 'ostra models add'";
    const FEATURES: &str = "its network and ONNX Runtime; add both with 'ostra models add'";
    let segmenter = |name, installed, needs| Engine {
        kind: EngineKind::Segmenter,
        name,
        installed,
        needs,
    };
    let grounder = |name, installed, needs| Engine {
        kind: EngineKind::Grounder,
        name,
        installed,
        needs,
    };
    let tracker = |name, installed, needs| Engine {
        kind: EngineKind::Tracker,
        name,
        installed,
        needs,
    };
    let features = |name, installed, needs| Engine {
        kind: EngineKind::Features,
        name,
        installed,
        needs,
    };
    let matcher = |name, installed, needs| Engine {
        kind: EngineKind::Matcher,
        name,
        installed,
        needs,
    };
    vec![
        segmenter("auto", true, "nothing; takes the best that is installed"),
        segmenter("sam", sam_network().is_some(), SAM),
        segmenter("sam-close", sam_network().is_some(), SAM),
        segmenter(
            "geometry",
            true,
            "depth and cameras of several frames; takes thin things by the picture alone",
        ),
        segmenter("builtin", true, "nothing"),
        grounder("auto", GROUNDERS.into_iter().any(is_usable), GROUNDER),
        grounder(
            "grounding-dino",
            is_usable("grounding-dino"),
            GROUNDING_DINO,
        ),
        grounder("yolox", is_usable("yolox"), YOLOX),
        tracker("auto", true, "what the tracker it takes needs"),
        tracker("xmem", is_usable("xmem"), NETWORKS),
        tracker("deaot", is_usable("deaot"), NETWORKS),
        tracker("geometry", true, "depth and cameras of the frames"),
        tracker(
            "flow",
            true,
            "nothing; remembers better by the network xfeat",
        ),
        features("auto", true, "nothing; takes sift, the most accurate"),
        features("sift", true, "nothing"),
        features("xfeat", is_usable("xfeat"), FEATURES),
        features("superpoint", is_usable("superpoint"), FEATURES),
        matcher("auto", true, "what the matcher it takes needs"),
        matcher("nearest", true, "nothing"),
        matcher("lighterglue", is_usable("lighterglue"), LIGHTERGLUE),
        matcher("superglue", superglue_network().is_some(), SUPERGLUE),
    ]
}

/// Refuses a name that is no engine, or one that is not installed, in one line that says what it needs.
pub(super) fn check_installed(kind: EngineKind, name: &str) -> Result<()> {
    let all = list_engines();
    let mut of_kind = all.iter().filter(|engine| engine.kind == kind);
    match of_kind.clone().find(|engine| engine.name == name) {
        Some(engine) if engine.installed => Ok(()),
        Some(engine) => bail!("'{name}' is not installed: it needs {}", engine.needs),
        None => {
            let what = kind.noun();
            let names = of_kind
                .by_ref()
                .map(|engine| engine.name)
                .collect::<Vec<_>>()
                .join(", ");
            bail!("there is no {what} '{name}'; choose one of {names}")
        }
    }
}

/// The segmenter of this name; `auto` is the best that is installed, `geometry` the one of the frames to be
/// segmented.
pub fn segmenter(name: &str, geometry: Arc<GeometrySegmenter>) -> Result<Arc<dyn Segmenter>> {
    check_installed(EngineKind::Segmenter, name)?;
    let sam = |network| {
        Arc::new(KeptSam {
            network,
            is_close: name == "sam-close",
        })
    };
    Ok(match (name, sam_network()) {
        ("auto" | "sam" | "sam-close", Some(network)) => sam(network),
        ("geometry", _) => geometry,
        _ => Arc::new(BuiltinSegmenter),
    })
}

/// The segmenter `geometry` for some frames.
pub fn geometry_segmenter(
    frames: Arc<Vec<Frame>>,
    store: Arc<FrameStore>,
) -> Arc<GeometrySegmenter> {
    Arc::new(GeometrySegmenter::new(
        frames,
        store,
        Arc::new(BuiltinSegmenter),
    ))
}

/// The segmenter that shows what a click would give before it is made: the one of this name, but for one that works hard
/// for each place anew.
pub(super) fn previewer(
    name: &str,
    geometry: Arc<GeometrySegmenter>,
) -> Result<Arc<dyn Segmenter>> {
    segmenter(if name == "sam-close" { "sam" } else { name }, geometry)
}

/// The first network behind `sam` that can be used.
fn sam_network() -> Option<&'static str> {
    SAM_NETWORKS.into_iter().find(|network| is_usable(network))
}

/// What finds things by words; its network is loaded, on this thread, where it was not needed before.
pub(super) fn grounder(name: &str) -> Result<Arc<dyn TextGrounder>> {
    check_installed(EngineKind::Grounder, name)?;
    let best = GROUNDERS
        .into_iter()
        .find(|network| name == "auto" && is_usable(network));
    Ok(match best.unwrap_or(name) {
        "yolox" => yolox()?,
        _ => grounding_dino()?,
    })
}

/// Networks that find things by words, the one that knows any words first.
const GROUNDERS: [&str; 2] = ["grounding-dino", "yolox"];

/// The tracker that the settings name; `auto` is the best that is installed and that the frames allow.
pub fn tracker(settings: &TrackSettings, project: &Project) -> Result<Box<dyn Tracker>> {
    check_installed(EngineKind::Tracker, &settings.tracker)?;
    let (frames, any) = (
        &project.frames,
        project.frames.iter().any(Frame::has_posed_depth),
    );
    // Depth made of some frames alone says nothing of those between.
    let everywhere =
        frames.iter().any(Frame::has_sensor_depth) || frames.iter().all(Frame::has_posed_depth);
    let name = match settings.tracker.as_str() {
        "auto" if any && everywhere => "geometry",
        // On films networks are far ahead of flow.
        "auto" => ["xmem", "deaot"]
            .into_iter()
            .find(|network| is_usable(network))
            .unwrap_or("flow"),
        name => name,
    };
    let longer = |frame: &Frame| {
        f64::from(frame.width.max(frame.height)) / f64::from(frame.width.min(frame.height))
    };
    let seen = settings
        .short_side
        .map(|side| (side, frames.first().map_or(1.0, longer)));
    ensure!(
        settings
            .short_side
            .is_none_or(|side| (64..=4096).contains(&side)),
        "networks see pictures with 64 to 4096 pixels along the shorter side; choose another number"
    );
    ensure!(
        seen.is_none() || matches!(name, "xmem" | "deaot"),
        "only 'xmem' and 'deaot' see pictures in another size, not '{name}'; name one of them, or choose no size"
    );
    let tracker: Box<dyn Tracker> = match name {
        "flow" => Box::new(flow_tracker()),
        "xmem" => Box::new(KeptTracker {
            network: TrackNetwork::XMem,
            seen,
        }),
        "deaot" => Box::new(KeptTracker {
            network: TrackNetwork::Deaot,
            seen,
        }),
        _ => {
            ensure!(
                any,
                "'geometry' needs frames with depth and cameras; add both first, or track with 'flow'"
            );
            return Ok(Box::new(GeometryTracker::default()));
        }
    };
    if !settings.constrain {
        return Ok(tracker);
    }
    ensure!(
        any,
        "--constrain needs frames with depth and cameras; add or reconstruct both first, or track without it"
    );
    Ok(Box::new(ConsistencyTracker {
        tracker,
        options: ConsistencyOptions::default(),
    }))
}

/// The flow tracker, which remembers by XFeat where that can be used.
pub(super) fn flow_tracker() -> FlowTracker {
    let features = is_usable("xfeat").then(|| Arc::new(KeptXFeat) as Arc<dyn DenseFeatures>);
    FlowTracker {
        features,
        ..FlowTracker::default()
    }
}

/// The first network behind `superglue` that can be used: what is photographed is mostly outdoors, or looks like it.
fn superglue_network() -> Option<&'static str> {
    ["superglue-outdoor", "superglue-indoor"]
        .into_iter()
        .find(|network| is_usable(network))
}

/// The feature extractor of this name; longer sides than `max_side` pixels are worked on at that size. `auto` is SIFT,
/// the most accurate.
pub(super) fn extractor(name: &str, max_side: Option<u32>) -> Result<Box<dyn FeatureExtractor>> {
    check_installed(EngineKind::Features, name)?;
    let side = |standard: usize| max_side.map_or(standard, |side| side as usize);
    Ok(match name {
        "xfeat" => {
            let standard = XFeatOptions::default();
            let options = XFeatOptions {
                max_side: side(standard.max_side),
                ..standard
            };
            Box::new(XFeat::load(&models_folder()?, options)?)
        }
        "superpoint" => {
            let standard = SuperPointOptions::default();
            let options = SuperPointOptions {
                max_side: side(standard.max_side),
                ..standard
            };
            Box::new(SuperPoint::load(&models_folder()?, options)?)
        }
        _ => {
            let standard = SiftOptions::default();
            Box::new(Sift {
                options: SiftOptions {
                    max_side: max_side.unwrap_or(standard.max_side),
                    ..standard
                },
            })
        }
    })
}

/// The matcher of this name for features of an extractor; `auto` is the network made for them where it is installed.
pub(super) fn matcher(name: &str, features: &str) -> Result<Box<dyn FeatureMatcher>> {
    check_installed(EngineKind::Matcher, name)?;
    let made_for = match features {
        "xfeat" => Some("lighterglue"),
        "superpoint" => Some("superglue"),
        _ => None,
    };
    let wanted = match name {
        "auto" => made_for.filter(|network| check_installed(EngineKind::Matcher, network).is_ok()),
        "nearest" => None,
        network => Some(network),
    };
    if wanted.is_some() && wanted != made_for {
        let theirs = if name == "superglue" {
            "superpoint"
        } else {
            "xfeat"
        };
        bail!("'{name}' matches features of {theirs}; choose --features {theirs}");
    }
    Ok(match wanted {
        Some("lighterglue") => Box::new(LighterGlue::load(
            &models_folder()?,
            LighterGlueOptions::default(),
        )?),
        Some(_) => {
            let network = superglue_network().unwrap_or("superglue-outdoor");
            Box::new(SuperGlue::load(
                &models_folder()?,
                network,
                SuperGlueOptions::default(),
            )?)
        }
        None if made_for.is_some() => Box::new(NearestMatcher::for_floats()),
        None => Box::new(NearestMatcher::for_bytes()),
    })
}

/// Tells an extractor or matcher apart from others that would find other things in the same pictures: by the program, where
/// networks run, and the size and time of its networks' files.
pub(super) fn identity(engine: &str, settings: &str) -> String {
    let files = || {
        let (catalogue, folder) = (Catalogue::bundled().ok()?, models_folder().ok()?);
        let networks: &[&str] = if engine == "superglue" {
            &["superglue-outdoor", "superglue-indoor"]
        } else {
            &[engine]
        };
        let installed = networks
            .iter()
            .filter_map(|network| catalogue.entry(network).ok()?.installed(&folder));
        let stamp = |path: std::path::PathBuf| {
            let about = std::fs::metadata(&path).ok();
            (
                path,
                about.as_ref().map(std::fs::Metadata::len),
                about.and_then(|about| about.modified().ok()),
            )
        };
        Some(
            installed
                .flat_map(|installed| installed.paths)
                .map(stamp)
                .collect::<Vec<_>>(),
        )
    };
    format!(
        "{} {engine} {settings} {:?} {:?}",
        env!("CARGO_PKG_VERSION"),
        Provider::chosen(),
        files()
    )
}

/// Whether a network is installed, and with it what runs it.
fn is_usable(network: &str) -> bool {
    let installed = || {
        let (catalogue, folder) = (Catalogue::bundled().ok()?, models_folder().ok()?);
        catalogue.entry(network).ok()?.installed(&folder)
    };
    installed().is_some() && Runtime::find().is_ok()
}

/// How pieces of an RGB-D recording are joined, by name; `None` for `auto`.
///
/// # Errors
/// Where there is no such way.
pub fn registration(name: &str) -> Result<Option<GlobalRegistration>> {
    Ok(match name {
        "auto" => None,
        "fgr" => Some(GlobalRegistration::Fgr),
        "ransac" => Some(GlobalRegistration::Ransac),
        _ => bail!("there is no registration '{name}'; there is: auto, fgr, ransac"),
    })
}
