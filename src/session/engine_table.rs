//! The table of engines, with their requirements and availability.

use anyhow::{Result, bail};

use crate::networks::{SAM_NETWORKS, failed_networks, is_usable, sam_network, superglue_network};
use ostra_project::{EngineName, FeatureId, GrounderId, MatcherId, SegmenterId, TrackerId};

/// Purpose of an engine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EngineKind {
    /// Turns prompts into masks.
    Segmenter,
    /// Finds objects by text.
    Grounder,
    /// Propagates masks through the sequence.
    Tracker,
    /// Detects keypoints in images.
    Features,
    /// Matches keypoints of two images.
    Matcher,
}

/// An engine, as shown in lists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EngineInfo {
    /// Purpose of the engine.
    pub kind: EngineKind,
    /// Name on the command line.
    pub name: &'static str,
    /// Whether it can be used now.
    pub installed: bool,
    /// Requirements: on the frames if it is installed, or for its installation otherwise.
    pub needs: &'static str,
}

/// A row of the table of engines.
pub(crate) struct EngineSpec<I> {
    id: I,
    /// Requirements: on the frames if it is installed, or for its installation otherwise.
    needs: &'static str,
    is_installed: fn() -> bool,
    /// Networks of which it needs one or all.
    networks: &'static [&'static str],
}

/// The engines of one kind.
pub(crate) trait EngineId: EngineName {
    const KIND: EngineKind;

    /// The rows of the table, one for each engine, `auto` first.
    const TABLE: &'static [EngineSpec<Self>];

    /// Returns the engine itself if it can be used.
    ///
    /// # Errors
    ///
    /// Returns an error if it is not installed. The message states what it needs.
    fn installed(self) -> Result<Self> {
        match self.spec() {
            Some(spec) if !(spec.is_installed)() => {
                let failed: String = failed_networks(spec.networks)
                    .iter()
                    .map(|(network, what)| {
                        format!("; {network} is installed, but failed its test ({what})")
                    })
                    .collect();
                bail!(
                    "'{}' is not installed: it needs {}{failed}",
                    self.name(),
                    spec.needs
                )
            }
            _ => Ok(self),
        }
    }

    fn spec(self) -> Option<&'static EngineSpec<Self>> {
        Self::TABLE.iter().find(|spec| spec.id == self)
    }

    fn is_installed(self) -> bool {
        self.spec().is_some_and(|spec| (spec.is_installed)())
    }

    /// Returns the rows, as shown in lists.
    fn list() -> impl Iterator<Item = EngineInfo> {
        Self::TABLE.iter().map(|spec| EngineInfo {
            kind: Self::KIND,
            name: spec.id.name(),
            installed: (spec.is_installed)(),
            needs: spec.needs,
        })
    }
}

const fn spec<I>(id: I, needs: &'static str, is_installed: fn() -> bool) -> EngineSpec<I> {
    network_spec(id, needs, &[], is_installed)
}

/// A row of an engine that needs networks.
const fn network_spec<I>(
    id: I,
    needs: &'static str,
    networks: &'static [&'static str],
    is_installed: fn() -> bool,
) -> EngineSpec<I> {
    EngineSpec {
        id,
        needs,
        is_installed,
        networks,
    }
}

fn always() -> bool {
    true
}

const SAM: &str = "a Segment Anything network (mobile-sam, sam-vit-b, sam2.1-tiny …) and ONNX Runtime; get both with 'ostra models install'";

impl EngineId for SegmenterId {
    const KIND: EngineKind = EngineKind::Segmenter;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(
            Self::Auto,
            "nothing; takes an installed one that fits frame and click",
            always,
        ),
        network_spec(Self::Sam, SAM, &SAM_NETWORKS, || sam_network().is_some()),
        network_spec(Self::SamClose, SAM, &SAM_NETWORKS, || {
            sam_network().is_some()
        }),
        spec(
            Self::Geometry,
            "depth and cameras of several frames; segments thin objects by the image alone",
            always,
        ),
        spec(Self::Builtin, "nothing", always),
    ];
}

const GROUNDER: &str =
    "the networks grounding-dino or yolox and ONNX Runtime; get both with 'ostra models install'";
const GROUNDING_DINO: &str =
    "the network grounding-dino and ONNX Runtime; get both with 'ostra models install'";
const YOLOX: &str = "the network yolox and ONNX Runtime; get both with 'ostra models install'";

impl EngineId for GrounderId {
    const KIND: EngineKind = EngineKind::Grounder;
    const TABLE: &'static [EngineSpec<Self>] = &[
        network_spec(Self::Auto, GROUNDER, &["grounding-dino", "yolox"], || {
            is_usable("grounding-dino") || is_usable("yolox")
        }),
        network_spec(
            Self::GroundingDino,
            GROUNDING_DINO,
            &["grounding-dino"],
            || is_usable("grounding-dino"),
        ),
        network_spec(Self::Yolox, YOLOX, &["yolox"], || is_usable("yolox")),
    ];
}

const NETWORKS: &str = "its networks and ONNX Runtime; add both with 'ostra models add'";

impl EngineId for TrackerId {
    const KIND: EngineKind = EngineKind::Tracker;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(Self::Auto, "what the chosen tracker needs", always),
        network_spec(Self::XMem, NETWORKS, &["xmem"], || is_usable("xmem")),
        network_spec(Self::Deaot, NETWORKS, &["deaot"], || is_usable("deaot")),
        spec(Self::Geometry, "depth and cameras of the frames", always),
        spec(
            Self::Flow,
            "nothing; remembers better by the network xfeat",
            always,
        ),
    ];
}

const FEATURES: &str = "its network and ONNX Runtime; add both with 'ostra models add'";
const ALIKED: &str = "the network aliked and ONNX Runtime; get both with 'ostra models install'";

impl EngineId for FeatureId {
    const KIND: EngineKind = EngineKind::Features;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(Self::Auto, "nothing; takes sift, the most accurate", always),
        spec(Self::Sift, "nothing", always),
        network_spec(Self::XFeat, FEATURES, &["xfeat"], || is_usable("xfeat")),
        network_spec(Self::SuperPoint, FEATURES, &["superpoint"], || {
            is_usable("superpoint")
        }),
        network_spec(Self::Aliked, ALIKED, &["aliked"], || is_usable("aliked")),
    ];
}

const LIGHTERGLUE: &str =
    "features of xfeat, its network and ONNX Runtime; get both with 'ostra models install'";
const SUPERGLUE: &str = "features of superpoint, the network superglue-outdoor or superglue-indoor and ONNX Runtime; \
                         add them with 'ostra models add'";
const SIFT_LIGHTGLUE: &str = "features of sift, the network sift-lightglue and ONNX Runtime; \
                              get both with 'ostra models install'";
const ALIKED_LIGHTGLUE: &str = "features of aliked, the network aliked-lightglue and ONNX Runtime; \
                                get them with 'ostra models install'";

impl EngineId for MatcherId {
    const KIND: EngineKind = EngineKind::Matcher;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(Self::Auto, "what the chosen matcher needs", always),
        spec(Self::Nearest, "nothing", always),
        network_spec(Self::LighterGlue, LIGHTERGLUE, &["lighterglue"], || {
            is_usable("lighterglue")
        }),
        network_spec(
            Self::SuperGlue,
            SUPERGLUE,
            &["superglue-outdoor", "superglue-indoor"],
            || superglue_network().is_some(),
        ),
        network_spec(
            Self::SiftLightGlue,
            SIFT_LIGHTGLUE,
            &["sift-lightglue"],
            || is_usable("sift-lightglue"),
        ),
        network_spec(
            Self::AlikedLightGlue,
            ALIKED_LIGHTGLUE,
            &["aliked-lightglue"],
            || is_usable("aliked-lightglue"),
        ),
    ];
}

/// Returns every engine that can be named on the command line, `auto` first within its kind.
#[must_use]
pub fn list_engines() -> Vec<EngineInfo> {
    SegmenterId::list()
        .chain(GrounderId::list())
        .chain(TrackerId::list())
        .chain(FeatureId::list())
        .chain(MatcherId::list())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_engine_has_one_row_and_states_its_requirements_if_not_installed() {
        fn check<I: EngineId>() {
            let ids: Vec<I> = I::TABLE.iter().map(|row| row.id).collect();
            assert_eq!(ids, I::ALL);
            for row in I::TABLE {
                if row.id.is_installed() {
                    assert_eq!(row.id.installed().unwrap(), row.id);
                } else {
                    let error = row.id.installed().unwrap_err().to_string();
                    assert!(error.contains(row.needs), "{error}");
                }
            }
        }
        check::<SegmenterId>();
        check::<GrounderId>();
        check::<TrackerId>();
        check::<FeatureId>();
        check::<MatcherId>();
    }
}
