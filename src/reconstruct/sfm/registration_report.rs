use serde::{Deserialize, Serialize};

use super::{Mapped, MapperOptions, TriedPair};
use ostra_geometry::TwoViewKind;

/// Result for one frame: how it got a camera, or why it has none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RegistrationStatus {
    /// Structure from motion found its camera.
    Placed {
        /// Number of model points that it sees.
        points: usize,
        /// Median reprojection error of these points in pixels.
        error_px: f64,
    },
    /// RGB-D registration found its camera.
    Registered {
        /// Number of frames whose depth and image agree with its own.
        neighbours: usize,
        /// Median over these frames of the share of the jointly visible pixels that agree, 0–1.
        consistent: f64,
    },
    /// Its intrinsics are unknown, so its depth has no known shape.
    NoIntrinsics,
    /// It has too little depth to be registered.
    NoDepth {
        /// Share of its pixels with known depth, 0–1.
        known: f64,
    },
    /// Its depth and image agree with those of no other frame.
    Unlike {
        /// The frame that agrees most, and the share of the jointly visible pixels that agrees.
        nearest: Option<(usize, f64)>,
    },
    /// It belongs to a group of frames that no link joins with the kept ones.
    Apart {
        /// Number of frames in this group.
        frames: usize,
    },
    /// Its image cannot be read.
    Unreadable {
        /// Message of the read error.
        why: String,
    },
    /// Its image has too few features.
    FewFeatures {
        /// Number of features found.
        found: usize,
    },
    /// No other image shows the same part of the scene.
    NoPair {
        /// The frame with the most matches, and their number; they do not agree with one camera motion.
        nearest: Option<(usize, usize)>,
    },
    /// It matches other images but sees too few points of the model.
    FewPoints {
        /// Keypoints that see points of the model.
        seen: usize,
        /// Number needed.
        needed: usize,
        /// The frame that shares most with it, and the number of matches that agree.
        nearest: Option<(usize, usize)>,
    },
    /// The model points that it sees do not agree on a camera pose.
    NoPose {
        /// Keypoints that see points of the model.
        seen: usize,
        /// Number of these that agreed.
        agreeing: usize,
    },
    /// It belongs to another model that is not connected with the one in use.
    OtherModel {
        /// Number of that model, counted from 1.
        model: usize,
        /// Number of images in it.
        images: usize,
    },
    /// The run was stopped before this frame was tried.
    NotReached,
}

/// Images with fewer features than this are reported as having too few.
pub(super) const FEW_FEATURES: usize = 50;

impl RegistrationStatus {
    /// Returns whether the frame has a camera.
    #[must_use]
    pub fn is_placed(&self) -> bool {
        matches!(self, Self::Placed { .. } | Self::Registered { .. })
    }

    /// Describes the outcome for people; `name` returns the name of another frame by its number.
    #[must_use]
    pub fn text<'a>(&self, name: impl Fn(usize) -> &'a str) -> String {
        match self {
            Self::Placed { points, error_px } => {
                format!("sees {points} points, median error {error_px:.2} px")
            }
            Self::Registered {
                neighbours,
                consistent,
            } => {
                format!(
                    "agrees with {neighbours} frames, in {:.1} % of what both see",
                    100.0 * consistent
                )
            }
            Self::NoIntrinsics => "its camera is not known; give --intrinsics or --cameras".into(),
            Self::NoDepth { known } => {
                format!(
                    "depth is known for {:.1} % of its pixels, too few to register it by",
                    100.0 * known
                )
            }
            Self::Unlike { nearest: None } => {
                "its depth and image do not agree with those of any other frame".into()
            }
            Self::Unlike {
                nearest: Some((frame, consistent)),
            } => format!(
                "its depth and image do not agree with those of any other frame; most with {}, in {:.0} % of what both see",
                name(*frame),
                100.0 * consistent
            ),
            Self::Apart { frames } => format!(
                "belongs to {frames} frames that nothing joins with those kept; take a recording that shows both places"
            ),
            Self::Unreadable { why } => why.clone(),
            Self::FewFeatures { found } => format!(
                "only {found} features; the image is blurred, dark, without texture or masked: leave it out or take \
                 it again"
            ),
            Self::NoPair { nearest: None } => {
                "no other image shows the same scene; take images between it and the others".into()
            }
            Self::NoPair {
                nearest: Some((frame, matches)),
            } => format!(
                "its {matches} matches with {}, the nearest, do not agree with one camera movement; take images \
                 between them",
                name(*frame)
            ),
            Self::FewPoints {
                seen,
                needed,
                nearest,
            } => {
                let nearest = nearest.map(|(frame, matches)| {
                    format!(" (most matches: {matches}, with {})", name(frame))
                });
                let nearest = nearest.unwrap_or_default();
                format!(
                    "sees {seen} points of the model where {needed} are needed{nearest}; take images that overlap \
                     more, or closer together"
                )
            }
            Self::NoPose { seen, agreeing } => format!(
                "only {agreeing} of the {seen} points that it sees agree on a camera position; something moved, or \
                 the image shows a similar but other place"
            ),
            Self::OtherModel { model, images } => format!(
                "belongs to model {model} of {images} images, which is not connected with the one in use; use that \
                 model, or take images that show both parts"
            ),
            Self::NotReached => "the run was stopped before it was tried; reconstruct again".into(),
        }
    }
}

/// Result of matching and mapping, from which the outcomes of images follow.
pub struct RegistrationReport<'a> {
    /// Frame of each image.
    pub frame_of: &'a [usize],
    /// The pairs that were matched.
    pub tried: &'a [TriedPair],
    /// The models.
    pub models: &'a [Mapped],
    /// Index of the model whose cameras are used.
    pub kept: usize,
    /// Options of the mapper.
    pub options: &'a MapperOptions,
}

impl RegistrationReport<'_> {
    /// Returns the outcome of each image.
    ///
    /// `features` holds the number of features per image (`Err` = why it cannot be read). `placed`
    /// gives the number of points and the median error of an image in the kept model.
    #[must_use]
    pub fn outcomes(
        &self,
        features: &[Result<usize, String>],
        placed: &dyn Fn(usize) -> Option<(usize, f64)>,
    ) -> Vec<RegistrationStatus> {
        let outcome = |(image, found): (usize, &Result<usize, String>)| {
            if let Some((points, error_px)) = placed(image) {
                return RegistrationStatus::Placed { points, error_px };
            }
            match found {
                Err(why) => RegistrationStatus::Unreadable { why: why.clone() },
                Ok(found) if *found < FEW_FEATURES => {
                    RegistrationStatus::FewFeatures { found: *found }
                }
                Ok(_) => self.left_out(image),
            }
        };
        features.iter().enumerate().map(outcome).collect()
    }

    /// Returns the outcome of an image with enough features that the kept model does not contain.
    fn left_out(&self, image: usize) -> RegistrationStatus {
        let Self {
            frame_of,
            tried,
            models,
            kept,
            options,
        } = *self;
        let frame = |nearest: Option<(usize, usize)>| {
            nearest.map(|(image, matches)| (frame_of[image], matches))
        };
        let is_in = |&(index, mapped): &(usize, &Mapped)| {
            index != kept && mapped.model.is_placed(image as u32)
        };
        if let Some((index, other)) = models.iter().enumerate().find(is_in) {
            return RegistrationStatus::OtherModel {
                model: index + 1,
                images: other.model.placed().count(),
            };
        }
        let verified = most(image, tried, |pair| {
            pair.verified.as_ref().map_or(0, |pair| pair.matches.len())
        });
        if verified.is_none() {
            return RegistrationStatus::NoPair {
                nearest: frame(most(image, tried, |pair| pair.matches)),
            };
        }
        let refused = models
            .get(kept)
            .and_then(|mapped| mapped.refused.get(&(image as u32)));
        match refused {
            Some(refusal) if refusal.seen >= options.pose_inliers => RegistrationStatus::NoPose {
                seen: refusal.seen,
                agreeing: refusal.agreeing,
            },
            _ if models.get(kept).is_some_and(|mapped| mapped.stopped) => {
                RegistrationStatus::NotReached
            }
            refusal => RegistrationStatus::FewPoints {
                seen: refusal.map_or(0, |refusal| refusal.seen),
                needed: options.pose_inliers,
                nearest: frame(verified),
            },
        }
    }
}

/// Returns the image that shares most with this one, and how much; `None` if no image shares anything.
fn most(
    image: usize,
    tried: &[TriedPair],
    share: impl Fn(&TriedPair) -> usize,
) -> Option<(usize, usize)> {
    let own = tried
        .iter()
        .filter(|pair| pair.images.contains(&(image as u32)));
    let shares = own.map(|pair| {
        let [a, b] = pair.images.map(|image| image as usize);
        (if a == image { b } else { a }, share(pair))
    });
    shares
        .filter(|&(_, shared)| shared > 0)
        .max_by_key(|&(other, shared)| (shared, std::cmp::Reverse(other)))
}

/// Explains why fewer than two images can be matched at all.
fn why_nothing_to_match(features: &[Result<usize, String>]) -> Option<String> {
    let rich = features
        .iter()
        .filter(|found| found.as_ref().is_ok_and(|&found| found >= FEW_FEATURES))
        .count();
    if rich >= 2 || features.len() < 2 {
        return None;
    }
    if let Some(why) = features.iter().find_map(|found| found.as_ref().err()) {
        return Some(format!(
            "only {rich} images can be used; the first that cannot be read: {why}"
        ));
    }
    let most = features
        .iter()
        .filter_map(|found| found.as_ref().ok())
        .max()
        .copied()
        .unwrap_or(0);
    Some(format!(
        "{rich} of {} images have enough features (the best has {most}); they are blurred, dark, without texture or \
         masked: take them again, or leave out --only-labelled",
        features.len()
    ))
}

/// Explains why there is no pair to start from, and what the user can do.
#[must_use]
pub fn why_no_start(
    names: &[&str],
    features: &[Result<usize, String>],
    tried: &[TriedPair],
) -> String {
    if let Some(why) = why_nothing_to_match(features) {
        return why;
    }
    let verified: Vec<_> = tried
        .iter()
        .filter_map(|pair| pair.verified.as_ref())
        .collect();
    let named = |images: [u32; 2]| images.map(|image| names[image as usize]).join(" and ");
    let Some(best) = verified
        .iter()
        .max_by_key(|pair| (pair.matches.len(), std::cmp::Reverse(pair.images)))
    else {
        let Some(nearest) = tried
            .iter()
            .max_by_key(|pair| (pair.matches, std::cmp::Reverse(pair.images)))
        else {
            return "no two images could be compared; give at least two images of the same scene"
                .into();
        };
        return format!(
            "no two images show the same scene: the nearest are {}, with {} matches that do not agree with one camera \
             movement; take images that overlap by more than half",
            named(nearest.images),
            nearest.matches
        );
    };
    if verified
        .iter()
        .all(|pair| pair.kind == TwoViewKind::Panoramic)
    {
        return format!(
            "the camera only turned, or did not move at all: no pair of {} that show the same scene (best {}, {} matches) \
             has parallax; move sideways between images",
            verified.len(),
            named(best.images),
            best.matches.len()
        );
    }
    let widest = verified
        .iter()
        .map(|pair| pair.parallax)
        .fold(0.0, f64::max)
        .to_degrees();
    format!(
        "no two images to start from among {} that show the same scene: the best are {}, with {} matches and {:.1}° between \
         their rays, the widest angle is {widest:.1}°; take images farther apart that still overlap",
        verified.len(),
        named(best.images),
        best.matches.len(),
        best.parallax.to_degrees()
    )
}
