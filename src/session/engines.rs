//! Construction of engines.

use std::sync::Arc;

use anyhow::{Result, bail, ensure};

use crate::TrackSettings;
use crate::engine_table::EngineId;
use crate::networks::{
    KeptSam, KeptTracker, KeptXFeat, TrackNetwork, failed_networks, grounding_dino, is_usable,
    sam_network, superglue_network, yolox,
};
use ostra_compute::nn::{Catalogue, Provider, models_folder};
use ostra_core::lists::in_words;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::graph_cut::BuiltinSegmenter;
use ostra_masks::{Segmenter, TextGrounder, Tracker};
use ostra_project::{
    EngineName, FeatureId, GrounderId, MatcherId, Project, RegistrationId, SegmenterId, TrackerId,
};
use ostra_reconstruct::rgbd::register::GlobalRegistration;
use ostra_reconstruct::sfm::matching::NearestMatcher;
use ostra_reconstruct::sfm::onnx::{
    Aliked, AlikedOptions, LightGlue, LightGlueFeatures, LightGlueOptions, LighterGlue,
    LighterGlueOptions, SuperGlue, SuperGlueOptions, SuperPoint, SuperPointOptions, XFeat,
    XFeatOptions,
};
use ostra_reconstruct::sfm::{FeatureExtractor, FeatureMatcher, Sift, SiftOptions};
use ostra_tracking::flow::{DenseFeatures, FlowTracker};
use ostra_tracking::{
    geometric_consistency::{ConsistencyOptions, ConsistencyTracker},
    reprojection::GeometryTracker,
    supervoxels::{FittingSegmenter, GeometrySegmenter},
};

/// Creates a segmenter for boxes and proposals on single frames; `auto` is the best installed one.
///
/// `geometry` is the geometry segmenter of the frames to be segmented.
///
/// # Errors
///
/// Returns an error if the segmenter is not installed.
pub fn segmenter(
    segmenter: SegmenterId,
    geometry: Arc<GeometrySegmenter>,
) -> Result<Arc<dyn Segmenter>> {
    Ok(made(segmenter.installed()?, geometry))
}

fn made(segmenter: SegmenterId, geometry: Arc<GeometrySegmenter>) -> Arc<dyn Segmenter> {
    use SegmenterId::{Auto, Builtin, Geometry, Sam, SamClose};
    match (segmenter, sam_network()) {
        (Auto | Sam | SamClose, Some(network)) => Arc::new(KeptSam {
            network,
            is_close: segmenter == SamClose,
        }),
        (Geometry, _) => geometry,
        (Auto | Sam | SamClose, None) | (Builtin, _) => Arc::new(BuiltinSegmenter),
    }
}

/// Creates a segmenter for clicks; `auto` is chosen for each click if some frames allow it.
///
/// # Errors
///
/// Returns an error if the segmenter is not installed.
pub fn click_segmenter(
    id: SegmenterId,
    geometry: Arc<GeometrySegmenter>,
) -> Result<Arc<dyn Segmenter>> {
    match fitting_segmenter(id, &geometry).filter(FittingSegmenter::has_choice) {
        Some(fitting) => Ok(Arc::new(fitting)),
        None => segmenter(id, geometry),
    }
}

/// Creates the segmenter that chooses for each click, if this is what the name stands for.
pub(crate) fn fitting_segmenter(
    id: SegmenterId,
    geometry: &Arc<GeometrySegmenter>,
) -> Option<FittingSegmenter> {
    let chooses = id == SegmenterId::Auto && sam_network().is_none();
    chooses.then(|| FittingSegmenter(Arc::clone(geometry)))
}

/// Creates the segmenter `geometry` for some frames.
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

/// Creates the segmenter for previews of clicks.
///
/// It is the given one, unless that encodes the image for every click. A faster one then replaces
/// it.
pub(crate) fn previewer(
    segmenter: SegmenterId,
    geometry: Arc<GeometrySegmenter>,
) -> Result<Arc<dyn Segmenter>> {
    let segmenter = match segmenter.installed()? {
        SegmenterId::SamClose => SegmenterId::Sam,
        segmenter => segmenter,
    };
    Ok(made(segmenter, geometry))
}

/// Creates a grounder; its network is loaded on this thread at its first use.
pub(crate) fn grounder(grounder: GrounderId) -> Result<Arc<dyn TextGrounder>> {
    let grounder = match grounder.installed()? {
        // The grounder without a fixed vocabulary is preferred.
        GrounderId::Auto if GrounderId::GroundingDino.is_installed() => GrounderId::GroundingDino,
        GrounderId::Auto => GrounderId::Yolox,
        grounder => grounder,
    };
    Ok(match grounder {
        GrounderId::Yolox => yolox()?,
        GrounderId::Auto | GrounderId::GroundingDino => grounding_dino()?,
    })
}

/// Returns the number of frames that keep `auto` from using the depth of the others.
///
/// Stereo depth of only some frames does not help on the frames in between. Holes in the depth of
/// a sensor are filled from other frames.
pub(crate) fn frames_without_stereo_depth(project: &Project) -> usize {
    let frames = &project.frames;
    if frames.iter().any(Frame::has_sensor_depth) || !frames.iter().any(Frame::has_posed_depth) {
        return 0;
    }
    frames
        .iter()
        .filter(|frame| !frame.has_posed_depth())
        .count()
}

/// Creates the tracker of the settings; `auto` is the best installed one that the frames allow.
pub fn tracker(settings: &TrackSettings, project: &Project) -> Result<Box<dyn Tracker>> {
    let requested = settings.tracker.installed()?;
    let (frames, any) = (
        &project.frames,
        project.frames.iter().any(Frame::has_posed_depth),
    );
    let tracker = match requested {
        TrackerId::Auto if any && frames_without_stereo_depth(project) == 0 => TrackerId::Geometry,
        // On videos, networks are far better than optical flow.
        TrackerId::Auto => [TrackerId::XMem, TrackerId::Deaot]
            .into_iter()
            .find(|network| network.is_installed())
            .unwrap_or(TrackerId::Flow),
        tracker => tracker,
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
        "networks take images with 64 to 4096 pixels along the shorter side; choose another number"
    );
    ensure!(
        seen.is_none() || tracker.has_image_size(),
        "only {} take images in another size, not '{}'; name one of them, or choose no size",
        in_words(
            TrackerId::names_with_image_size().map(|name| format!("'{name}'")),
            "and"
        ),
        tracker.name()
    );
    let tracker: Box<dyn Tracker> = match tracker {
        TrackerId::Flow => Box::new(flow_tracker()),
        TrackerId::XMem => Box::new(KeptTracker {
            network: TrackNetwork::XMem,
            seen,
        }),
        TrackerId::Deaot => Box::new(KeptTracker {
            network: TrackNetwork::Deaot,
            seen,
        }),
        TrackerId::Auto | TrackerId::Geometry => {
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

/// Creates the flow tracker, which uses XFeat for its memory if that can be used.
pub(crate) fn flow_tracker() -> FlowTracker {
    let features = is_usable("xfeat").then(|| Arc::new(KeptXFeat) as Arc<dyn DenseFeatures>);
    FlowTracker {
        features,
        ..FlowTracker::default()
    }
}

/// Creates a feature extractor for images reduced to `max_side` pixels.
///
/// `Auto` is SIFT, the most accurate.
pub(crate) fn extractor(
    features: FeatureId,
    max_side: Option<u32>,
) -> Result<Box<dyn FeatureExtractor>> {
    let side = |standard: usize| max_side.map_or(standard, |side| side as usize);
    Ok(match features.installed()? {
        FeatureId::XFeat => {
            let standard = XFeatOptions::default();
            let options = XFeatOptions {
                max_side: side(standard.max_side),
                ..standard
            };
            Box::new(XFeat::load(&models_folder()?, options)?)
        }
        FeatureId::SuperPoint => {
            let standard = SuperPointOptions::default();
            let options = SuperPointOptions {
                max_side: side(standard.max_side),
                ..standard
            };
            Box::new(SuperPoint::load(&models_folder()?, options)?)
        }
        FeatureId::Aliked => {
            let standard = AlikedOptions::default();
            let options = AlikedOptions {
                max_side: side(standard.max_side),
                ..standard
            };
            Box::new(Aliked::load(&models_folder()?, options)?)
        }
        FeatureId::Auto | FeatureId::Sift => {
            let standard = SiftOptions::default();
            Box::new(Sift::new(SiftOptions {
                max_side: max_side.unwrap_or(standard.max_side),
                ..standard
            }))
        }
    })
}

/// Creates a matcher for the features of an extractor.
///
/// `Auto` is the network trained for these features, if it is installed. SIFT is matched by nearest
/// neighbours, which are faster and enough for most images; [`second_matcher`] is for the others.
pub(crate) fn matcher(matcher: MatcherId, features: FeatureId) -> Result<Box<dyn FeatureMatcher>> {
    let requested = matcher.installed()?;
    let features = features.installed()?;
    let trained = network_for(features);
    let is_sift = matches!(features, FeatureId::Auto | FeatureId::Sift);
    let wanted = match requested {
        MatcherId::Auto if is_sift => MatcherId::Nearest,
        MatcherId::Auto if trained.is_installed() => trained,
        MatcherId::Auto => MatcherId::Nearest,
        requested => requested,
    };
    if wanted != MatcherId::Nearest && wanted != trained {
        let theirs = match requested {
            MatcherId::SuperGlue => FeatureId::SuperPoint,
            MatcherId::SiftLightGlue => FeatureId::Sift,
            MatcherId::AlikedLightGlue => FeatureId::Aliked,
            MatcherId::Auto | MatcherId::Nearest | MatcherId::LighterGlue => FeatureId::XFeat,
        }
        .name();
        bail!("'{matcher}' matches features of {theirs}; choose --features {theirs}");
    }
    if wanted == MatcherId::Nearest {
        return Ok(Box::new(if is_sift {
            NearestMatcher::for_bytes()
        } else {
            NearestMatcher::for_floats()
        }));
    }
    matching_network(wanted)
}

/// A matcher that may find more than nearest neighbours.
pub(crate) enum SecondMatcher {
    /// Another matcher was requested, or the network failed its test.
    None,
    /// Its network, of this name, is not installed.
    Missing(&'static str),
    /// It can be used.
    Ready(Box<dyn FeatureMatcher>),
}

/// Creates the matcher that `auto` tries where nearest neighbours find too little.
pub(crate) fn second_matcher(matcher: MatcherId, features: FeatureId) -> Result<SecondMatcher> {
    let is_sift = matches!(features, FeatureId::Auto | FeatureId::Sift);
    if matcher != MatcherId::Auto || !is_sift {
        return Ok(SecondMatcher::None);
    }
    let network = network_for(features);
    if network.is_installed() {
        return Ok(SecondMatcher::Ready(matching_network(network)?));
    }
    let name = network.name();
    Ok(if failed_networks(&[name]).is_empty() {
        SecondMatcher::Missing(name)
    } else {
        SecondMatcher::None
    })
}

/// Returns the matcher that was trained for some features.
fn network_for(features: FeatureId) -> MatcherId {
    match features {
        FeatureId::Auto | FeatureId::Sift => MatcherId::SiftLightGlue,
        FeatureId::XFeat => MatcherId::LighterGlue,
        FeatureId::SuperPoint => MatcherId::SuperGlue,
        FeatureId::Aliked => MatcherId::AlikedLightGlue,
    }
}

/// Loads the network of a matcher.
fn matching_network(matcher: MatcherId) -> Result<Box<dyn FeatureMatcher>> {
    let folder = models_folder()?;
    let light_glue = |features| LightGlue::load(&folder, features, LightGlueOptions::default());
    Ok(match matcher {
        MatcherId::SiftLightGlue => Box::new(light_glue(LightGlueFeatures::Sift)?),
        MatcherId::AlikedLightGlue => Box::new(light_glue(LightGlueFeatures::Aliked)?),
        MatcherId::LighterGlue => {
            Box::new(LighterGlue::load(&folder, LighterGlueOptions::default())?)
        }
        MatcherId::Auto | MatcherId::Nearest | MatcherId::SuperGlue => {
            let network = superglue_network().unwrap_or("superglue-outdoor");
            Box::new(SuperGlue::load(
                &folder,
                network,
                SuperGlueOptions::default(),
            )?)
        }
    })
}

/// Returns a text that identifies an extractor or matcher in the cache.
///
/// It differs for engines that may find other features or matches in the same images. It contains
/// the program version, the execution provider of networks, and the size and time of the network
/// files.
pub(crate) fn identity(engine: &str, settings: &str) -> String {
    let files = || {
        let (catalogue, folder) = (Catalogue::load().ok()?, models_folder().ok()?);
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

/// Returns the registration of fragments of an RGB-D recording; `None` tries all in turn.
#[must_use]
pub fn registration(registration: RegistrationId) -> Option<GlobalRegistration> {
    match registration {
        RegistrationId::Auto => None,
        RegistrationId::Fgr => Some(GlobalRegistration::Fgr),
        RegistrationId::Ransac => Some(GlobalRegistration::Ransac),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::frames_without_stereo_depth;
    use ostra_frames::DepthSource;
    use ostra_project::Project;
    use ostra_project::testing::{camera, frame};

    fn project(depths: [bool; 3]) -> Project {
        let frames = depths.map(|has_depth| {
            let mut frame = frame("a.png");
            frame.camera = Some(camera(0.0));
            frame.depth = has_depth.then(|| DepthSource::Estimated {
                made: "depths/a.tif".into(),
                scale: 1.0,
            });
            frame
        });
        Project {
            frames: Arc::new(frames.to_vec()),
            ..Project::default()
        }
    }

    #[test]
    fn only_stereo_depth_of_some_frames_keeps_auto_from_reprojection() {
        assert_eq!(frames_without_stereo_depth(&project([true; 3])), 0);
        assert_eq!(frames_without_stereo_depth(&project([false; 3])), 0);
        assert_eq!(
            frames_without_stereo_depth(&project([true, false, false])),
            2
        );
    }
}
