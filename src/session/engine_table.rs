//! The table of engines: which there are, what they need, and whether they can be used.

use anyhow::{Result, bail};

use crate::networks::{is_usable, sam_network, superglue_network};

/// What an engine is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EngineKind {
    /// Turns prompts into masks.
    Segmenter,
    /// Finds what words name.
    Grounder,
    /// Carries masks through the sequence.
    Tracker,
    /// Finds keypoints in images.
    Features,
    /// Matches keypoints of two images.
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

/// An engine as lists show it.
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

/// A row of the table of engines.
pub(crate) struct EngineSpec<I> {
    id: I,
    /// Its name on the command line and in recipes.
    name: &'static str,
    /// What it needs: of the frames where it is installed, to be used at all where it is not.
    needs: &'static str,
    is_installed: fn() -> bool,
}

/// The engines of one kind.
pub(crate) trait EngineId: Copy + Eq + 'static {
    const KIND: EngineKind;

    /// The rows of the table, `auto` first.
    const TABLE: &'static [EngineSpec<Self>];

    /// The engine of this name.
    ///
    /// # Errors
    /// Names what it needs where it is not installed, and all engines where it does not exist.
    fn installed(name: &str) -> Result<Self> {
        match Self::TABLE.iter().find(|spec| spec.name == name) {
            Some(spec) if (spec.is_installed)() => Ok(spec.id),
            Some(spec) => bail!("'{name}' is not installed: it needs {}", spec.needs),
            None => {
                let names: Vec<&str> = Self::TABLE.iter().map(|spec| spec.name).collect();
                let (what, names) = (Self::KIND.noun(), names.join(", "));
                bail!("there is no {what} '{name}'; choose one of {names}")
            }
        }
    }

    fn spec(self) -> Option<&'static EngineSpec<Self>> {
        Self::TABLE.iter().find(|spec| spec.id == self)
    }

    /// Its name on the command line and in recipes.
    fn name(self) -> &'static str {
        self.spec().map_or("", |spec| spec.name)
    }

    fn is_installed(self) -> bool {
        self.spec().is_some_and(|spec| (spec.is_installed)())
    }

    /// The rows as lists show them.
    fn list() -> impl Iterator<Item = Engine> {
        Self::TABLE.iter().map(|spec| Engine {
            kind: Self::KIND,
            name: spec.name,
            installed: (spec.is_installed)(),
            needs: spec.needs,
        })
    }
}

const fn spec<I>(
    id: I,
    name: &'static str,
    needs: &'static str,
    is_installed: fn() -> bool,
) -> EngineSpec<I> {
    EngineSpec {
        id,
        name,
        needs,
        is_installed,
    }
}

fn always() -> bool {
    true
}

/// A segmenter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SegmenterId {
    Auto,
    Sam,
    SamClose,
    Geometry,
    Builtin,
}

const SAM: &str = "the networks sam-vit-b, mobile-sam or efficient-sam and ONNX Runtime; add both with 'ostra models add'";

impl EngineId for SegmenterId {
    const KIND: EngineKind = EngineKind::Segmenter;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(
            Self::Auto,
            "auto",
            "nothing; takes the best that is installed",
            always,
        ),
        spec(Self::Sam, "sam", SAM, || sam_network().is_some()),
        spec(Self::SamClose, "sam-close", SAM, || sam_network().is_some()),
        spec(
            Self::Geometry,
            "geometry",
            "depth and cameras of several frames; takes thin things by the picture alone",
            always,
        ),
        spec(Self::Builtin, "builtin", "nothing", always),
    ];
}

/// What finds things by text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum GrounderId {
    Auto,
    GroundingDino,
    Yolox,
}

const GROUNDER: &str =
    "the networks grounding-dino or yolox and ONNX Runtime; add both with 'ostra models add'";
const GROUNDING_DINO: &str =
    "the network grounding-dino and ONNX Runtime; add both with 'ostra models add'";
const YOLOX: &str = "the network yolox and ONNX Runtime; add both with 'ostra models add'";

impl EngineId for GrounderId {
    const KIND: EngineKind = EngineKind::Grounder;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(Self::Auto, "auto", GROUNDER, || {
            is_usable("grounding-dino") || is_usable("yolox")
        }),
        spec(
            Self::GroundingDino,
            "grounding-dino",
            GROUNDING_DINO,
            || is_usable("grounding-dino"),
        ),
        spec(Self::Yolox, "yolox", YOLOX, || is_usable("yolox")),
    ];
}

/// A tracker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TrackerId {
    Auto,
    XMem,
    Deaot,
    Geometry,
    Flow,
}

const NETWORKS: &str = "its networks and ONNX Runtime; add both with 'ostra models add'";

impl EngineId for TrackerId {
    const KIND: EngineKind = EngineKind::Tracker;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(
            Self::Auto,
            "auto",
            "what the tracker it takes needs",
            always,
        ),
        spec(Self::XMem, "xmem", NETWORKS, || is_usable("xmem")),
        spec(Self::Deaot, "deaot", NETWORKS, || is_usable("deaot")),
        spec(
            Self::Geometry,
            "geometry",
            "depth and cameras of the frames",
            always,
        ),
        spec(
            Self::Flow,
            "flow",
            "nothing; remembers better by the network xfeat",
            always,
        ),
    ];
}

/// What finds keypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FeatureId {
    Auto,
    Sift,
    XFeat,
    SuperPoint,
}

const FEATURES: &str = "its network and ONNX Runtime; add both with 'ostra models add'";

impl EngineId for FeatureId {
    const KIND: EngineKind = EngineKind::Features;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(
            Self::Auto,
            "auto",
            "nothing; takes sift, the most accurate",
            always,
        ),
        spec(Self::Sift, "sift", "nothing", always),
        spec(Self::XFeat, "xfeat", FEATURES, || is_usable("xfeat")),
        spec(Self::SuperPoint, "superpoint", FEATURES, || {
            is_usable("superpoint")
        }),
    ];
}

/// What matches keypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MatcherId {
    Auto,
    Nearest,
    LighterGlue,
    SuperGlue,
}

const LIGHTERGLUE: &str =
    "features of xfeat, its network and ONNX Runtime; add both with 'ostra models add'";
const SUPERGLUE: &str = "features of superpoint, the network superglue-outdoor or superglue-indoor and ONNX Runtime; \
                         add them with 'ostra models add'";

impl EngineId for MatcherId {
    const KIND: EngineKind = EngineKind::Matcher;
    const TABLE: &'static [EngineSpec<Self>] = &[
        spec(
            Self::Auto,
            "auto",
            "what the matcher it takes needs",
            always,
        ),
        spec(Self::Nearest, "nearest", "nothing", always),
        spec(Self::LighterGlue, "lighterglue", LIGHTERGLUE, || {
            is_usable("lighterglue")
        }),
        spec(Self::SuperGlue, "superglue", SUPERGLUE, || {
            superglue_network().is_some()
        }),
    ];
}

/// Every engine that the command line names, `auto` first within its kind.
#[must_use]
pub fn list_engines() -> Vec<Engine> {
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
    fn every_engine_is_found_by_its_name_and_others_are_refused_with_all_names() {
        fn check<I: EngineId + std::fmt::Debug>() {
            for row in I::TABLE {
                assert_eq!(row.id.name(), row.name);
                if row.id.is_installed() {
                    assert_eq!(I::installed(row.name).unwrap(), row.id);
                } else {
                    let error = I::installed(row.name).unwrap_err().to_string();
                    assert!(error.contains(row.needs), "{error}");
                }
            }
            let error = I::installed("AUTO").unwrap_err().to_string();
            assert!(error.contains("choose one of auto, "), "{error}");
        }
        check::<SegmenterId>();
        check::<GrounderId>();
        check::<TrackerId>();
        check::<FeatureId>();
        check::<MatcherId>();
    }
}
