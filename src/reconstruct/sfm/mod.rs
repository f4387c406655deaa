//! Structure from motion: features, matches, pairs, incremental mapping, the account of what was left out.

mod account;
mod cache;
mod correspondences;
mod error;
mod extract;
mod features;
mod groups;
mod locate;
mod mapper;
pub mod matching;
mod model;
pub mod onnx;
mod pairs;
mod pipeline;
mod problem;
mod result;
pub mod retrieval;
mod scale;
mod second_chance;
pub mod sift;
mod sift_extractor;
mod tilted;
mod undistort;
mod verify;

pub use account::Outcome;
pub use cache::{CachedExtractor, CachedMatcher, FeatureCache};
pub use correspondences::Correspondences;
pub use error::SfmError;
pub use extract::{AllowedPixels, PictureFeatures};
pub use features::{
    Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features, PairMatches,
};
pub use groups::CameraGroups;
pub use mapper::{Mapped, MapperOptions, Refusal, Start, map};

pub use model::{ModelPoint, SparseModel};
pub use pairs::{PairOptions, choose_pairs};
pub use pipeline::{SfmRequest, structure_from_motion};
pub use problem::{IntrinsicsSource, KeypointId, MapCamera, MapImage, MapProblem, VerifiedPair};
pub use result::SfmResult;
pub use scale::{MetricScale, metric_scale};
pub use sift::SiftOptions;
pub use sift_extractor::Sift;
pub use undistort::{for_each_source, undistort_image, undistort_mask, undistorted_camera};
pub use verify::{TriedPair, match_pairs};
