//! Names of the engines that a request can choose.

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An engine that requests, recipes and the command line select by name.
pub trait EngineName: Copy + Eq + fmt::Debug + Send + Sync + 'static {
    /// Noun for this kind of engine in messages, such as "tracker".
    const NOUN: &'static str;

    /// The automatic choice.
    const AUTO: Self;

    /// All engines of this kind, the automatic choice first.
    const ALL: &'static [Self];

    /// Returns the name on the command line and in recipes.
    fn name(self) -> &'static str;

    /// Returns the engine with this name.
    #[must_use]
    fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|id| id.name() == name)
    }
}

/// Error for an unknown engine name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no {noun} '{name}'; choose one of {known}")]
pub struct UnknownEngine {
    noun: &'static str,
    name: String,
    known: String,
}

impl UnknownEngine {
    fn new<I: EngineName>(name: &str) -> Self {
        let known: Vec<&str> = I::ALL.iter().map(|id| id.name()).collect();
        Self {
            noun: I::NOUN,
            name: name.to_owned(),
            known: known.join(", "),
        }
    }
}

macro_rules! engine_ids {
    ($(#[$doc:meta])* $id:ident, $noun:literal, { $($(#[$variant_doc:meta])* $variant:ident = $name:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
        #[serde(into = "&str", try_from = "String")]
        #[schemars(!into, !try_from)]
        pub enum $id {
            /// The best engine that is installed and suits the frames.
            #[default]
            #[schemars(rename = "auto")]
            Auto,
            $($(#[$variant_doc])* #[schemars(rename = $name)] $variant,)+
        }

        impl EngineName for $id {
            const NOUN: &'static str = $noun;
            const AUTO: Self = Self::Auto;
            const ALL: &'static [Self] = &[Self::Auto, $(Self::$variant),+];

            fn name(self) -> &'static str {
                match self {
                    Self::Auto => "auto",
                    $(Self::$variant => $name,)+
                }
            }
        }

        impl FromStr for $id {
            type Err = UnknownEngine;

            fn from_str(name: &str) -> Result<Self, UnknownEngine> {
                Self::from_name(name).ok_or_else(|| UnknownEngine::new::<Self>(name))
            }
        }

        impl TryFrom<String> for $id {
            type Error = UnknownEngine;

            fn try_from(name: String) -> Result<Self, UnknownEngine> {
                name.parse()
            }
        }

        impl From<$id> for &'static str {
            fn from(id: $id) -> Self {
                id.name()
            }
        }

        impl fmt::Display for $id {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

engine_ids! {
    /// An engine that turns prompts into masks.
    SegmenterId, "segmenter", {
        /// Segment Anything.
        Sam = "sam",
        /// Segment Anything on a full-resolution crop around each prompt.
        SamClose = "sam-close",
        /// Connected surfaces, for frames with depth and cameras.
        Geometry = "geometry",
        /// The built-in segmenter.
        Builtin = "builtin",
    }
}

engine_ids! {
    /// An engine that finds objects by text.
    GrounderId, "grounder", {
        /// Grounding DINO.
        GroundingDino = "grounding-dino",
        /// YOLOX, with the 80 classes of COCO.
        Yolox = "yolox",
    }
}

engine_ids! {
    /// An engine that propagates masks through the sequence.
    TrackerId, "tracker", {
        /// XMem.
        XMem = "xmem",
        /// DeAOT.
        Deaot = "deaot",
        /// Re-projection through depth and cameras.
        Geometry = "geometry",
        /// Optical flow.
        Flow = "flow",
    }
}

engine_ids! {
    /// An engine that detects and describes keypoints.
    FeatureId, "feature extractor", {
        /// SIFT.
        Sift = "sift",
        /// XFeat.
        XFeat = "xfeat",
        /// SuperPoint.
        SuperPoint = "superpoint",
        /// ALIKED.
        Aliked = "aliked",
    }
}

engine_ids! {
    /// An engine that matches the keypoints of two images.
    MatcherId, "matcher", {
        /// Nearest neighbours in descriptor space, with the ratio test.
        Nearest = "nearest",
        /// LighterGlue, for XFeat.
        LighterGlue = "lighterglue",
        /// SuperGlue, for SuperPoint.
        SuperGlue = "superglue",
        /// LightGlue, for SIFT.
        SiftLightGlue = "sift-lightglue",
        /// LightGlue, for ALIKED.
        AlikedLightGlue = "aliked-lightglue",
    }
}

engine_ids! {
    /// A method that registers fragments of an RGB-D recording that have no other link.
    RegistrationId, "registration", {
        /// Fast Global Registration.
        Fgr = "fgr",
        /// RANSAC.
        Ransac = "ransac",
    }
}

engine_ids! {
    /// The device that runs stereo.
    DeviceId, "device", {
        /// The CPU.
        Cpu = "cpu",
        /// The GPU.
        Gpu = "gpu",
    }
}

impl TrackerId {
    /// Returns whether the tracker is a network with a configurable image size.
    #[must_use]
    pub fn has_image_size(self) -> bool {
        matches!(self, Self::XMem | Self::Deaot)
    }

    /// Returns the names of all trackers with a configurable image size.
    pub fn names_with_image_size() -> impl Iterator<Item = &'static str> {
        let with_size = Self::ALL.iter().filter(|id| id.has_image_size());
        with_size.map(|id| id.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check<I>(known: &[&str])
    where
        I: EngineName + FromStr<Err = UnknownEngine> + Default + Serialize + fmt::Display,
        I: for<'de> Deserialize<'de>,
    {
        let names: Vec<&str> = I::ALL.iter().map(|id| id.name()).collect();
        assert_eq!(names, known);
        assert_eq!(I::default().name(), "auto");
        for &id in I::ALL {
            assert_eq!(id.name().parse::<I>(), Ok(id));
            let json = serde_json::to_string(&id).unwrap();
            assert_eq!(json, format!("\"{id}\""));
            assert_eq!(serde_json::from_str::<I>(&json).unwrap(), id);
        }
        let error = serde_json::from_str::<I>("\"AUTO\"")
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(&format!(
                "there is no {} 'AUTO'; choose one of auto, ",
                I::NOUN
            )),
            "{error}"
        );
    }

    /// The names are stored in recipes and used in scripts, so they must not change.
    #[test]
    fn names_are_the_same_in_recipes_and_on_the_command_line() {
        check::<SegmenterId>(&["auto", "sam", "sam-close", "geometry", "builtin"]);
        check::<GrounderId>(&["auto", "grounding-dino", "yolox"]);
        check::<TrackerId>(&["auto", "xmem", "deaot", "geometry", "flow"]);
        check::<FeatureId>(&["auto", "sift", "xfeat", "superpoint", "aliked"]);
        check::<MatcherId>(&[
            "auto",
            "nearest",
            "lighterglue",
            "superglue",
            "sift-lightglue",
            "aliked-lightglue",
        ]);
        check::<RegistrationId>(&["auto", "fgr", "ransac"]);
        check::<DeviceId>(&["auto", "cpu", "gpu"]);
    }
}
