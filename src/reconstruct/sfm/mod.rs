//! Structure from motion: features, pair selection, matching, incremental mapping, and a report per
//! image.
//!
//! Every image that gets no camera has an [`RegistrationStatus`] with the reason.

mod asift;
mod cache;
mod error;
mod extract;
mod features;
mod groups;
mod locate;
mod mapper;
pub mod matching;
mod nearby_pairs;
pub mod onnx;
mod pair_selection;
mod pairs;
mod pipeline;
mod problem;
mod registration_report;
mod request;
pub mod retrieval;
mod retry_unregistered;
mod scale;
mod sequences;
pub mod sift;
mod undistort;
mod view_graph;

pub use cache::{
    CachedExtractor, CachedMatcher, FeatureCache, ImageKey, VerifiedMatches, feature_cache_bytes,
    remove_feature_cache,
};
pub use error::SfmError;
pub use extract::{AllowedPixels, ImageFeatures};
pub use features::{
    Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features, PairMatches,
};
pub use groups::CameraGroups;
pub use mapper::{
    FirstPairRequirement, Mapped, MapperOptions, ModelStart, Refusal, extend, join_models, map,
};
pub use pair_selection::PairOptions;
pub use pairs::{MatchedImages, TriedPair, match_pairs};
pub use pipeline::{CONTRADICTORY, planned_stages, structure_from_motion};
pub use problem::{
    Correspondences, IntrinsicsPrior, KeypointId, MapCamera, MapImage, MapProblem, ModelPoint,
    SparseModel, VerifiedPair,
};
pub use registration_report::RegistrationStatus;
pub use request::{SfmModel, SfmRequest, SfmResult};
pub use scale::{MetricScale, metric_scale};
pub use sift::{Sift, SiftOptions};
pub use undistort::{for_each_source, undistort_image, undistort_mask, undistorted_camera};
