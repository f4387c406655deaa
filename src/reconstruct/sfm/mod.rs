//! Structure from motion: features, pair selection, matching, incremental mapping, and a report per
//! image.
//!
//! Every image that gets no camera has an [`Outcome`] with the reason.

mod account;
mod cache;
mod error;
mod extract;
mod features;
mod groups;
mod locate;
mod mapper;
pub mod matching;
pub mod onnx;
mod pairs;
mod pipeline;
mod problem;
mod request;
pub mod retrieval;
mod scale;
mod second_chance;
pub mod sift;
mod tilted;
mod undistort;

pub use account::Outcome;
pub use cache::{CachedExtractor, CachedMatcher, FeatureCache};
pub use error::SfmError;
pub use extract::{AllowedPixels, PictureFeatures};
pub use features::{
    Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features, PairMatches,
};
pub use groups::CameraGroups;
pub use mapper::{Mapped, MapperOptions, Refusal, Start, map};
pub use pairs::{PairOptions, TriedPair, choose_pairs, match_pairs};
pub use pipeline::structure_from_motion;
pub use problem::{
    Correspondences, IntrinsicsSource, KeypointId, MapCamera, MapImage, MapProblem, ModelPoint,
    SparseModel, VerifiedPair,
};
pub use request::{SfmRequest, SfmResult};
pub use scale::{MetricScale, metric_scale};
pub use sift::{Sift, SiftOptions};
pub use undistort::{for_each_source, undistort_image, undistort_mask, undistorted_camera};
